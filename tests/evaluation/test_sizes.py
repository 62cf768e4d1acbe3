"""Bytes of an asset by its parts and by kinds of view dependence, whatever its files are called."""

from __future__ import annotations

from pathlib import Path

from ibrpipe.evaluation.sizes import bytes_of, view_dependence_bytes
from ibrpipe.io.assets import AssetIndex, TextureEntry, write_index
from ibrpipe.io.components import Component
from ibrpipe.io.manifest import Manifest, write_manifest


def made(folder: Path) -> Path:
    """An asset folder of known sizes; what is in the files does not matter."""
    sizes = {
        "t0/layers.exr": 100,
        "t1/layers.exr": 20,
        "t0/spiral.zip": 7,
        "t1/a": 3,
        "t1/b": 4,
        "book": 50,
        "note": 11,
    }
    for name, count in sizes.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(bytes(count))
    spiral, tint = Component(kind="spiral", file="t0/spiral.zip"), Component(kind="tint", files=("t1/a", "t1/b"))
    textures = [
        TextureEntry(name="+x", layers="t0/layers.exr", components=[spiral]),
        TextureEntry(name="-x", layers="t1/layers.exr", components=[tint]),
    ]
    write_index(AssetIndex(textures=textures, shared=[Component(kind="tint", file="book")]), folder)
    write_manifest(
        folder,
        Manifest(
            stage="compress", key="", config={}, inputs={}, upstream={}, code="", versions={}, files=sizes, seconds=0.0,
            peak_memory_bytes=None,
        ),
    )  # fmt: skip
    (folder / "film of a holiday.mp4").write_bytes(bytes(5000))  # not ours: it counts nowhere
    return folder


def test_bytes_by_kind(tmp_path: Path) -> None:
    assert view_dependence_bytes(made(tmp_path)) == {"spiral": 7, "tint": 57}


def test_parts_add_up(tmp_path: Path) -> None:
    folder = made(tmp_path / "asset")
    found = bytes_of(folder, (), tmp_path / "none.ply")
    index = (folder / "asset.json").stat().st_size
    assert {name: found[name] for name in ("layers", "residuals", "asset_other")} == {
        "layers": 120,
        "residuals": 64,
        "asset_other": 11 + index,
    }
    assert found["asset"] == 120 + 64 + 11 + index
    assert (found["photos"], found["masks"], found["mesh"]) == (0, 0, 0)


def test_an_asset_without_view_dependence(tmp_path: Path) -> None:
    write_index(AssetIndex(textures=[]), tmp_path)
    assert view_dependence_bytes(tmp_path) == {}
    assert bytes_of(tmp_path, (), tmp_path / "none.ply")["residuals"] == 0
