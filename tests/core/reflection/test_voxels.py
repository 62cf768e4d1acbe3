"""Voxels that rays may cross freely, against plain searches of all cubes; fronts of patches, against their roots."""

from __future__ import annotations

import itertools

import ldi_twin
import numpy as np
import pytest
from kernel_runs import on_all_thread_counts
from small_fields import depth_image, layers

from ibrpipe.core.reflection.voxels import WIDEST, cast_rays, measure_free
from ibrpipe.renderers.fields import build_field
from ibrpipe.renderers.view_dependence.mirror import matrix
from ibrpipe.renderers.view_dependence.voxel_grid import build_grid, outline_patches
from ibrpipe.types import LayeredDepthImage


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
    cones = np.c_[axes / np.linalg.norm(axes, axis=1, keepdims=True), rng.choice([0.05, 0.3, 2.0], 9), np.zeros((9, 2))]
    found = np.zeros((8, *cells.shape), np.uint8)
    measure_free(cells, cones, found)
    for octant in range(8):
        signs = (1 - 2 * (octant & 1), 1 - (octant & 2), 1 - 2 * (octant >> 2))
        for at in np.ndindex(cells.shape):
            assert found[octant][at] == free_cube(cells, cones, signs, at), (octant, at)
    assert (found == 0).any()
    assert (found == WIDEST).any()


def front_hit(origin: np.ndarray, way: np.ndarray, column: int, row: int, corners: np.ndarray, mask: int) -> float:
    """Least t > 0 at which a ray meets the front of a bilinear patch over a cell, in field coordinates; inf = none."""
    a, b, c, e = (float(corner) for corner in corners)
    p, q, d = origin - (column, row, 0.0)
    dp, dq, dd = way
    # depth of the ray less that of the patch: a polynomial of t
    twist = a - b - c + e
    square = -twist * dp * dq
    slope = dd - (b - a) * dp - (c - a) * dq - twist * (p * dq + q * dp)
    rest = d - a - (b - a) * p - (c - a) * q - twist * p * q
    best = np.inf
    for root in np.roots([square, slope, rest]):
        t = float(root.real)
        u, v = p + t * dp, q + t * dq
        if abs(root.imag) > 0 or t <= 0 or not (0 <= u <= 1 and 0 <= v <= 1) or 2 * square * t + slope <= 0:
            continue
        if mask >> ((u > 0.5) + 2 * (v > 0.5)) & 1:
            best = min(best, t)
    return best


@pytest.mark.parametrize("loose", [False, True])
def test_rays_meet_the_fronts_of_listed_patches(loose: bool) -> None:
    rng = np.random.default_rng(3)
    count, side = 40, 4
    cells = rng.integers(0, side, (count, 2))
    corners = (rng.uniform(0.2, 3.8, (count, 1)) + rng.normal(0, 0.2, (count, 4))).astype(np.float32)
    masks = rng.choice([15, 15, 15, 1, 6, 14], count).astype(np.uint8)
    tags = np.column_stack([np.arange(count), np.zeros(count, int), cells]).astype(np.int32)
    taken = np.arange(side**3, dtype=np.int32).reshape(side, side, side) * (0 if loose else 1)
    pairs = [[] for _ in range(side**3)]
    for patch in range(count):
        least, most = max(int(corners[patch].min()), 0), min(int(corners[patch].max()), side - 1)
        for level in range(least, most + 1):
            pairs[(cells[patch, 0] * side + cells[patch, 1]) * side + level].append(patch)
    starts = np.cumsum([0] + [len(each) for each in pairs])
    hulls = np.tile([0.0, 0.0, 0.0, 2.0, 0.0, 0.0], (side**3, 1))
    free = np.zeros((8, side, side, side), np.uint8)
    measure_free(np.full_like(taken, -1) if loose else taken, hulls, free)
    none = np.zeros((0, 4), np.int32)
    listed = none if loose else tags[np.concatenate([np.array(each, int) for each in pairs])]
    grid = (np.array([0.0, 0, 0, 1]), taken, free, hulls, starts, listed, tags if loose else none)
    rays = np.concatenate([rng.uniform(-1, 5, (400, 3)), rng.normal(size=(400, 3))], axis=1)
    rays[:40, 3:5] = 0.0
    t, ids = np.empty(400), np.empty(400, np.int64)
    cast_rays(rays, grid, (np.eye(4)[None], corners, masks), t, ids)
    patches = [(*cells[n], corners[n], masks[n]) for n in range(count)]
    wanted = np.array([[front_hit(ray[:3], ray[3:], *patch) for patch in patches] for ray in rays])
    np.testing.assert_allclose(t, wanted.min(axis=1), rtol=1e-9)
    hit = np.isfinite(t)
    assert 30 < hit.sum() < 370
    np.testing.assert_array_equal(ids[hit], wanted[hit].argmin(axis=1))
    assert (ids[~hit] == -1).all()


SOURCES = {"layers": layers(), "wall": depth_image()}


def nearest(source, rays, slack):
    """(N,) nearest t over all patches, their borders moved outward by `slack` cells; +inf = none."""
    frame, patches, front = ldi_twin.patches_of(source)
    best = np.full(len(rays), np.inf)
    for n, ray in enumerate(rays):
        P = ldi_twin.homogeneous(frame, ray[:3])
        Q = ldi_twin.homogeneous(frame, ray[:3] + ray[3:]) - P
        for column, row, depths, present, _ in patches:
            for t, good in ldi_twin.roots(P, Q, column + 0.5, row + 0.5, depths, present, front, slack):
                best[n] = min(best[n], float(t)) if good else best[n]
    return best


def rays_at(source, count=90):
    """Rays from before and behind the samples, most of them at these; some lie across."""
    rng = np.random.default_rng(8)
    frame = source.frame if isinstance(source, LayeredDepthImage) else source.camera
    if isinstance(source, LayeredDepthImage):
        columns, rows = source.shape[1], source.shape[0]
        at = rng.random((count, 2)) * (columns, rows)
        targets = frame.origin + at[:, :1] * frame.a + at[:, 1:] * frame.b + rng.uniform(1, 2.5, (count, 1)) * frame.f
        ahead = frame.f
    else:
        at = rng.random((count, 2)) * (frame.width, frame.height)
        targets = frame.center + rng.uniform(13.5, 15.5, (count, 1)) * frame.pixel_rays(at)
        ahead = frame.R[2]
    origins = targets - 5 * ahead / np.linalg.norm(ahead) + rng.normal(size=(count, 3))
    origins[::9] = targets[::9] + 3 * ahead + rng.normal(size=targets[::9].shape)
    return np.ascontiguousarray(np.c_[origins, 0.5 * (targets - origins)])


@pytest.mark.parametrize("name", SOURCES)
def test_rays_through_the_grid_meet_the_nearest_front_of_layers_and_depth_images(name):
    source = SOURCES[name]
    rays, field = rays_at(source), build_field(source)
    pose = matrix(field.pose)
    grid = build_grid([outline_patches(pose, field.cells, field.corners)], 0.5)

    def search():
        t, ids = np.empty(len(rays)), np.empty(len(rays), np.int64)
        cast_rays(rays, grid.packed, (pose[None], field.corners, field.masks), t, ids)
        return t, ids

    t, ids = on_all_thread_counts(search)
    larger, smaller = nearest(source, rays, 1e-6), nearest(source, rays, -1e-6)
    assert (t >= larger * (1 - 1e-6)).all()
    assert (t <= smaller * (1 + 1e-6)).all()
    assert 20 < np.isfinite(t).sum() < len(rays) - 5
    assert ((ids == -1) == np.isinf(t)).all()
    cast_rays(rays[:0], grid.packed, (pose[None], field.corners, field.masks), t[:0], ids[:0])
