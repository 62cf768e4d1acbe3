"""Asset folders: round trip, unknown components, newer schemas, missing and damaged parts."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from ibrpipe.core.spiral import directions
from ibrpipe.errors import FormatError, MissingFileError, ResourceError
from ibrpipe.io.assets import listed_files, read_asset, read_index, write_asset
from ibrpipe.io.layer_pictures import LOSSLESS, Coding
from ibrpipe.types import Asset, LayeredDepthImage, ParallelFrame, SpiralResiduals, SpiralTexture

FRAME = ParallelFrame((0, 0, 0), (0.5, 0, 0), (0, 0.5, 0), (0, 0, 1))
EDGES = ParallelFrame((0, 0, 0), (2, 0, 0), (0, 2, 0), (0, 0, 1))


def texture(residuals=True):
    color = np.full((16, 3), 0.25)
    layers = LayeredDepthImage(
        FRAME, np.arange(4)[:, None] * 4 + np.arange(5), np.ones(16), color, color, np.ones(16, np.int32)
    )
    if not residuals:
        return SpiralTexture(layers)
    alphas = directions.table(1 / 4)
    count = len(alphas)
    return SpiralTexture(
        layers,
        SpiralResiduals(
            EDGES,
            1 / 4,
            alphas,
            directions.directions(alphas, 1 / 4),
            np.full((count, 2), 3, np.int32),
            9 * np.arange(count + 1),
            np.random.default_rng(60).integers(0, 90, (9 * count, 3)).astype(np.uint8),
            np.ones(9 * count, bool),
        ),
    )


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    write_asset(Asset((texture(), texture(residuals=False)), {"units": "metre"}), tmp_path / "asset")
    return tmp_path / "asset"


def edit(folder: Path, change) -> None:
    data = json.loads((folder / "asset.json").read_text(encoding="utf-8"))
    change(data)
    (folder / "asset.json").write_text(json.dumps(data), encoding="utf-8")


def test_round_trip(folder):
    back, wanted = read_asset(folder), texture()
    assert back.info["units"] == "metre"
    assert len(back.textures) == 2
    np.testing.assert_array_equal(back.textures[0].layers.depth, wanted.layers.depth)
    np.testing.assert_array_equal(back.textures[0].residuals.texels, wanted.residuals.texels)
    assert back.textures[1].residuals is None
    assert sorted(p.relative_to(folder).as_posix() for p in folder.rglob("*.*")) == [
        "asset.json",
        "texture_00/layers.exr",
        "texture_00/residuals.zip",
        "texture_01/layers.exr",
    ]


def test_what_is_known_survives_writing_again(folder, tmp_path):
    def rename(data):
        data["textures"][1] |= {"name": "front", "measured": {"samples": 16}}

    edit(folder, rename)
    write_asset(read_asset(folder), tmp_path / "again")
    again = read_index(tmp_path / "again")
    assert again.units == "metre"
    assert again.textures[1].name == "front"
    assert again.textures[1].measured == {"samples": 16}


def test_writing_replaces_the_old_asset_whole(folder):
    write_asset(Asset((texture(residuals=False),)), folder)
    assert len(read_asset(folder).textures) == 1
    assert not (folder / "texture_01").exists()
    assert [p.name for p in folder.parent.iterdir()] == ["asset"]


def test_files_of_others_in_an_asset_folder_stay(folder, tmp_path):
    (folder / "notes.txt").write_text("mine")
    (folder / "texture_01/mine.txt").write_text("mine")
    before = {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}
    write_asset(Asset((texture(residuals=False),)), folder)
    after = {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}
    assert after - {"asset.json", "texture_00/layers.exr"} == {"notes.txt", "texture_01/mine.txt"}
    assert len(before) > len(after)
    assert len(read_asset(folder).textures) == 1
    assert listed_files(folder) == {"asset.json", "texture_00/layers.exr"}


def test_a_folder_of_something_else_is_not_overwritten(tmp_path):
    (tmp_path / "thesis.txt").write_text("three years of work")
    with pytest.raises(ResourceError, match="holds files but no asset"):
        write_asset(Asset((texture(residuals=False),)), tmp_path)
    assert (tmp_path / "thesis.txt").is_file()


def test_the_same_asset_gives_the_same_bytes(folder, tmp_path):
    write_asset(Asset((texture(), texture(residuals=False)), {"units": "metre"}), tmp_path / "other")
    for file in folder.rglob("*.*"):
        assert (tmp_path / "other" / file.relative_to(folder)).read_bytes() == file.read_bytes()


def test_an_unknown_component_is_named_not_ignored(folder):
    edit(folder, lambda data: data["textures"][0]["components"][0].update(kind="neural", weights="w.bin"))
    assert read_index(folder).textures[0].components[0].kind == "neural"  # the index itself stays readable
    with pytest.raises(FormatError, match=r"texture_00 has a component of kind 'neural'.*use a newer ibrpipe"):
        read_asset(folder)


def test_two_spiral_components_are_refused(folder):
    edit(folder, lambda data: data["textures"][0]["components"].append(data["textures"][0]["components"][0]))
    with pytest.raises(FormatError, match="cannot render"):
        read_asset(folder)


@pytest.mark.parametrize("version", [3, 0, None, "1"])
def test_another_schema_is_refused(folder, version):
    edit(folder, lambda data: data.update(schema_version=version))
    with pytest.raises(FormatError, match=rf"version {version}; this program reads versions 1 and 2: use a newer"):
        read_index(folder)


@pytest.mark.parametrize(
    ("text", "match"),
    [
        ("", "not JSON"),
        ("{", "not JSON"),
        ("[1]", "schema version None"),
        ('{"schema_version": 1}', "textures: Field required"),
        ('{"schema_version": 1, "textures": [{"name": "a"}]}', r"textures\.0\.layers: Field required"),
    ],
)
def test_a_damaged_index(folder, text, match):
    (folder / "asset.json").write_text(text, encoding="utf-8")
    with pytest.raises(FormatError, match=match) as caught:
        read_index(folder)
    assert str(caught.value).startswith(str(folder / "asset.json"))
    assert "\n" not in str(caught.value)


def test_an_index_that_is_no_text(folder):
    (folder / "asset.json").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(FormatError, match="not JSON"):
        read_index(folder)


@pytest.mark.parametrize("part", ["asset.json", "texture_00/layers.exr", "texture_00/residuals.zip"])
def test_a_missing_part_is_named(folder, part):
    (folder / part).unlink()
    with pytest.raises(MissingFileError, match=Path(part).name):
        read_asset(folder)


def test_no_such_folder(tmp_path):
    with pytest.raises(MissingFileError, match="give the folder that does"):
        read_asset(tmp_path / "none")


def test_a_place_that_cannot_be_written(tmp_path):
    (tmp_path / "file").write_text("x")
    with pytest.raises(ResourceError, match="cannot write the asset"):
        write_asset(Asset((texture(residuals=False),)), tmp_path / "file" / "asset")


def test_a_copied_asset_needs_nothing_else(folder, tmp_path):
    shutil.copytree(folder, tmp_path / "elsewhere" / "träger")
    shutil.rmtree(folder)
    assert len(read_asset(tmp_path / "elsewhere" / "träger").textures) == 2


#: an index as ibrpipe 0.1.0 wrote it before components could have several files or share anything
EARLIER = """{
 "schema_version": 1,
 "generator": "ibrpipe 0.1.0",
 "units": "metre",
 "axes": "world axes of the capture, right-handed",
 "color_space": "lin_rec709_scene",
 "textures": [
  {
   "name": "+x",
   "layers": "texture_00/layers.exr",
   "components": [
    {
     "kind": "spiral",
     "file": "texture_00/residuals.zip"
    }
   ],
   "measured": {
    "layers": {
     "name": "+x",
     "samples": 16
    },
    "residuals": null
   }
  },
  {
   "name": "-x",
   "layers": "texture_01/layers.exr",
   "components": [],
   "measured": {}
  }
 ],
 "provenance": {
  "photos": [
   "a.jpg"
  ]
 }
}"""


def test_an_asset_of_an_earlier_version_is_read_and_written_as_it_was(folder, tmp_path):
    (folder / "asset.json").write_text(EARLIER, encoding="utf-8")
    back = read_asset(folder)
    np.testing.assert_array_equal(back.textures[0].residuals.texels, texture().residuals.texels)
    assert [t.component("spiral") is not None for t in back.textures] == [True, False]
    assert back.info["textures"][0]["measured"]["layers"]["samples"] == 16
    write_asset(back, tmp_path / "again")
    for file in folder.rglob("*.*"):
        assert (tmp_path / "again" / file.relative_to(folder)).read_bytes() == file.read_bytes()


def test_an_index_of_a_later_version_may_say_more(folder):
    edit(folder, lambda data: data.update(color="red"))
    assert read_index(folder).units == "metre"


def test_a_spiral_without_a_file_is_named(folder):
    edit(folder, lambda data: data["textures"][0]["components"][0].pop("file"))
    with pytest.raises(FormatError, match="a component of kind 'spiral' names no file"):
        read_asset(folder)


@pytest.mark.parametrize("coding", [LOSSLESS, Coding(color_quality=90, depth_step=0.1, normal_bits=8)])
def test_compact_layers_are_named_and_read(tmp_path, coding):
    write_asset(Asset((texture(), texture(residuals=False))), tmp_path / "asset", coding=coding)
    index = read_index(tmp_path / "asset")
    assert index.schema_version == 2
    assert [entry.coding for entry in index.textures] == [coding, coding]
    assert index.textures[0].layers == "texture_00/layers.zip"
    back = read_asset(tmp_path / "asset")
    np.testing.assert_array_equal(back.textures[0].layers.depth, texture().layers.depth)
    np.testing.assert_array_equal(back.textures[0].residuals.texels, texture().residuals.texels)


def test_an_asset_of_deep_openexr_says_what_it_said_before(folder):
    data = json.loads((folder / "asset.json").read_text(encoding="utf-8"))
    assert data["schema_version"] == 1
    assert "coding" not in data["textures"][0]
