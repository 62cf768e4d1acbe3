"""Kept photos in asset folders: they come back as written, and whatever is damaged is told in one line."""

from __future__ import annotations

import json
import shutil
import zipfile
import zlib

import numpy as np
import pytest

import ibrpipe
from ibrpipe.errors import FormatError, MissingFileError, ResourceError
from ibrpipe.io.kept_photos import NAME, read_photos, write_photos
from ibrpipe.synthetic import small_asset
from ibrpipe.types import Blend, Camera, KeptPhoto, KeptPhotos


def photos(count=3, side=48):
    rng = np.random.default_rng(1)
    made = []
    for n in range(count):
        camera = Camera.look_at((n, 1, -5), (0, 0, 0), width=side + n, height=side)
        y, x = np.mgrid[:side, : side + n] / side
        codes = (
            128
            + 90 * np.stack([np.sin(5 * x + n), np.cos(4 * y), np.sin(x * y * 6)], -1)
            + rng.normal(0, 2, (*x.shape, 3))
        )
        shown = np.ones(x.shape, bool) if n == 0 else np.hypot(x - 0.5, y - 0.5) < 0.45
        made.append(KeptPhoto(camera, np.clip(codes, 0, 255).astype(np.uint8), shown))
    return KeptPhotos(tuple(made), 1.5, Blend(3, 0.75, 0.5))


def test_without_losses_all_that_shows_the_object_comes_back(tmp_path):
    before = photos()
    write_photos(before, tmp_path / NAME)
    after = read_photos(tmp_path / NAME)
    assert (after.top, after.blend, after.own) == (1.5, Blend(3, 0.75, 0.5), True)
    for one, other in zip(before.photos, after.photos, strict=True):
        np.testing.assert_array_equal(one.shown, other.shown)
        np.testing.assert_array_equal(one.codes[one.shown], other.codes[one.shown])
        np.testing.assert_array_equal(one.camera.K, other.camera.K)
        np.testing.assert_array_equal(one.camera.cam_from_world, other.camera.cam_from_world)


def test_lower_qualities_take_fewer_bytes_and_err_more(tmp_path):
    before, sizes, errors = photos(), [], []
    for quality in (100, 90, 60, 20):
        write_photos(before, tmp_path / NAME, quality)
        sizes.append((tmp_path / NAME).stat().st_size)
        after = read_photos(tmp_path / NAME)
        off = [(a.codes.astype(float) - b.codes)[a.shown] for a, b in zip(before.photos, after.photos, strict=True)]
        errors.append(float(np.sqrt((np.concatenate(off) ** 2).mean())))
        for one, other in zip(before.photos, after.photos, strict=True):
            np.testing.assert_array_equal(one.shown, other.shown)
    assert sizes == sorted(sizes, reverse=True)
    assert errors == sorted(errors)
    assert errors[0] == 0
    assert errors[-1] < 12


def test_the_same_photos_give_the_same_bytes(tmp_path):
    for name in "ab":
        write_photos(photos(), tmp_path / name, 70)
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


def test_an_asset_keeps_them_once_for_all_textures(tmp_path):
    one = small_asset.asset("photos")
    twice = ibrpipe.Asset((*one.textures, *one.textures))
    ibrpipe.write_asset(twice, tmp_path / "asset")
    assert [path.name for path in (tmp_path / "asset").rglob("*.zip")] == [NAME]
    read = ibrpipe.read_asset(tmp_path / "asset")
    assert read.kinds == ("photos",)
    assert all(each.component("photos").photos is read.shared["photos"] for each in read.textures)
    assert ibrpipe.read_asset(tmp_path / "asset").shared["photos"].photos[0].codes.flat[0] == 60


def changed(folder, name, edit):
    """Copy of the written photos in which a part is edited; None = left out."""
    write_photos(photos(), folder / "whole.zip", 80)
    with zipfile.ZipFile(folder / "whole.zip") as source, zipfile.ZipFile(folder / NAME, "w") as target:
        for entry in source.infolist():
            data = source.read(entry)
            if entry.filename == name:
                data = edit(data)
            if data is not None:
                target.writestr(entry.filename, data)
    return folder / NAME


def header(**values):
    def edit(data):
        return json.dumps(json.loads(data) | values).encode()

    return edit


def first_camera(**values):
    def edit(data):
        found = json.loads(data)
        found["cameras"][0] |= values
        return json.dumps(found).encode()

    return edit


@pytest.mark.parametrize(
    ("name", "edit"),
    [
        ("photos.json", lambda data: data[:40]),
        ("photos.json", lambda data: None),
        ("photos.json", header(schema=9)),
        ("photos.json", header(encoding="exr")),
        ("photos.json", header(top="much")),
        ("photos.json", header(top=float("nan"))),
        ("photos.json", header(blend={"photos": 1})),
        ("photos.json", header(blend={"photos": 10**9})),
        ("photos.json", header(blend={"photos": 2.5})),
        ("photos.json", header(blend={"photos": 4, "falloff": -1.0})),
        ("photos.json", header(blend={"photos": 4, "sharpness": "very"})),
        ("photos.json", header(blend={"more": 4})),
        ("photos.json", header(blend=4)),
        ("photos.json", header(cameras=[])),
        ("photos.json", first_camera(width=49)),
        ("photos.json", first_camera(width=-1)),
        ("photos.json", first_camera(width=1 << 20, height=1 << 20)),
        ("photos.json", first_camera(K=[[0] * 3] * 3)),
        ("photos.json", first_camera(projection="parallel")),
        ("0001.avif", lambda data: data[: len(data) // 2]),
        ("0001.avif", lambda data: b""),
        ("0001.avif", lambda data: None),
        ("0001.mask", lambda data: data[:10]),
        ("0001.mask", lambda data: zlib.compress(bytes(10))),
        ("0001.mask", lambda data: zlib.compress(bytes(1 << 24))),
    ],
)
def test_damage_is_one_line_that_names_the_file(tmp_path, name, edit):
    path = changed(tmp_path, name, edit)
    with pytest.raises(FormatError, match=NAME) as told:
        read_photos(path)
    assert "\n" not in str(told.value)


def test_png_of_another_size_is_refused(tmp_path):
    write_photos(photos(), tmp_path / "whole.zip")
    with zipfile.ZipFile(tmp_path / "whole.zip") as source, zipfile.ZipFile(tmp_path / NAME, "w") as target:
        for entry in source.infolist():
            other = "0000.png" if entry.filename == "0001.png" else entry.filename
            target.writestr(entry.filename, source.read(other))
    with pytest.raises(FormatError, match=r"photos\.zip.*a picture is RGB \(48, 48\), not RGB \(49, 48\)"):
        read_photos(tmp_path / NAME)


def test_what_is_missing_is_told(tmp_path):
    with pytest.raises(MissingFileError, match="should hold the photos that an asset keeps"):
        read_photos(tmp_path / NAME)
    ibrpipe.write_asset(small_asset.asset("photos"), tmp_path / "asset")
    index = json.loads((tmp_path / "asset/asset.json").read_text())
    (tmp_path / "asset/asset.json").write_text(json.dumps(index | {"shared": []}))
    with pytest.raises(FormatError, match="asks photos but the asset keeps none"):
        ibrpipe.read_asset(tmp_path / "asset")
    del index["shared"][0]["file"]
    (tmp_path / "asset/asset.json").write_text(json.dumps(index))
    with pytest.raises(FormatError, match="names no file of the photos"):
        ibrpipe.read_asset(tmp_path / "asset")


def test_a_full_disk_is_told(tmp_path):
    (tmp_path / NAME).mkdir()
    with pytest.raises(ResourceError, match="cannot write"):
        write_photos(photos(), tmp_path / NAME)
    shutil.rmtree(tmp_path / NAME)
