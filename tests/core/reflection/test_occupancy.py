"""Voxels that rays may cross freely, against plain searches of all cubes; where a patch lies and reaches."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from ibrpipe.core.reflection.occupancy import WIDEST, measure_free, outline_patch, reach_of


def free_cube(cells: np.ndarray, cones: np.ndarray, signs: tuple[int, int, int], start: tuple[int, int, int]) -> int:
    """Width of the widest cube from `start` on, along `signs`, in which no voxel hinders; grids end freely."""
    width = 0
    while width < WIDEST:
        for step in itertools.product(range(width + 1), repeat=3):
            at = tuple(a + s * k for a, s, k in zip(start, signs, step))
            if any(a < 0 or a >= n for a, n in zip(at, cells.shape)):
                continue
            voxel = cells[at]
            if voxel >= 0 and not min(s * c for s, c in zip(signs, cones[voxel][:3])) > cones[voxel][3]:
                return width
        width += 1
        if width > max(cells.shape):
            return WIDEST
    return width


@pytest.mark.parametrize("seed", range(4))
def test_free_cubes_are_those_of_a_plain_search(seed: int) -> None:
    rng = np.random.default_rng(seed)
    cells = np.full((5, 4, 3), -1, np.int32)
    taken = rng.permutation(cells.size)[:9]
    cells.ravel()[taken] = np.arange(9)
    axes = rng.normal(size=(9, 3))
    cones = np.c_[axes / np.linalg.norm(axes, axis=1, keepdims=True), rng.choice([0.05, 0.3, 2.0], 9)]
    found = np.zeros((8, *cells.shape), np.uint8)
    measure_free(cells, cones, found)
    for octant in range(8):
        signs = (1 - 2 * (octant & 1), 1 - (octant & 2), 1 - 2 * (octant >> 2))
        for at in np.ndindex(cells.shape):
            assert found[octant][at] == free_cube(cells, cones, signs, at), (octant, at)
    assert (found == 0).any()
    assert (found == WIDEST).any()


def test_a_patch_of_a_parallel_frame_lies_where_its_corners_are() -> None:
    place = np.eye(4)  # field coordinates are world coordinates, depth along z
    points, normals = np.empty((4, 3)), np.empty((4, 3))
    corners = np.array([1.0, 1.5, 2.0, 3.0], np.float32)
    assert outline_patch(place, np.linalg.inv(place), 5, 7, corners, points, normals)
    np.testing.assert_allclose(points, [(5, 7, 1.0), (6, 7, 1.5), (5, 8, 2.0), (6, 8, 3.0)])
    slopes = [(0.5, 1.0), (0.5, 1.5), (1.0, 1.0), (1.0, 1.5)]  # along u and along v, at every corner
    wanted = np.array([(u, v, -1.0) for u, v in slopes])
    np.testing.assert_allclose(normals, wanted / np.linalg.norm(wanted, axis=1, keepdims=True))
    reach = np.empty((3, 2), np.int64)
    reach_of(points, np.array([0.0, 0.0, 0.0, 2.0]), (4, 4, 4), reach)
    np.testing.assert_array_equal(reach, [(2, 4), (3, 4), (0, 2)])  # touching 6 = 3 * 2 and 8 = 4 * 2, which is outside


def test_a_patch_with_a_corner_at_nothing_has_no_place() -> None:
    points, normals = np.empty((4, 3)), np.empty((4, 3))
    for bad in (np.nan, np.inf):
        corners = np.array([1.0, bad, 1.0, 1.0], np.float32)
        assert not outline_patch(np.eye(4), np.eye(4), 0, 0, corners, points, normals)
