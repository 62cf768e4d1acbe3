"""Prefiltered slices on disk: what is written is read again, and damage is told."""

from __future__ import annotations

import json
import zipfile

import numpy as np
import pytest

import ibrpipe
from ibrpipe.errors import FormatError, MissingFileError
from ibrpipe.io.prerendered import NAME, PICTURE, SLABS, read_prerendered, write_prerendered
from ibrpipe.renderers.hierarchical.prefiltering import Slicing
from ibrpipe.synthetic.instanced.forest import forest, forest_cameras
from ibrpipe.types.prerendered import PrerenderedScene


@pytest.fixture(scope="module")
def made():
    return ibrpipe.prerender(forest(3), Slicing(7, 6.0, 2, 8))


@pytest.fixture
def folder(made, tmp_path):
    write_prerendered(made.library, tmp_path / "slices")
    return tmp_path / "slices"


def test_what_is_written_is_read(made, folder):
    read = read_prerendered(folder)
    for name in ("spheres", "resolutions", "axes", "stacks", "slabs", "heights", "means", "texels", "overlaps"):
        np.testing.assert_array_equal(getattr(read, name), getattr(made.library, name))
    assert read.names == made.library.names
    assert read.scale == made.library.scale
    assert read.info["leaks"] == made.library.info["leaks"]
    camera = forest_cameras(3, 64, 48)["far"]
    one = ibrpipe.render(made, camera, "hierarchical")
    other = ibrpipe.render(PrerenderedScene(made.scene, read), camera, "hierarchical")
    assert one.color.tobytes() == other.color.tobytes()


def test_the_same_slices_are_the_same_bytes(made, folder, tmp_path):
    write_prerendered(made.library, tmp_path / "again")
    assert (tmp_path / "again" / PICTURE).read_bytes() == (folder / PICTURE).read_bytes()


@pytest.mark.parametrize("name", [NAME, PICTURE, SLABS])
def test_a_missing_file_is_named(folder, name):
    (folder / name).unlink()
    with pytest.raises(MissingFileError, match=name):
        read_prerendered(folder)


@pytest.mark.parametrize("name", [NAME, PICTURE, SLABS])
def test_a_damaged_file_is_named(folder, name):
    content = (folder / name).read_bytes()
    (folder / name).write_bytes(content[: len(content) // 2])
    with pytest.raises(FormatError, match=name):
        read_prerendered(folder)


@pytest.mark.parametrize(
    ("column", "value"), [(0, -1), (2, 0), (2, 10**9), (4, 3), (5, 1), (6, 2)],
    ids=["u", "no width", "wide", "first", "bordered", "part"],
)  # fmt: skip
def test_slabs_that_point_elsewhere_are_refused(folder, column, value):
    with np.load(folder / SLABS) as archive:
        arrays = dict(archive)
    arrays["slabs"][0, column] = value
    np.savez_compressed(folder / SLABS, **arrays)
    with pytest.raises(FormatError, match="does not fit its document"):
        read_prerendered(folder)


def test_counts_of_the_document_are_checked(folder):
    document = json.loads((folder / NAME).read_text())
    for key, value in (("texels", 10**9), ("directions", 8), ("slabs", 3)):
        (folder / NAME).write_text(json.dumps(document | {key: value}))
        with pytest.raises(FormatError):
            read_prerendered(folder)


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("resolutions", [0, 4, 8], "greater than or equal to 1"),
        ("resolutions", [2, 4, 8192], "less than or equal to 4096"),
        ("resolutions", [4, 2, 8], "do not ascend"),
        ("resolutions", [], "at least 1 item"),
        ("directions", 10**12, "less than or equal to 65536"),
    ],
)
def test_numbers_of_the_document_have_bounds(folder, key, value, message):
    document = json.loads((folder / NAME).read_text())
    (folder / NAME).write_text(json.dumps(document | {key: value}))
    with pytest.raises(FormatError, match=f"{NAME}.*{message}"):
        read_prerendered(folder)


def test_slices_of_an_earlier_version_are_told_as_such(folder):
    path = folder / "prerendered.json"
    path.write_text(path.read_text().replace('"schema_version": 2', '"schema_version": 1'))
    with pytest.raises(FormatError, match=r"prerendered\.json: .*schema_version.*prerender"):
        read_prerendered(folder)


def test_names_of_parts_differ(folder):
    document = json.loads((folder / NAME).read_text())
    document["parts"][1]["name"] = document["parts"][0]["name"]
    (folder / NAME).write_text(json.dumps(document))
    with pytest.raises(FormatError, match="two parts have one name"):
        read_prerendered(folder)


def test_an_archive_that_claims_more_than_it_holds_is_told(folder):
    header = b"{'descr': '<i8', 'fortran_order': False, 'shape': (100000000000, 7), }"
    header += b" " * (117 - len(header)) + b"\n"
    with zipfile.ZipFile(folder / SLABS, "w") as archive:
        for name in ("stacks", "slabs", "heights", "means"):
            archive.writestr(f"{name}.npy", b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header)
    with pytest.raises(FormatError, match=f"{SLABS}.*prerender the scene again"):
        read_prerendered(folder)
