"""The compress stage on an asset that keeps its photos: they are coded anew, and judged where they do not show."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from ibrpipe.core.color import srgb_decode, srgb_encode, to_bytes
from ibrpipe.io.assets import read_asset, read_index, write_asset
from ibrpipe.io.photos.images import write_png
from ibrpipe.io.views import View, ViewSet, write_views
from ibrpipe.modelling.compression.between import between_photos
from ibrpipe.renderers.api import render
from ibrpipe.stages.compress import CompressConfig, Inputs, run
from ibrpipe.types import (
    Asset,
    Blend,
    Camera,
    KeptPhoto,
    KeptPhotos,
    LayeredDepthImage,
    ParallelFrame,
    PhotoBlend,
    Texture,
)
from ibrpipe.types.layers import offsets_of

ROWS, COLUMNS, TEXEL = 60, 72, 1 / 30
PLACES = [(x, y) for x in np.linspace(-0.9, 0.9, 4) for y in (-0.6, 0.0, 0.6)]


def wall() -> LayeredDepthImage:
    """A wavy wall before the cameras, painted in soft colours."""
    frame = ParallelFrame((-1.2, -1.0, 0.0), (TEXEL, 0, 0), (0, TEXEL, 0), (0, 0, 1))
    v, u = np.mgrid[:ROWS, :COLUMNS] * TEXEL
    color = np.stack([0.5 + 0.3 * np.sin(4 * u + v), 0.5 + 0.3 * np.cos(5 * v), 0.4 + 0.2 * u / 2.4], axis=2)
    normal = np.tile([0.0, 0.0, -1.0], (ROWS * COLUMNS, 1))
    depth = (1 + 0.1 * np.sin(3 * u)).ravel()
    return LayeredDepthImage(
        frame, offsets_of(np.ones((ROWS, COLUMNS), int)), depth, color.reshape(-1, 3), normal,
        np.full(len(depth), 3, np.int32),
    )  # fmt: skip


def seen_from(x: float, y: float) -> tuple[Camera, np.ndarray]:
    """A picture of the wall, display code, under a shade that moves with the camera."""
    camera = Camera.look_at((x, y, -3), (0, 0, 1), up=(0, -1, 0), fov_y_deg=24, width=64, height=48)
    code = srgb_encode(np.asarray(render(Texture(wall()), camera).color))
    return camera, np.clip(code * (1 + 0.25 * x) + 0.1 * y, 0, 1)


@pytest.fixture(scope="module")
def source(tmp_path_factory) -> Inputs:
    folder = tmp_path_factory.mktemp("kept")
    views, photos = [], []
    for number, place in enumerate(PLACES):
        camera, code = seen_from(*place)
        write_png(folder / f"{number}.png", srgb_decode(code))
        views.append(View(f"v{number}", camera, folder / f"{number}.png"))
        photos.append(KeptPhoto(camera, to_bytes(code), np.ones(code.shape[:2], bool)))
    kept = PhotoBlend(KeptPhotos(tuple(photos), blend=Blend(3)))
    write_asset(Asset((Texture(wall(), (kept,)),)), folder / "asset")
    write_views(ViewSet(tuple(views), ()), folder / "views.json")
    return Inputs(folder / "asset", folder / "views.json", folder / "out")


def compressed(source: Inputs, out: Path, **settings: object) -> tuple[dict, Asset]:
    out.mkdir()
    done = run(Inputs(source.asset, source.views, out), CompressConfig(**settings))
    return json.loads(done.compression.read_text(encoding="utf-8")), read_asset(out)


def test_photos_are_coded_anew_and_stay_one_for_all(source: Inputs, tmp_path: Path) -> None:
    told, asset = compressed(source, tmp_path / "out")
    sizes = [(folder / "photos.zip").stat().st_size for folder in (source.asset, tmp_path / "out")]
    assert sizes[1] < 0.5 * sizes[0]
    assert told["chosen"]["component_quality"] is not None
    assert told["parts"]["components"][0]["bytes"] < sizes[0]
    before = read_asset(source.asset).shared["photos"]
    after = asset.shared["photos"]
    assert after.blend == before.blend
    off = [(a.codes.astype(float) - b.codes) for a, b in zip(after.photos, before.photos, strict=True)]
    assert 0 < np.sqrt(np.mean(np.square(off))) < 12
    assert [part.kind for part in read_index(tmp_path / "out").textures[0].components] == ["photos"]


def test_a_photo_is_measured_without_itself_and_losses_count_between_photos(source: Inputs, tmp_path: Path) -> None:
    told, _ = compressed(source, tmp_path / "out", loss_db=0.5)
    assert told["psnr_before"] < 40  # by themselves they would be shown all but exactly
    assert told["psnr_between"] > told["psnr_before"] + 0.5
    added = 10 ** (-0.1 * told["chosen"]["psnr"]) - 10 ** (-0.1 * told["psnr_before"])
    allowed = 10 ** (-0.1 * (told["psnr_between"] - 0.5)) - 10 ** (-0.1 * told["psnr_between"])
    assert added <= 1.01 * allowed
    assert "between photos" in told["why"]


def test_colours_that_exports_show_are_not_given_up(source: Inputs, tmp_path: Path) -> None:
    """Photos hide them, so that they seem to cost nothing."""
    told, _ = compressed(source, tmp_path / "out", loss_db=6)
    assert told["chosen"]["layers"]["color_quality"] >= 50


def test_without_losses_photos_come_back_to_the_bit(source: Inputs, tmp_path: Path) -> None:
    _, asset = compressed(source, tmp_path / "out", lossless=True)
    for one, other in zip(asset.shared["photos"].photos, read_asset(source.asset).shared["photos"].photos, strict=True):
        np.testing.assert_array_equal(one.codes, other.codes)


def test_views_between_photos_are_foretold(source: Inputs) -> None:
    asset, measured = read_asset(source.asset), []

    def measure(changed: Asset) -> float:
        measured.append(len(changed.shared["photos"].photos))
        return 30.0 if len(measured) == 1 else 28.5

    assert between_photos(asset, measure) == pytest.approx(1.5)
    assert measured == [12, 3]
    assert between_photos(asset, lambda changed: 30.0 - len(changed.shared["photos"].photos)) == 0
    assert between_photos(asset, lambda changed: 9.0 * len(changed.shared["photos"].photos)) == 3.5
    assert between_photos(asset, lambda changed: None) == 0
    assert between_photos(Asset((Texture(wall()),)), measure) == 0
