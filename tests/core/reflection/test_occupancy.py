"""Voxels that rays may cross freely, against plain searches of all cubes; where a patch lies and reaches."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from kernel_runs import on_all_thread_counts

from ibrpipe.core.reflection.occupancy import (
    MARGIN,
    STEP,
    WIDEST,
    bound_sheet,
    find_sheets,
    mark_sheet,
    measure_free,
    open_cones,
    outline_patch,
    reach_of,
)


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


class RandomSheet:
    """A sheet of 6 x 5 cells with holes, and where its patches and their normals lie by plain algebra."""

    def __init__(self, seed: int, perspective: bool, lost: int = 0) -> None:
        rng = np.random.default_rng(seed)
        self.columns, cells = 6, np.full(30, -1, np.int32)
        taken = np.sort(rng.permutation(30)[:17])
        cells[taken] = rng.permutation(17)
        corners = (1 + 0.6 * rng.random((17, 4))).astype(np.float32)
        if perspective:
            corners = -1 / (3 + corners)
        corners[:lost, 2] = np.nan
        self.leaves = (np.empty((0, 0), np.float32), cells, corners, np.full(17, 15, np.uint8))
        turned = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        self.pose = np.eye(4)
        self.pose[:3, :3], self.pose[:3, 3] = turned, rng.normal(size=3)
        if perspective:  # x, y, n = -1, q = z
            self.pose = np.array([[4.0, 0, 3, 0], [0, 4.0, 2, 0], [0, 0, 0, -1], [0, 0, 1, 0]]) @ self.pose
        self.back = np.linalg.inv(self.pose)
        self.shapes = [self.patch(cell) for cell in taken if np.isfinite(corners[cells[cell]]).all()]

    @property
    def packed(self):
        """What the kernels take."""
        return self.pose, self.back, self.columns, self.leaves

    def patch(self, cell: int) -> tuple[np.ndarray, np.ndarray]:
        """Corners in the world (4, 3), and the gradients there of the height above the patch, by differences."""
        a, b, c, e = (float(value) for value in self.leaves[2][self.leaves[1][cell]])
        column, row = cell % self.columns, cell // self.columns
        points, normals = np.empty((4, 3)), np.empty((4, 3))

        def height(point: np.ndarray) -> float:
            x, y, n, q = self.pose @ np.append(point, 1.0)
            p, r = x / q - column, y / q - row
            return a + (b - a) * p + (c - a) * r + (a - b - c + e) * p * r - n / q

        for k in range(4):
            x = self.back @ (column + (k & 1), row + (k >> 1), (a, b, c, e)[k], 1.0)
            points[k] = x[:3] / x[3]
            slope = [(height(points[k] + step) - height(points[k] - step)) / 2e-5 for step in 1e-5 * np.eye(3)]
            normals[k] = slope / np.linalg.norm(slope)
        return points, normals

    def reached(self, frame: np.ndarray, size: tuple[int, ...]) -> list[tuple[np.ndarray, list[tuple[int, ...]]]]:
        """The normals of every patch, and the voxels that its bounding box touches."""
        found = []
        for points, normals in self.shapes:
            low = np.floor((points.min(axis=0) - frame[:3]) / frame[3] - MARGIN)
            high = np.floor((points.max(axis=0) - frame[:3]) / frame[3] + MARGIN)
            low, high = (np.clip(each, 0, np.array(size) - 1).astype(int) for each in (low, high))
            found.append((normals, list(itertools.product(*(range(one, two + 1) for one, two in zip(low, high))))))
        return found


@pytest.mark.parametrize("perspective", [False, True])
def test_a_sheet_is_bounded_by_its_corners_and_what_has_no_position_is_counted(perspective: bool) -> None:
    for lost in (0, 3):
        sheet = RandomSheet(1, perspective, lost)
        bounds = np.array([[np.inf] * 3, [-np.inf] * 3])
        assert bound_sheet(*sheet.packed, bounds) == lost
        points = np.concatenate([points for points, _ in sheet.shapes])
        np.testing.assert_allclose(bounds, [points.min(axis=0), points.max(axis=0)], rtol=1e-6)
    wide = np.array([[-99.0] * 3, [99.0] * 3])
    bound_sheet(*sheet.packed, wide)
    np.testing.assert_array_equal(wide, [[-99.0] * 3, [99.0] * 3])
    empty = (sheet.pose, sheet.back, 0, (sheet.leaves[0], np.empty(0, np.int32), np.empty((0, 4), np.float32)))
    nothing = np.array([[np.inf] * 3, [-np.inf] * 3])
    assert bound_sheet(*empty, nothing) == 0
    assert np.isinf(nothing).all()


@pytest.mark.parametrize("perspective", [False, True])
def test_voxels_hold_the_bits_normals_and_cones_of_the_sheets_that_reach_them(perspective: bool) -> None:
    sheets, size = [RandomSheet(seed, perspective) for seed in (1, 2)], (5, 6, 4)
    points = np.concatenate([points for sheet in sheets for points, _ in sheet.shapes])
    frame = np.append(points.min(axis=0) - 0.01, np.ptp(points, axis=0).max() / 3)
    cells, bits, sums, count = np.full(size, -1, np.int32), np.zeros(120, np.int64), np.zeros((120, 3)), 0
    for number, sheet in enumerate(sheets):
        count = mark_sheet(*sheet.packed, frame, 1 << number, cells, count, bits, sums)
    wanted_bits, wanted_sums = np.zeros(size, np.int64), np.zeros((*size, 3))
    for number, sheet in enumerate(sheets):
        for normals, voxels in sheet.reached(frame, size):
            for voxel in voxels:
                wanted_bits[voxel] |= 1 << number
                wanted_sums[voxel] += normals.sum(axis=0)
    assert (np.sort(cells[cells >= 0]) == np.arange(count)).all()
    np.testing.assert_array_equal(np.where(cells >= 0, bits[cells], 0), wanted_bits)
    np.testing.assert_allclose(np.where(cells[..., None] >= 0, sums[cells], 0), wanted_sums, atol=1e-5)
    assert set(np.unique(wanted_bits)) == {0, 1, 2, 3}
    again = np.full(size, -1, np.int32)
    assert mark_sheet(*sheets[0].packed, frame, 1, again, 0, bits[:2].copy(), sums[:2].copy()) > 2  # no room: counted

    axes = sums[:count] / np.linalg.norm(sums[:count], axis=1, keepdims=True)
    cosines, wanted = np.ones(count), np.ones(count)
    for sheet in sheets:
        open_cones(*sheet.packed, frame, cells, axes, cosines)
        for normals, voxels in sheet.reached(frame, size):
            for voxel in voxels:
                wanted[cells[voxel]] = min(wanted[cells[voxel]], (normals @ axes[cells[voxel]]).min())
    np.testing.assert_allclose(cosines, wanted, atol=1e-5)


@pytest.mark.parametrize("seed", range(3))
def test_rays_name_the_sheets_of_the_voxels_that_they_cross_from_the_front(seed: int) -> None:
    rng, size = np.random.default_rng(seed), (6, 5, 4)
    frame, cells, count = np.array([-1.0, -2.0, 0.5, 0.5]), np.full(size, -1, np.int32), 30
    cells.ravel()[rng.permutation(cells.size)[:count]] = np.arange(count)
    bits, axes = 1 << np.arange(count), rng.normal(size=(count, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    cones, free = np.c_[axes, rng.choice([0.1, 0.5, 2.0], count)], np.zeros((8, *size), np.uint8)
    measure_free(cells, cones, free)
    origins, targets = rng.uniform(-3, 4, (200, 3)), frame[:3] + rng.random((200, 3)) * size * frame[3]
    origins[:60, 0] = targets[:60, 0]
    origins[:20, 1] = targets[:20, 1]  # along an axis
    rays = np.c_[origins, targets - origins]

    def find():
        out = np.empty(len(rays), np.int64)
        find_sheets(rays, (frame, cells, free, bits, cones), 1 << 40, out)
        return (out,)

    (found,) = on_all_thread_counts(find)
    surely, perhaps = (crossed(rays, frame, cells, cones, slack) for slack in (-4 * STEP, 4 * STEP))
    for ray, names in enumerate(found):
        assert names & 1 << 40
        assert surely[ray] & ~names == 0
        assert names & ~(perhaps[ray] | 1 << 40) == 0
    assert sum(each != 0 for each in surely) > 40
    find_sheets(rays[:0], (frame, cells, free, bits, cones), 0, found[:0])


def crossed(rays, frame, cells, cones, slack: float) -> list[int]:
    """Bits of the voxels, `slack` of their width wider, whose cone does not turn all patches away from the ray."""
    found = []
    for ray in rays:
        start, way, bits = (ray[:3] - frame[:3]) / frame[3], ray[3:] / np.linalg.norm(ray[3:]), 0
        for at in np.argwhere(cells >= 0):
            near, far = 0.0, np.inf
            for k in range(3):
                low, high = at[k] - slack, at[k] + 1 + slack
                if way[k] == 0.0:
                    far = far if low <= start[k] <= high else -np.inf
                else:
                    ends = sorted(((low - start[k]) / way[k], (high - start[k]) / way[k]))
                    near, far = max(near, ends[0]), min(far, ends[1])
            voxel = cells[tuple(at)]
            if near <= far and not cones[voxel][:3] @ way > cones[voxel][3]:
                bits |= 1 << int(voxel)
        found.append(bits)
    return found
