"""Prefiltered slices on disk: what is written is read again, and damage is told."""

from __future__ import annotations

import json
import zipfile
from dataclasses import replace

import numpy as np
import pytest

import ibrpipe
from ibrpipe.errors import FormatError, MissingFileError
from ibrpipe.io.prerendered import NAME, PICTURE, SLABS, VIEWS, read_prerendered, write_prerendered
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
    np.testing.assert_array_equal(read.views.firsts, made.library.views.firsts)
    np.testing.assert_array_equal(read.views.places, made.library.views.places)
    for name in ("albedo", "normals"):
        np.testing.assert_allclose(getattr(read.views, name), getattr(made.library.views, name), atol=5e-4)
    camera = forest_cameras(3, 64, 48)["far"]
    for mode in ("slices", "reproject"):
        one = ibrpipe.render(made, camera, "hierarchical", mode=mode)
        other = ibrpipe.render(PrerenderedScene(made.scene, read), camera, "hierarchical", mode=mode)
        assert one.alpha.tobytes() == other.alpha.tobytes()
        np.testing.assert_allclose(one.color, other.color, atol=0.0 if mode == "slices" else 2e-3)


def test_both_forms_are_told_with_bytes_seconds_and_errors(made, folder):
    document = json.loads((folder / NAME).read_text())
    assert document["views_bytes"] == (folder / VIEWS).stat().st_size > 0
    assert document["views_seconds"] > 0
    assert sum(part["samples"] for part in document["parts"]) == len(made.library.views.places) > 0
    for part in document["parts"]:
        assert part["slices"]["psnr"] > part["views"]["psnr"] > 5
        assert 0 < part["slices"]["coverage"] < 1
        assert 0 < part["views"]["coverage"] < 1


def test_slices_alone_are_written_and_read(made, folder):
    write_prerendered(replace(made.library, views=None, info={}), folder)
    assert not (folder / VIEWS).exists()
    read = read_prerendered(folder)
    assert read.views is None
    camera = forest_cameras(3, 64, 48)["far"]
    frame = ibrpipe.render(PrerenderedScene(made.scene, read), camera, "hierarchical", mode="reproject")
    assert frame.alpha.max() == 1.0


@pytest.mark.parametrize(("samples", "value"), [(10**7, None), (None, np.nan), (None, -1.0)])
def test_views_that_hold_nonsense_are_told(made, folder, samples, value):
    if samples is not None:
        document = json.loads((folder / NAME).read_text())
        document["parts"][0]["samples"] = samples
        (folder / NAME).write_text(json.dumps(document))
    else:
        albedo = made.library.views.albedo.copy()
        albedo[0, 1] = value
        write_prerendered(replace(made.library, views=replace(made.library.views, albedo=albedo)), folder)
    with pytest.raises(FormatError, match=VIEWS):
        read_prerendered(folder)


def test_the_same_slices_are_the_same_bytes(made, folder, tmp_path):
    write_prerendered(made.library, tmp_path / "again")
    assert (tmp_path / "again" / PICTURE).read_bytes() == (folder / PICTURE).read_bytes()


@pytest.mark.parametrize("name", [NAME, PICTURE, SLABS, VIEWS])
def test_a_missing_file_is_named(folder, name):
    (folder / name).unlink()
    with pytest.raises(MissingFileError, match=name):
        read_prerendered(folder)


@pytest.mark.parametrize("name", [NAME, PICTURE, SLABS, VIEWS])
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
    path.write_text(path.read_text().replace('"schema_version": 3', '"schema_version": 2'))
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
