"""PSNR of an asset in photos without masks counts what the asset covered at first, whatever lies around it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ibrpipe.core.color import srgb_decode
from ibrpipe.evaluation.photo_fit import AROUND, PhotoFit
from ibrpipe.io.photos.images import write_png
from ibrpipe.io.views import View
from ibrpipe.renderers.api import render
from ibrpipe.types import Asset, Camera, LayeredDepthImage, ParallelFrame, Texture

SIDE, CODE, OFF = 20, 100, 10


def wall(width: int) -> Asset:
    """A grey wall of 20 texels' height and so many texels' width."""
    frame = ParallelFrame((-1, -1, 0), (2 / SIDE, 0, 0), (0, 2 / SIDE, 0), (0, 0, 1))
    offsets = np.arange(SIDE)[:, None] * width + np.arange(width + 1)
    count = SIDE * width
    color = np.full((count, 3), srgb_decode(np.float32(CODE / 255)), np.float32)
    normal = np.tile(np.float32([0, 0, -1]), (count, 1))
    depth = np.ones(count, np.float32)
    return Asset((Texture(LayeredDepthImage(frame, offsets, depth, color, normal, np.full(count, 3, np.int32))),))


@pytest.fixture
def view(tmp_path: Path) -> View:
    """A photo without a mask: the wall 10 codes too bright in its middle, white all around."""
    camera = Camera.look_at((0, 0, -3), (0, 0, 1), up=(0, -1, 0), fov_y_deg=60, width=64, height=48)
    covered = np.asarray(render(wall(SIDE), camera).alpha) >= 0.5
    assert 0.1 < covered.mean() < 0.5
    code = np.where(covered[:, :, None], (CODE + OFF) / 255, 1.0) * np.ones(3)
    write_png(tmp_path / "photo.png", srgb_decode(code))
    return View("photo", camera, tmp_path / "photo.png")


def test_what_the_asset_never_shows_does_not_count(view: View) -> None:
    whole = wall(SIDE)
    covered = np.asarray(render(whole, view.camera).alpha) >= 0.5
    rows, columns = np.ptp(np.argwhere(covered), axis=0) + 1
    inside, counted = rows * columns, (rows + 2 * AROUND) * (columns + 2 * AROUND)
    assert inside == covered.sum()
    square = inside * OFF**2 / counted / 255**2  # the few pixels around are as the asset itself shows them
    assert PhotoFit([view], whole).psnr(whole) == pytest.approx(-10 * np.log10(square), abs=1e-6)


def test_a_mask_says_what_counts(view: View) -> None:
    whole, masked = wall(SIDE), replace(view, mask_threshold=0.999)  # white alone is the object
    assert PhotoFit([masked], whole).psnr(whole) == pytest.approx(0.0, abs=0.1)  # black instead of white


def test_what_coding_has_cut_away_counts(view: View) -> None:
    whole, half = wall(SIDE), wall(SIDE // 2)
    fit = PhotoFit([view], whole)
    # half of the wall is black instead of 110 codes; the pixels around are black in either
    more = 10 ** (-0.1 * fit.psnr(half)) - 10 ** (-0.1 * fit.psnr(whole))
    rows, columns = np.ptp(np.argwhere(np.asarray(render(whole, view.camera).alpha) >= 0.5), axis=0) + 1
    counted = (rows + 2 * AROUND) * (columns + 2 * AROUND)
    expected = 0.5 * rows * columns / counted * ((CODE + OFF) ** 2 - OFF**2) / 255**2
    assert more == pytest.approx(expected, rel=1.5 / columns)  # a column of pixels more or less


def test_what_coding_has_added_at_rims_counts(view: View) -> None:
    whole, half = wall(SIDE), wall(SIDE // 2)
    fit = PhotoFit([view], half)
    rows, columns = np.ptp(np.argwhere(np.asarray(render(half, view.camera).alpha) >= 0.5), axis=0) + 1
    counted = (rows + 2 * AROUND) * (columns + 2 * AROUND)
    grown = rows * AROUND * (CODE / 255) ** 2 / counted  # at one side of four; further away nothing counts
    more = 10 ** (-0.1 * fit.psnr(whole)) - 10 ** (-0.1 * fit.psnr(half))
    assert more == pytest.approx(grown, rel=0.1)


def test_nothing_is_measured_where_nothing_is_shown(view: View) -> None:
    away = replace(
        view, camera=Camera.look_at((0, 0, -3), (0, 0, -4), up=(0, -1, 0), fov_y_deg=60, width=64, height=48)
    )
    assert PhotoFit([away], wall(SIDE)).psnr(wall(SIDE)) is None
