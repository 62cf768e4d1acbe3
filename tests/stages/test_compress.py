"""The compress stage on a hand-made asset and noisy photos of it: targets, losses, what is told."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError

from ibrpipe.cli.describe import describe
from ibrpipe.core.color import srgb_decode, srgb_encode
from ibrpipe.core.spiral import directions
from ibrpipe.errors import FormatError
from ibrpipe.io.assets import read_asset, read_index, write_asset
from ibrpipe.io.documents.texture_errors import TextureErrors
from ibrpipe.io.photos.images import write_png
from ibrpipe.io.views import View, ViewSet, read_views, write_views
from ibrpipe.renderers.api import render
from ibrpipe.stages.compress import CompressConfig, Inputs, run
from ibrpipe.types import Asset, Camera, LayeredDepthImage, ParallelFrame, SpiralResiduals, SpiralTexture

HEIGHT, WIDTH, TEXEL = 60, 72, 1 / 30
EDGES = ParallelFrame((-1.2, -1.0, 0.0), (2.4, 0, 0), (0, 2.0, 0), (0, 0, 1))


def wall() -> LayeredDepthImage:
    """A wavy wall before the cameras, painted in soft colours with a little grain."""
    frame = ParallelFrame((-1.2, -1.0, 0.0), (TEXEL, 0, 0), (0, TEXEL, 0), (0, 0, 1))
    offsets = np.arange(HEIGHT)[:, None] * WIDTH + np.arange(WIDTH + 1)
    v, u = np.mgrid[:HEIGHT, :WIDTH] * TEXEL
    depth = (1 + 0.1 * np.sin(3 * u)).ravel()
    soft = np.stack([0.5 + 0.3 * np.sin(4 * u + v), 0.5 + 0.3 * np.cos(5 * v), 0.4 + 0.2 * u / 2.4], axis=2)
    grain = np.random.default_rng(8).normal(0, 0.03, soft.shape)
    color = srgb_decode(np.round(255 * np.clip(soft + grain, 0, 1)) / 255)
    normal = np.stack([0.3 * np.cos(3 * u), np.zeros_like(u), -np.ones_like(u)], axis=2)
    normal /= np.linalg.norm(normal, axis=2, keepdims=True)
    count = HEIGHT * WIDTH
    return LayeredDepthImage(
        frame, offsets, depth, color.reshape(-1, 3), normal.reshape(-1, 3), np.full(count, 3, np.int32)
    )


def gloss() -> SpiralResiduals:
    alphas, side = directions.table(1 / 4), 24
    count = len(alphas)
    texels = np.random.default_rng(60).integers(20, 60, (side * side * count, 3)).astype(np.uint8)
    return SpiralResiduals(
        EDGES, 1 / 4, alphas, directions.directions(alphas, 1 / 4), np.full((count, 2), side, np.int32),
        side * side * np.arange(count + 1), texels, np.ones(len(texels), bool),
    )  # fmt: skip


@pytest.fixture
def inputs(tmp_path: Path) -> Inputs:
    asset = Asset((SpiralTexture(wall(), gloss()), SpiralTexture(replace(wall(), depth=wall().depth + 1))))
    write_asset(asset, tmp_path / "asset")
    rng, views = np.random.default_rng(9), []
    for i, x in enumerate((-0.5, 0.0, 0.4)):
        camera = Camera.look_at((x, 0, -3), (x, 0, 1), up=(0, -1, 0), fov_y_deg=20, width=64, height=48)
        seen = srgb_encode(np.asarray(render(asset, camera).color))
        write_png(tmp_path / f"{i}.png", srgb_decode(np.clip(seen + rng.normal(0, 0.02, seen.shape), 0, 1)))
        views.append(View(f"v{i}", camera, tmp_path / f"{i}.png"))
    write_views(ViewSet(tuple(views), ()), tmp_path / "views.json")
    (tmp_path / "out").mkdir()
    return Inputs(tmp_path / "asset", tmp_path / "views.json", tmp_path / "out")


def told(inputs: Inputs, **settings: object) -> dict:
    outputs = run(inputs, CompressConfig(**settings))
    return json.loads(outputs.compression.read_text(encoding="utf-8"))


def test_by_itself_it_loses_no_more_than_is_allowed(inputs: Inputs) -> None:
    found = told(inputs, loss_db=0.5)
    assert found["psnr_before"] == pytest.approx(34, abs=0.5)  # noise of 0.02
    assert found["psnr_before"] - 0.5 <= found["chosen"]["psnr"] < found["psnr_before"] + 0.1
    assert found["chosen"]["bytes"] < 0.7 * found["bytes_before"]
    assert "loses at most 0.5 dB" in found["why"]
    coarser = [trial for trial in found["trials"] if trial["bytes"] < found["chosen"]["bytes"]]
    assert all(trial["psnr"] < found["psnr_before"] - 0.5 for trial in coarser)


def test_settings_that_need_photos_are_told_of_where_no_photo_shows_the_asset(inputs: Inputs, caplog) -> None:
    held_out = tuple(replace(view, held_out=True) for view in read_views(inputs.views).train)
    write_views(ViewSet((), held_out), inputs.views)
    assert "every bit is kept" in told(inputs, joined_texels=1)["why"]
    assert not caplog.records
    shutil.rmtree(inputs.out)
    inputs.out.mkdir()
    assert told(inputs, target_mb=0.01, color_quality=50)["chosen"]["psnr"] is None
    (line,) = [record.getMessage() for record in caplog.records]
    assert line.startswith(str(inputs.asset))
    assert line.endswith("every bit is kept, whatever target_mb, color_quality may say")


def test_the_asset_says_how_it_is_coded_and_what_that_lost(inputs: Inputs) -> None:
    found, coded = told(inputs, loss_db=6, component_quality=80), read_asset(inputs.out).textures
    index = read_index(inputs.out)
    assert index.schema_version == 2
    assert index.provenance["compression"]["psnr"] == found["chosen"]["psnr"]
    for entry, before, after in zip(index.textures, read_asset(inputs.asset).textures, coded, strict=True):
        assert entry.coding is not None
        assert entry.coding.model_dump() == found["chosen"]["layers"]
        lost = entry.measured["coding"]
        worst = np.abs(after.layers.depth - before.layers.depth).max()
        assert lost["bytes"] < lost["bytes_before"]
        assert lost["depth_error_max"] == pytest.approx(worst, rel=0.01)
        assert 20 < lost["color_psnr"] < 60
    assert len(coded[0].components) == 1
    shown = describe(inputs.out)["coding"]["texture_00"]
    assert shown["color_quality"] == found["chosen"]["layers"]["color_quality"]
    assert shown["color_psnr"] == index.textures[0].measured["coding"]["color_psnr"]
    assert "coding" not in describe(inputs.asset)


def test_the_asset_says_what_error_to_expect(inputs: Inputs) -> None:
    told(inputs, loss_db=0.5)
    for entry in read_index(inputs.out).textures:
        errors = TextureErrors.model_validate(entry.measured["error"])
        assert errors.measured_on == "training photos"
        assert (errors.coverage, errors.confidence) == (1, pytest.approx(3 / 5))
    first = read_index(inputs.out).textures[0].measured["error"]
    assert 0.02 * 255 < first["color_rms"] < 0.03 * 255  # the photos' noise, and what is lost
    shown = describe(inputs.out)["errors"]["texture_00"]
    assert shown["color_rms"] == first["color_rms"]
    assert shown["worst_tile_color_rms"] >= first["color_rms"]


@pytest.mark.parametrize("share", [0.7, 0.3, 0.1])
def test_a_size_is_kept(inputs: Inputs, share: float) -> None:
    whole = sum(path.stat().st_size for path in inputs.asset.rglob("*") if path.is_file())
    found = told(inputs, target_mb=share * whole / 1e6)
    assert sum(path.stat().st_size for path in inputs.out.rglob("*") if path.is_file()) <= share * whole
    assert f"at most {share * whole / 1e6:g} MB" in found["why"]


def test_little_of_a_size_is_left(inputs: Inputs) -> None:
    found = told(inputs, target_mb=0.026)
    assert 13_000 < found["chosen"]["bytes"] <= 26_000
    assert len(found["trials"]) <= 7


def test_what_parts_weigh_and_cost_is_told(inputs: Inputs) -> None:
    parts = told(inputs)["parts"]
    assert set(parts) == {"color", "depth", "normal", "components"}
    for levels in parts.values():
        sizes = [level["bytes"] for level in levels]
        assert sizes == sorted(sizes, reverse=True)
        assert min(sizes) > 0
    assert parts["components"][-1]["psnr_change"] < parts["components"][0]["psnr_change"] < 0


def test_a_quality_is_kept(inputs: Inputs) -> None:
    found = told(inputs, target_db=31)
    assert found["chosen"]["psnr"] >= 31
    assert found["chosen"]["bytes"] <= told(inputs, loss_db=0.3)["chosen"]["bytes"]


def test_what_cannot_be_kept_is_told(inputs: Inputs) -> None:
    assert "even the coarsest coding is larger" in told(inputs, target_mb=1e-4)["why"]
    found = told(inputs, target_db=60)
    assert "even without losses" in found["why"]
    assert found["chosen"]["layers"] == {}


def test_lossless_is(inputs: Inputs) -> None:
    told(inputs, lossless=True)
    for before, after in zip(read_asset(inputs.asset).textures, read_asset(inputs.out).textures):
        for name in ("offsets", "depth", "color", "normal", "observers"):
            assert getattr(after.layers, name).tobytes() == getattr(before.layers, name).tobytes()
        for old, new in zip(before.components, after.components, strict=True):
            assert isinstance(old, SpiralResiduals)
            assert isinstance(new, SpiralResiduals)
            np.testing.assert_array_equal(new.texels, old.texels)


def test_given_settings_are_taken(inputs: Inputs) -> None:
    found = told(inputs, color_quality=70, normal_bits=9, component_quality=30)
    chosen = found["chosen"]
    assert {trial["layers"]["color_quality"] for trial in [chosen, *found["trials"]]} == {70}
    assert {trial["layers"]["normal_bits"] for trial in [chosen, *found["trials"]]} == {9}
    assert {trial["component_quality"] for trial in [chosen, *found["trials"]]} == {30}


def test_the_same_inputs_give_the_same_bytes(inputs: Inputs, tmp_path: Path) -> None:
    run(inputs, CompressConfig())
    (tmp_path / "again").mkdir()
    run(replace(inputs, out=tmp_path / "again"), CompressConfig())
    for file in inputs.out.rglob("*.*"):
        assert (tmp_path / "again" / file.relative_to(inputs.out)).read_bytes() == file.read_bytes()


@pytest.mark.parametrize(
    "settings",
    [{"lossless": True, "target_mb": 1.0}, {"target_mb": 1, "target_db": 30}, {"lossless": True, "normal_bits": 8}],
)
def test_settings_that_contradict_each_other(settings: dict) -> None:
    with pytest.raises(ValidationError, match="give one"):
        CompressConfig(**settings)


@pytest.mark.parametrize("path", ["../other.zip", "/etc/passwd", "a\\..\\..\\b.zip", "C:/x.zip"])
def test_a_name_that_leads_out_of_the_asset_is_refused(inputs: Inputs, path: str) -> None:
    file = inputs.asset / "asset.json"
    data = json.loads(file.read_text(encoding="utf-8"))
    data["textures"][0]["components"][0]["file"] = path
    file.write_text(json.dumps(data), encoding="utf-8")
    with pytest.raises(FormatError, match="leads out of"):
        run(inputs, CompressConfig())


def test_texels_are_joined_where_a_size_cannot_be_kept_otherwise(inputs: Inputs) -> None:
    found = told(inputs, target_mb=0.0095)
    assert found["joined_texels"] > 1
    assert sum(path.stat().st_size for path in inputs.out.rglob("*") if path.is_file()) <= 9500
    edge = found["joined_texels"]
    assert read_asset(inputs.out).textures[0].layers.shape == (-(-HEIGHT // edge), -(-WIDTH // edge))
    assert f"{edge} x {edge} texels are joined" in found["why"]
    assert read_index(inputs.out).textures[0].measured["coding"]["joined_texels"] == edge
    assert told(inputs, joined_texels=2, loss_db=20)["joined_texels"] == 2
