"""The residual archive: lossless, lossy and half round trips, what other programs see, damage."""

from __future__ import annotations

import io
import json
import zipfile

import numpy as np
import pytest

from ibrpipe.core.spiral import directions
from ibrpipe.errors import FormatError, MissingFileError, ResourceError
from ibrpipe.io.residuals import NAME, continue_smoothly, image_of, read_residuals, write_residuals
from ibrpipe.types import ParallelFrame, SpiralResiduals

FRAME = ParallelFrame((0, 0, 0), (2, 0, 0), (0, 1, 0), (0, 0, 1))


def some_residuals(dtype=np.uint8, k=1 / 4, seed=50, all_valid=False):
    """Residuals of smooth colours with holes; the least image is 1 x 1."""
    rng = np.random.default_rng(seed)
    alphas = directions.table(k)
    ways = directions.directions(alphas, k)
    factors = np.array([directions.scale_factors(way) for way in ways])
    sizes = np.maximum(1, np.round(factors[:, ::-1] * (20, 30))).astype(np.int32)
    sizes[-1] = (1, 1)
    starts = np.concatenate([[0], np.cumsum(sizes.astype(np.int64).prod(axis=1))])
    texels = []
    for height, width in sizes:
        y, x = np.mgrid[:height, :width] / 20
        waves = np.stack([np.sin(3 * x + y), np.cos(2 * y), np.sin(x * y)], axis=-1).reshape(-1, 3)
        texels.append(waves if dtype == np.float32 else np.round(60 + 50 * waves))
    texels = np.concatenate(texels).astype(np.float16 if dtype == np.float32 else dtype).astype(dtype)
    valid = np.ones(len(texels), bool) if all_valid else rng.random(len(texels)) < 0.8
    return SpiralResiduals(FRAME, k, alphas, ways, sizes, starts, texels, valid, 60 if dtype == np.uint8 else 0)


def round_trip(residuals, folder, quality=100):
    back = read_residuals(write_residuals(residuals, folder, quality))
    for name in ("alphas", "directions", "sizes", "starts", "valid"):
        np.testing.assert_array_equal(getattr(back, name), getattr(residuals, name), err_msg=name)
    assert (back.k, back.zero, back.closed) == (residuals.k, residuals.zero, residuals.closed)
    np.testing.assert_array_equal(back.rectangle.world_from_local, residuals.rectangle.world_from_local)
    assert back.texels.dtype == residuals.texels.dtype
    return back


@pytest.mark.parametrize("all_valid", [True, False])
def test_lossless_is_exact(tmp_path, all_valid):
    residuals = some_residuals(all_valid=all_valid)
    back = round_trip(residuals, tmp_path)
    np.testing.assert_array_equal(back.texels[back.valid], residuals.texels[residuals.valid])


def test_lossless_noise_is_exact_too(tmp_path):
    residuals = some_residuals()
    residuals.texels[:] = np.random.default_rng(51).integers(0, 256, residuals.texels.shape)
    back = round_trip(residuals, tmp_path)
    np.testing.assert_array_equal(back.texels[back.valid], residuals.texels[residuals.valid])


def test_half_floats_are_exact(tmp_path):
    residuals = some_residuals(np.float32)
    back = round_trip(residuals, tmp_path)
    np.testing.assert_array_equal(back.texels[back.valid], residuals.texels[residuals.valid])


def test_lossy_is_smaller_and_within_bounds(tmp_path):
    residuals = some_residuals(k=1 / 16)
    size = write_residuals(residuals, tmp_path).stat().st_size
    errors = []
    for quality in (90, 50):
        back = round_trip(residuals, tmp_path, quality)
        errors.append(np.abs(back.texels[back.valid].astype(int) - residuals.texels[residuals.valid]))
        assert (tmp_path / NAME).stat().st_size < size
    assert 0 < errors[0].mean() < errors[1].mean()
    assert errors[0].mean() < 2
    assert np.percentile(errors[0], 99) < 10


def test_compact_residuals_take_less_and_are_valid_everywhere(tmp_path):
    residuals = some_residuals()
    sizes, errors = [write_residuals(residuals, tmp_path, 90).stat().st_size], []
    for quality in (85, 60, 30):
        path = write_residuals(residuals, tmp_path, quality, compact=True)
        back = read_residuals(path)
        for name in ("alphas", "directions", "sizes", "starts"):
            np.testing.assert_array_equal(getattr(back, name), getattr(residuals, name), err_msg=name)
        assert back.zero == residuals.zero
        assert back.valid.all()
        own = residuals.valid
        errors.append(float(((back.texels[own].astype(float) - residuals.texels[own]) ** 2).mean()))
        sizes.append(path.stat().st_size)
    assert sizes == sorted(sizes, reverse=True)
    assert sizes[1] < 0.7 * sizes[0]
    assert errors == sorted(errors)
    assert errors[0] < 4


def test_compact_without_loss_or_of_half_floats_is_as_ever(tmp_path):
    for residuals, quality in ((some_residuals(), 100), (some_residuals(np.float32), 50)):
        path = write_residuals(residuals, tmp_path, quality, compact=True)
        with zipfile.ZipFile(path) as archive:
            assert "residuals.avif" not in archive.namelist()
        np.testing.assert_array_equal(read_residuals(path).valid, residuals.valid)


@pytest.mark.parametrize("change", ["cut", "missing", "sizes", "negative"])
def test_damaged_compact_residuals(tmp_path, change):
    path = write_residuals(some_residuals(), tmp_path, 50, compact=True)
    with zipfile.ZipFile(path) as archive:
        parts = {name: archive.read(name) for name in archive.namelist()}
    header = json.loads(parts["residuals.json"])
    if change == "cut":
        parts["residuals.avif"] = parts["residuals.avif"][:100]
    elif change == "missing":
        del parts["residuals.avif"]
    else:
        header["sizes"][0] = [header["sizes"][0][0] + 30, 40] if change == "sizes" else [-3, 5]
    parts["residuals.json"] = json.dumps(header).encode()
    with zipfile.ZipFile(path, "w") as archive:
        for name, data in parts.items():
            archive.writestr(name, data)
    with pytest.raises(FormatError, match=r"residuals.zip: damaged") as caught:
        read_residuals(path)
    assert "\n" not in str(caught.value)


def test_the_same_residuals_give_the_same_bytes(tmp_path):
    first = write_residuals(some_residuals(), tmp_path, 90).read_bytes()
    assert write_residuals(some_residuals(), tmp_path, 90).read_bytes() == first


def test_any_zip_tool_and_picture_viewer_opens_it(tmp_path):
    PIL = pytest.importorskip("PIL.Image")
    residuals = some_residuals()
    with zipfile.ZipFile(write_residuals(residuals, tmp_path)) as archive:
        assert archive.testzip() is None
        names = archive.namelist()
        picture = np.asarray(PIL.open(io.BytesIO(archive.read("002.webp"))))
        header = json.loads(archive.read("residuals.json"))
    assert names == ["residuals.json", *(f"{i:03d}.webp" for i in range(len(residuals.sizes)))]
    texels, valid = image_of(residuals, 2)
    np.testing.assert_array_equal(picture[..., 3] > 0, valid)
    np.testing.assert_array_equal(picture[..., :3][valid], texels[valid])
    assert header["sizes"][2] == list(valid.shape)


def test_unknown_texels_are_continued_smoothly():
    rng = np.random.default_rng(52)
    valid = rng.random((17, 23)) < 0.1
    texels = np.where(valid[..., None], 100 + rng.integers(0, 20, (17, 23, 3)), 255).astype(np.uint8)
    filled = continue_smoothly(texels, valid)
    np.testing.assert_array_equal(filled[valid], texels[valid])
    assert filled.min() >= 100  # only values between the known ones appear
    assert filled.max() < 120
    nothing = np.zeros((3, 4), bool)
    np.testing.assert_array_equal(continue_smoothly(texels[:3, :4], nothing), texels[:3, :4])


def test_missing_file(tmp_path):
    with pytest.raises(MissingFileError, match=r"residuals\.zip: no such file"):
        read_residuals(tmp_path / NAME)


def test_no_such_folder(tmp_path):
    with pytest.raises(ResourceError, match="cannot write"):
        write_residuals(some_residuals(), tmp_path / "none")


@pytest.mark.parametrize("dtype", [np.uint8, np.float32])
def test_random_damage_never_ends_in_anything_but_one_clear_line(tmp_path, dtype):
    file = write_residuals(some_residuals(dtype), tmp_path)
    whole, rng, told = file.read_bytes(), np.random.default_rng(53), []
    for turn in range(150):
        damaged = bytearray(whole if turn % 3 else whole[: rng.integers(len(whole))])
        for place in rng.integers(0, max(len(damaged), 1), rng.integers(1, 20)):
            damaged[place : place + 1] = bytes([rng.integers(256)])
        file.write_bytes(bytes(damaged))
        try:
            read_residuals(file)
        except FormatError as error:
            told.append(str(error))
    assert len(told) > 120
    assert all(message.startswith(str(file)) and "\n" not in message for message in told)


def changed(file, **changes):
    """Write the archive again with other header entries."""
    with zipfile.ZipFile(file) as archive:
        parts = {name: archive.read(name) for name in archive.namelist()}
    header = json.loads(parts["residuals.json"]) | changes
    parts["residuals.json"] = json.dumps(header).encode()
    with zipfile.ZipFile(file, "w") as archive:
        for name, data in parts.items():
            archive.writestr(name, data)


@pytest.mark.parametrize(
    ("changes", "match"),
    [
        ({"schema": 2}, "schema 2, this version reads 1"),
        ({"sizes": [[3, 3]] * 17}, "damaged"),
        ({"k": 3.0}, "damaged"),
        ({"encoding": "half"}, "damaged"),
        ({"encoding": "jpeg2000"}, "jpeg2000"),
        ({"alphas": None}, "damaged"),
        ({"rectangle": {"projection": "parallel"}}, "damaged"),
    ],
)
def test_a_header_that_does_not_fit(tmp_path, changes, match):
    file = write_residuals(some_residuals(), tmp_path)
    changed(file, **changes)
    with pytest.raises(FormatError, match=match) as caught:
        read_residuals(file)
    assert str(caught.value).startswith(str(file))
