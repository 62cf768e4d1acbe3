"""Shared reflection in asset folders: it comes back as written, and whatever is damaged is told in one line."""

from __future__ import annotations

import json

import numpy as np
import pytest

import ibrpipe
from ibrpipe.errors import FormatError, MissingFileError, ShapeError, ValueRangeError
from ibrpipe.types import ReflectedLight, Reflection


def layers(samples=6, seed=0):
    rng = np.random.default_rng(seed)
    frame = ibrpipe.ParallelFrame(np.zeros(3), np.array([1.0, 0, 0]), np.array([0, 1.0, 0]), np.array([0, 0, 1.0]))
    offsets = np.array([np.arange(samples + 1)])
    normal = np.tile(np.array([0, 0, -1.0], np.float32), (samples, 1))
    return ibrpipe.LayeredDepthImage(frame, offsets, np.ones(samples), rng.random((samples, 3)), normal)


def asset(tables=2, weighted=True, seed=0):
    rng = np.random.default_rng(seed)
    light = ReflectedLight(4 * rng.random((tables, 12, 12, 3)) ** 4, (0.045, 0.9)[:tables], 0.8)
    parts = [Reflection(light, rng.random((6, tables)) if weighted else None) for _ in range(2)]
    return ibrpipe.Asset(tuple(ibrpipe.Texture(layers(), (part,)) for part in parts))


@pytest.mark.parametrize(("tables", "weighted"), [(1, False), (1, True), (2, True)])
def test_it_comes_back_as_written_to_a_step_of_the_code(tmp_path, tables, weighted):
    written = asset(tables, weighted)
    ibrpipe.write_asset(written, tmp_path / "asset")
    read = ibrpipe.read_asset(tmp_path / "asset")
    light, before = read.shared["reflection"], written.shared["reflection"]
    assert light.reflectance == before.reflectance
    assert light.damping == before.damping
    np.testing.assert_allclose(light.tables**0.25, before.tables**0.25, atol=0.51 / 255 * before.tables.max() ** 0.25)
    for one, other in zip(read.textures, written.textures, strict=True):
        got, want = one.component("reflection"), other.component("reflection")
        assert got.light is light
        if weighted:
            np.testing.assert_allclose(got.weights, want.weights, atol=0.51 / 255)
        else:
            assert got.weights is None
    assert light.bytes == before.tables.nbytes


def test_lossy_tables_are_smaller(tmp_path):
    for quality in (100, 50):
        ibrpipe.write_asset(asset(), tmp_path / str(quality), quality=quality)
    sizes = [(tmp_path / name / "reflection_0.webp").stat().st_size for name in ("100", "50")]
    assert sizes[1] < sizes[0]


def spoil(folder, change):
    index = json.loads((folder / "asset.json").read_text())
    change(index)
    (folder / "asset.json").write_text(json.dumps(index))


DAMAGE = {
    "tops": lambda index: index["shared"][0].update(tops="many"),
    "tops_infinite": lambda index: index["shared"][0].update(tops=[float("inf"), 1.0]),
    "one_top": lambda index: index["shared"][0].update(tops=[1.0]),
    "reflectance": lambda index: index["shared"][0].update(reflectance=[0.5]),
    "above_one": lambda index: index["shared"][0].update(reflectance=[0.5, 7.0]),
    "damping": lambda index: index["shared"][0].update(damping=None),
    "no_tables": lambda index: index["shared"][0].update(files=[]),
    "no_shared": lambda index: index.update(shared=[]),
    "no_top": lambda index: index["textures"][0]["components"][0].pop("top"),
}


@pytest.mark.parametrize("kind", DAMAGE)
def test_a_wrong_index_is_told_in_one_line(tmp_path, kind):
    ibrpipe.write_asset(asset(), tmp_path / "asset")
    spoil(tmp_path / "asset", DAMAGE[kind])
    with pytest.raises(FormatError, match=r"reflect|damping") as caught:
        ibrpipe.read_asset(tmp_path / "asset")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", ["reflection_0.webp", "texture_00/reflection_weights.npz"])
def test_damaged_and_missing_files(tmp_path, name):
    ibrpipe.write_asset(asset(), tmp_path / "asset")
    file = tmp_path / "asset" / name
    data = file.read_bytes()
    for damaged in (b"", data[: len(data) // 2], b"\0" * len(data)):
        file.write_bytes(damaged)
        with pytest.raises(FormatError, match=file.name):
            ibrpipe.read_asset(tmp_path / "asset")
    file.unlink()
    with pytest.raises(MissingFileError, match=file.name):
        ibrpipe.read_asset(tmp_path / "asset")


def test_what_no_surface_can_mirror_is_refused():
    good = np.ones((1, 4, 4, 3))
    with pytest.raises(ShapeError, match="tables must be"):
        ReflectedLight(np.ones((1, 4, 5, 3)), (0.1,))
    with pytest.raises(ShapeError, match="tables must be"):
        ReflectedLight(np.ones((3, 4, 4, 3)), (0.1, 0.2, 0.3))
    with pytest.raises(ValueRangeError, match="light"):
        ReflectedLight(-good, (0.1,))
    with pytest.raises(ValueRangeError, match="reflectance"):
        ReflectedLight(good, (1.5,))
    with pytest.raises(ShapeError, match="weights"):
        Reflection(ReflectedLight(good, (0.1,)), np.ones((5, 2)))
    with pytest.raises(ValueRangeError, match="weights"):
        Reflection(ReflectedLight(good, (0.1,)), np.full((5, 1), np.nan))
