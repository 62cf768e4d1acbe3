"""Height maps and relief folders: every kind of file gives the numbers that it holds."""

from __future__ import annotations

import os
from pathlib import Path

import cv2
import numpy as np
import pytest

from ibrpipe.errors import FormatError, MissingFileError, ShapeError, ValueRangeError
from ibrpipe.io.photos.images import write_exr
from ibrpipe.io.surfaces.relief_images import read_height, read_normals, read_relief_folder

HEIGHTS = np.random.default_rng(3).random((5, 7))


@pytest.mark.parametrize(("name", "dtype"), [("h.png", np.uint8), ("h.png", np.uint16), ("h.tif", np.uint16)])
def test_integers_span_the_range(tmp_path, name, dtype):
    full = np.iinfo(dtype).max
    codes = np.round(HEIGHTS * full).astype(dtype)
    cv2.imwrite(str(tmp_path / name), codes)
    np.testing.assert_allclose(read_height(tmp_path / name), codes / full, rtol=1e-6)
    np.testing.assert_allclose(read_height(tmp_path / name, (2.0, 5.0)), 2 + 3 * (codes / full), rtol=1e-6)


def test_floats_stay_as_they_are(tmp_path):
    heights = (HEIGHTS * 100 - 30).astype(np.float32)
    heights[1, 2] = np.nan
    write_exr(tmp_path / "h.exr", {"Z": heights})
    np.save(tmp_path / "h.npy", heights)
    np.savez(tmp_path / "h.npz", elevation=heights, dx=1.0)
    for name in ("h.exr", "h.npy", "h.npz"):
        np.testing.assert_array_equal(read_height(tmp_path / name), heights)


def test_alpha_of_zero_is_transparent(tmp_path):
    picture = np.full((4, 4, 4), 255, np.uint8)
    picture[:, :, :3] = 51
    picture[1, 2, 3] = 0
    cv2.imwrite(str(tmp_path / "h.png"), picture)
    height = read_height(tmp_path / "h.png")
    assert np.isnan(height[1, 2])
    assert np.isnan(height).sum() == 1
    np.testing.assert_allclose(height[0], 0.2, rtol=1e-6)


def test_mistakes_are_named(tmp_path):
    np.save(tmp_path / "deep.npy", np.zeros((2, 3, 4)))
    np.save(tmp_path / "far.npy", np.full((2, 3), np.inf))
    with pytest.raises(MissingFileError, match="does not exist"):
        read_height(tmp_path / "none.npy")
    with pytest.raises(FormatError, match="one real array"):
        read_height(tmp_path / "deep.npy")
    with pytest.raises(ValueRangeError, match="infinity"):
        read_height(tmp_path / "far.npy")
    with pytest.raises(ValueRangeError, match="two finite numbers"):
        read_height(tmp_path / "far.npy", (0.0, np.nan))
    with pytest.raises(MissingFileError, match="no height map"):
        read_relief_folder(tmp_path)
    with pytest.raises(MissingFileError, match="no such folder"):
        read_relief_folder(tmp_path / "none")


def test_folder_of_one_material(tmp_path):
    cv2.imwrite(str(tmp_path / "height.png"), np.round(HEIGHTS * 255).astype(np.uint8))
    cv2.imwrite(str(tmp_path / "color.png"), np.full((5, 7, 3), (0, 0, 255), np.uint8))
    cv2.imwrite(str(tmp_path / "normal_gl.png"), np.full((5, 7, 3), (255, 255, 128), np.uint8))
    relief = read_relief_folder(tmp_path)
    np.testing.assert_allclose(relief.color[2, 3], (1, 0, 0), atol=1e-6)
    np.testing.assert_allclose(relief.normal[2, 3], np.array([1 / 255, -1, 1]) / np.sqrt(2 + 1 / 255**2), atol=1e-6)
    cv2.imwrite(str(tmp_path / "color.png"), np.zeros((5, 8, 3), np.uint8))
    with pytest.raises(ShapeError, match=r"8 x 5 but height\.png is 7 x 5"):
        read_relief_folder(tmp_path)


@pytest.mark.real
@pytest.mark.skipif("IBRPIPE_DATA" not in os.environ, reason="IBRPIPE_DATA does not name the real data sets")
def test_real_relief_slopes_agree_with_their_normals():
    folder = Path(os.environ["IBRPIPE_DATA"]) / "relief/cliff_rock023"
    relief = read_relief_folder(folder)
    normal = read_normals(folder / "normal_gl.png")
    for axis, component in ((1, 0), (0, 1)):
        slope = np.gradient(relief.height, axis=axis).ravel()
        by_normal = (-normal[:, :, component] / np.maximum(normal[:, :, 2], 0.05)).ravel()
        assert np.corrcoef(slope, by_normal)[0, 1] > 0.8
