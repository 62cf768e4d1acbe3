"""Errors by texture and tile: noise of known size is found where it was put."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError

from ibrpipe.core.color import srgb_decode, srgb_encode
from ibrpipe.evaluation.report.error_pictures import draw_errors
from ibrpipe.evaluation.texture_errors import Tiling, texture_errors, tiles_of_pixels
from ibrpipe.io.documents.texture_errors import TextureErrors
from ibrpipe.io.photos.images import write_png
from ibrpipe.io.views import View, ViewSet
from ibrpipe.renderers.api import prepare, render
from ibrpipe.types import Asset, Camera, LayeredDepthImage, ParallelFrame, Texture

HEIGHT, WIDTH = 48, 96
FRAME = ParallelFrame((-1.0, -0.5, 0.0), (2 / WIDTH, 0, 0), (0, 1 / HEIGHT, 0), (0, 0, 1))
CAMERA = Camera.look_at((0, 0, -2), (0, 0, 1), up=(0, -1, 0), fov_y_deg=24, width=96, height=48)
SIGMA = 0.03


def wall() -> LayeredDepthImage:
    offsets = np.arange(HEIGHT)[:, None] * WIDTH + np.arange(WIDTH + 1)
    count = HEIGHT * WIDTH
    left = np.arange(count) % WIDTH < WIDTH // 2
    return LayeredDepthImage(
        FRAME, offsets, np.full(count, 1.0), np.full((count, 3), 0.3), np.tile((0, 0, -1.0), (count, 1)),
        np.where(left, 0, 6).astype(np.int32),
    )  # fmt: skip


@pytest.fixture
def known(tmp_path: Path) -> tuple[Asset, ViewSet]:
    """A wall and a photo of it whose right half has noise."""
    seen = replace(wall(), observers=np.full(HEIGHT * WIDTH, 6, np.int32))
    asset = Asset((Texture(seen),))
    code = srgb_encode(np.asarray(render(asset, CAMERA).color))
    noise = np.random.default_rng(3).normal(0, SIGMA, code.shape)
    noise[:, :48] = 0
    write_png(tmp_path / "a.png", srgb_decode(np.clip(code + noise, 0, 1)))
    return asset, ViewSet((View("a", CAMERA, tmp_path / "a.png"),), ())


def test_noise_is_found_where_it_is(known: tuple[Asset, ViewSet]) -> None:
    asset, views = known
    (found,) = texture_errors(asset, views, [wall().observers])
    assert found.measured_on == "training photos"
    assert (found.tile, found.rows, found.columns) == (16, 3, 6)
    color = np.array(found.tiles.color_rms, float).reshape(3, 6)
    assert np.nanmax(color[:, :2]) < 1.0
    np.testing.assert_allclose(color[:, 4:][np.isfinite(color[:, 4:])], 255 * SIGMA, rtol=0.25)
    assert found.color_rms == pytest.approx(255 * SIGMA / np.sqrt(2), rel=0.1)
    assert found.tiles.depth_rms is None
    np.testing.assert_allclose(np.array(found.tiles.coverage, float).reshape(3, 6), [[0, 0, 0, 1, 1, 1]] * 3)
    np.testing.assert_allclose(np.array(found.tiles.confidence, float).reshape(3, 6), [[0, 0, 0, 0.75, 0.75, 0.75]] * 3)
    assert (found.coverage, found.confidence) == (0.5, pytest.approx(0.38))


def test_held_out_views_come_first(known: tuple[Asset, ViewSet]) -> None:
    asset, views = known
    (found,) = texture_errors(asset, ViewSet((), views.train), [None])
    assert found.measured_on == "held-out views"
    assert found.coverage == 1
    assert found.tiles.coverage is None


def test_every_pixel_shows_the_tile_that_its_ray_meets(known: tuple[Asset, ViewSet]) -> None:
    asset, _ = known
    tiles = tiles_of_pixels(prepare(asset, "ldi").data, CAMERA, Tiling.of(asset))
    rays, shown = CAMERA.pixel_rays(), tiles >= 0
    point = CAMERA.center + rays * ((1.0 - CAMERA.center[2]) / rays[..., 2])[..., None]
    column, row = (point[..., 0] + 1) * WIDTH / 2, (point[..., 1] + 0.5) * HEIGHT
    wanted = (np.clip(row, 0, HEIGHT - 1) // 16) * 6 + np.clip(column, 0, WIDTH - 1) // 16
    beside = (np.abs(row / 16 - np.round(row / 16)) < 0.07) | (np.abs(column / 16 - np.round(column / 16)) < 0.07)
    np.testing.assert_array_equal(tiles[shown & ~beside], wanted[shown & ~beside])
    inside = (column > -0.4) & (column < WIDTH + 0.4) & (row > -0.4) & (row < HEIGHT + 0.4)
    np.testing.assert_array_equal(shown[~beside], inside[~beside])
    assert 0.3 < shown.mean() < 1


def test_pictures_show_what_the_asset_says(known: tuple[Asset, ViewSet]) -> None:
    asset, views = known
    errors = texture_errors(asset, views, [wall().observers])
    (drawn,) = draw_errors(asset, errors, views.train, 64)
    assert (drawn.width, drawn.height) == (64, 32)
    assert drawn.color.startswith("data:image/jpeg")
    assert drawn.color != drawn.confidence
    other = errors[0].model_copy(update={"rows": 2})
    assert draw_errors(asset, [other], views.train, 64) == []


def test_tiles_must_be_complete(known: tuple[Asset, ViewSet]) -> None:
    said = texture_errors(*known, [None])[0].model_dump()
    said["tiles"]["color_rms"] = [1.0]
    with pytest.raises(ValidationError, match="3 x 6 figures"):
        TextureErrors.model_validate(said)
