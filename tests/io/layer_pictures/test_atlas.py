"""Atlases and AVIF pictures of samples, and normals told as differences from those that depth gives."""

from __future__ import annotations

import numpy as np
import pytest

from ibrpipe.errors import FormatError
from ibrpipe.io.layer_pictures.atlas import Atlas
from ibrpipe.io.layer_pictures.avif import LONGEST, decode_avif, encode_avif
from ibrpipe.io.layer_pictures.derived_normals import derived_normals
from ibrpipe.io.layer_pictures.normal_pictures import differences, normals_of
from ibrpipe.io.layer_pictures.planes import Plane, planes_of
from ibrpipe.types import Camera, ParallelFrame
from ibrpipe.types.layers import offsets_of

SLANTED = ParallelFrame((1, 2, 3), (0.1, 0.02, 0), (0, 0.1, 0.03), np.array((0.1, -0.2, 1.0)) / np.sqrt(1.05))
CAMERA = Camera.look_at((1, 2, -5), (0, 0, 0), width=17, height=11)


def planes(seed: int = 0, height: int = 11, width: int = 17) -> list[Plane]:
    counts = np.random.default_rng(seed).integers(0, 4, (height, width))
    return planes_of(offsets_of(counts))


@pytest.mark.parametrize("numbers", [1, 2, 3])
def test_what_is_spread_is_gathered(numbers: int) -> None:
    own = planes()
    count = sum(len(plane.samples) for plane in own)
    codes = np.random.default_rng(1).integers(0, 256, (count, numbers)).astype(np.uint8)
    atlas = Atlas(own, numbers)
    picture = atlas.spread(codes)
    assert picture.shape == atlas.shape
    np.testing.assert_array_equal(atlas.gather(picture), codes)


def test_colours_and_the_gaps_between() -> None:
    own = planes()
    count = sum(len(plane.samples) for plane in own)
    picture = Atlas(own).spread(np.full((count, 3), (10, 200, 30), np.uint8))
    assert (picture == (10, 200, 30)).all()


def test_boxes_do_not_overlap() -> None:
    own = planes(3)
    atlas = Atlas(own, 2)
    taken = np.zeros(atlas.shape, int)
    for _, _, window in atlas._windows():
        taken[window] += 1
    assert taken.max() == 1


def test_an_empty_texture_and_one_that_is_too_long() -> None:
    empty = Atlas([])
    codes = empty.gather(decode_avif(encode_avif(empty.spread(np.zeros((0, 3), np.uint8)), 50), (*empty.shape, 3)))
    assert codes.shape == (0, 3)
    wide = Plane(np.ones((1, LONGEST + 1), bool), (slice(0, 1), slice(0, LONGEST + 1)), np.arange(LONGEST + 1))
    assert not Atlas([wide]).fits


def test_quality_costs_bytes_and_buys_exactness() -> None:
    v, u = np.mgrid[:64, :48]
    picture = np.stack([u * 4, v * 3, 128 + 60 * np.sin(u / 3)], axis=2).astype(np.uint8)
    sizes, errors = [], []
    for quality in (90, 60, 30):
        data = encode_avif(picture, quality)
        assert data == encode_avif(picture, quality)
        back = decode_avif(data, picture.shape)
        sizes.append(len(data))
        errors.append(float(((back.astype(float) - picture) ** 2).mean()))
    assert sizes == sorted(sizes, reverse=True)
    assert errors == sorted(errors)
    assert errors[0] < 4


def test_damaged_and_other_pictures() -> None:
    data = encode_avif(np.zeros((20, 30), np.uint8), 50)
    for wrong in (b"", data[:40], data[: len(data) - 8], b"\0" * 100, data.replace(b"ftyp", b"ftyq")):
        with pytest.raises(FormatError, match="picture is damaged"):
            decode_avif(wrong, (20, 30))
    for shape in ((30, 20), (20, 30, 3)):
        with pytest.raises(FormatError, match="belongs there"):
            decode_avif(data, shape)


@pytest.mark.parametrize("frame", [SLANTED, CAMERA])
def test_normals_come_back_within_a_step_of_the_code(frame: ParallelFrame | Camera) -> None:
    own, rng = planes(), np.random.default_rng(4)
    count = sum(len(plane.samples) for plane in own)
    derived = derived_normals(frame, 2 + 0.01 * rng.random(count), own)
    normal = derived + rng.normal(0, 0.2, (count, 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    back = normals_of(differences(normal, derived, frame), derived, frame)
    np.testing.assert_allclose(np.linalg.norm(back, axis=1), 1, atol=1e-6)
    angle = np.degrees(np.arccos(np.clip((back * normal).sum(axis=1), -1, 1)))
    assert angle.max() < 1.0


def test_no_difference_is_exact_and_the_unknown_counts_as_none() -> None:
    rng = np.random.default_rng(5)
    derived = rng.normal(size=(50, 3))
    derived /= np.linalg.norm(derived, axis=1, keepdims=True)
    normal = derived.copy()
    normal[7] = np.nan
    codes = differences(normal, derived, SLANTED)
    assert (codes == 128).all()
    np.testing.assert_allclose(normals_of(codes, derived, SLANTED), derived, atol=1e-6)
