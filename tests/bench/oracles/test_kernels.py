"""The oracle's loops one by one, against the formulas written out in NumPy."""

from __future__ import annotations

import ldi_twin
import numba
import numpy as np
import pytest
from small_fields import CAMERAS, depth_image, relief

from ibrpipe.bench.oracles import kernels
from ibrpipe.bench.oracles.surface import build_surface

RNG = np.random.default_rng(6)
CORNERS = (1.1, 1.6, 1.3, 0.9)


@pytest.fixture(autouse=True)
def quiet_as_compiled():
    with np.errstate(**({"all": "ignore"} if numba.config.DISABLE_JIT else {})):
        yield


def rays(count=40):
    """Rays of a cell: (x, y, n, q) at t = 0 and their change per t, some perspective, one along a corner's column."""
    for k in range(count):
        place = np.array([*(RNG.random(2) * 2 - 0.5), -RNG.random() - 1.0, 1.0])
        way = np.array([*(RNG.normal(size=2) * 0.2), 0.5 + RNG.random(), 0.2 * RNG.random() * (k % 2)])
        if k == 0:
            place[:2], way[:] = 0.5, (0, 0, 1, 0)
        yield place, way


@pytest.mark.parametrize("mask", range(16))
def test_quadrants_that_count(mask):
    for p, q in RNG.random((20, 2)):
        corner = int(p > 0.5) + 2 * int(q > 0.5)
        assert kernels.counts_at(p, q, mask, 0.0) == bool(mask & (1 << corner))
    assert not kernels.counts_at(1.2, 0.5, mask, 0.1)
    assert kernels.counts_at(1.05, 0.2, mask, 0.1) == bool(mask & 2)


def test_nearest_point_is_the_least_of_a_scan():
    for place, way in rays():
        t = kernels.nearest_point(tuple(place), tuple(way), 1.2, 0.7)
        scan = t + np.linspace(-2, 2, 401)
        x, y, n, q = place[:, None] + way[:, None] * scan
        away = (x - 0.5 * q) ** 2 + (y - 0.5 * q) ** 2 + ((n - 1.2 * q) / 0.7) ** 2
        assert abs(scan[away.argmin()] - t) < 0.011
    assert kernels.nearest_point((1.0, 1.0, 1.0, 1.0), (0.0, 0.0, 0.0, 0.0), 1.0, 1.0) == 0.0


@pytest.mark.parametrize("lower", [False, True])
def test_roots_of_triangles_lie_on_them(lower):
    a, b, c, e = CORNERS
    found = 0
    for place, way in rays():
        s = kernels.triangle_root(tuple(place), tuple(way), CORNERS, lower, 0.0, 0.0)
        scan = np.linspace(0.0, 6.0, 60001)
        x, y, n, q = place[:, None] + way[:, None] * scan
        p, r, d = x / q, y / q, n / q
        height = a + (c - a) * r + (e - c) * p if lower else a + (b - a) * p + (e - b) * r
        inside = (p >= 0) & (p <= 1) & (r >= 0) & (r <= 1) & ((p <= r) if lower else (p >= r))
        crosses = np.flatnonzero((d[:-1] < height[:-1]) & (d[1:] >= height[1:]) & inside[1:])
        if len(crosses):
            found += 1
            assert abs(scan[crosses[0]] - s) < 2e-4
        else:
            assert s == np.inf or not inside[np.argmin(abs(scan - s))]
        assert kernels.triangle_root(tuple(place), tuple(way), CORNERS, lower, 100.0, 0.0) == np.inf
    assert found > 3


@pytest.mark.parametrize("mask", [15, 9, 2, 0])
@pytest.mark.parametrize("front", [False, True])
def test_roots_of_patches_equal_the_twin(mask, front):
    present = [bool(mask & (1 << k)) for k in range(4)]
    for place, way in rays():
        want = np.inf
        with np.errstate(all="ignore"):
            for t, good in ldi_twin.roots(place, way, 0.0, 0.0, np.array(CORNERS), present, front, 0.0):
                want = min(want, float(t)) if good else want
        got = kernels.patch_root(tuple(place), tuple(way), CORNERS, mask, front, 0.0, 0.0)
        assert got == pytest.approx(want, rel=1e-9)
        assert kernels.patch_root(tuple(place), tuple(way), CORNERS, mask, front, 100.0, 0.0) == np.inf


def test_clipped_rays_are_what_a_scan_finds_in_the_wider_box():
    box, scan, met = np.array([4.0, 3.0, 0.5, 2.0]), np.linspace(0.0, 12.0, 24001), 0
    for place, way in rays():
        near, far = kernels.clip_ray(place, way, box, 0.0)
        x, y, n, q = place[:, None] + way[:, None] * scan
        inside = (x >= -1e-3 * q) & (x <= (4 + 1e-3) * q) & (y >= -1e-3 * q) & (y <= (3 + 1e-3) * q)
        inside &= (n >= 0.5 * q) & (n <= 2 * q)
        if inside.any():
            met += 1
            assert abs(scan[inside][0] - near) < 1e-3
            assert abs(scan[inside][-1] - min(far, 12.0)) < 1e-3
        else:
            assert not near <= far - 1e-3
    assert met > 10


def cast_both(source, camera, split=False):
    """(t, patch) by trying every patch, and by walking."""
    surface = build_surface(source)
    start, turn = surface.rays(camera)
    y, x = np.mgrid[: camera.height, : camera.width] + 0.5
    pixels, found = np.stack([x.ravel(), y.ravel()], axis=1), []
    rule = (surface.front, split, 0.0, surface.grain, surface.perspective, 0.0)
    ranges = np.stack([surface.corners.min(axis=1), surface.corners.max(axis=1)], axis=1)
    low, high = ranges.min() * 1.01 - 0.01, ranges.max() * 0.99 if surface.perspective else ranges.max() + 0.01
    box = np.array([surface.shape[1], surface.shape[0], low, high])
    for walks in (False, True):
        t, patch = np.full(len(pixels), np.nan), np.full(len(pixels), -7)
        if walks:
            walked = (surface.starts, ranges, surface.corners, surface.masks)
            kernels.cast_walks(start, turn, pixels, box, walked, rule, t, patch)
        else:
            kernels.cast_all(start, turn, pixels, surface.cells, surface.corners, surface.masks, rule, t, patch)
        found.append((t, patch))
    return found


@pytest.mark.parametrize("view", CAMERAS)
@pytest.mark.parametrize("name", ["relief", "wall"])
def test_casts_equal_the_twin(name, view):
    source, camera = relief() if name == "relief" else depth_image(), CAMERAS[view]
    (t, patch), (walked, other) = cast_both(source, camera)
    np.testing.assert_allclose(t.reshape(camera.height, camera.width), ldi_twin.cast(source, camera, 0.0), rtol=1e-7)
    np.testing.assert_array_equal(walked, t)
    np.testing.assert_array_equal(other, patch)
    assert ((patch == -1) == np.isinf(t)).all()
    assert np.isfinite(t).any()


def test_split_cells_are_met_by_both_casts_alike():
    (t, patch), (walked, other) = cast_both(relief(), CAMERAS["front"], split=True)
    assert np.isfinite(t).sum() > 20
    np.testing.assert_array_equal(walked, t)
    np.testing.assert_array_equal(other, patch)


def test_without_patches_or_rays_nothing_is_hit():
    start, turn, rule = np.array([0.0, 0, -1, 1]), np.ones((4, 3)), (False, False, 0.0, 1.0, False, 0.0)
    cells, corners, masks = np.empty((0, 2), np.int64), np.empty((0, 4)), np.empty(0, np.uint8)
    for count in (0, 3):
        t, patch = np.zeros(count), np.zeros(count, np.int64)
        kernels.cast_all(start, turn, np.ones((count, 2)), cells, corners, masks, rule, t, patch)
        assert np.isinf(t).all()
        assert (patch == -1).all()


def test_values_are_those_of_the_patch_nearest_in_depth():
    starts, masks = np.array([0, 2, 2]), np.array([15, 1], np.uint8)  # two patches in the first of two cells
    corners = np.array([CORNERS, (3.0, 3.0, 3.0, 3.0)])
    u, v = np.array([0.25, 0.25, 0.75, 1.5, -0.1]), np.array([0.25, 0.25, 0.75, 0.5, 0.5])
    d, out = np.array([1.0, 2.9, 2.9, 1.0, 1.0]), np.empty(5)
    kernels.values_at(u, v, d, starts, 2, 1, corners, masks, out)
    a, b, c, e = CORNERS
    low = (a * 0.75 + b * 0.25) * 0.75 + (c * 0.75 + e * 0.25) * 0.25
    high = (a * 0.25 + b * 0.75) * 0.25 + (c * 0.25 + e * 0.75) * 0.75
    np.testing.assert_allclose(out, [low, 3.0, high, np.nan, np.nan])
