"""Clips of rays and the depth along a clipped ray, against a scan of the ray."""

from __future__ import annotations

import numpy as np
import pytest

from ibrpipe.core.jit import helper
from ibrpipe.core.rays import clip_box, depth_at, patch_quadratic

BOX = np.array([4.0, 3.0, 0.5, 2.0])


@helper
def clipped(start, ray, far):
    return clip_box(start, ray[0], ray[1], ray[2], ray[3], BOX, far)


@pytest.mark.parametrize("seed", range(12))
def test_the_clipped_ray_is_what_a_scan_finds_in_the_box(seed):
    rng = np.random.default_rng(seed)
    start = np.array([*(rng.random(3) * 8 - 2), 1.0])
    ray = np.array([*(rng.normal(size=3)), 0.3 * (seed % 2) * rng.random()])
    ray[seed % 3] *= seed % 4 > 0
    far = 3.0 if seed % 5 == 0 else np.inf
    near, end = clipped(start, ray, far)
    t = np.linspace(0.0, 12.0, 24001)
    x, y, n, q = start[:, None] + ray[:, None] * t
    inside = (x >= 0) & (x <= 4 * q) & (y >= 0) & (y <= 3 * q) & (n >= 0.5 * q) & (n <= 2 * q) & (t <= far)
    if not inside.any():
        assert not near <= end - 1e-3
    else:
        assert abs(t[inside][0] - near) < 1e-3
        assert abs(t[inside][-1] - min(end, 12.0)) < 1e-3


def test_rays_along_a_side_are_kept_within_it_and_lost_beyond():
    assert clipped(np.array([1.0, 1.0, 0.0, 1.0]), np.array([0.0, 0.0, 1.0, 0.0]), np.inf) == (0.5, 2.0)
    near, far = clipped(np.array([5.0, 1.0, 0.0, 1.0]), np.array([0.0, 0.0, 1.0, 0.0]), np.inf)
    assert far < near


@pytest.mark.parametrize("qa", [1.0, 0.4])
def test_depth_at_a_parameter_is_where_the_ray_is(qa):
    near, far, rate = 2.0, 7.0, 0.3 if qa < 1 else 0.0
    qb = qa + (far - near) * rate
    for s in (0.0, 0.25, 1.0):
        t = depth_at(s, near, far, qa, qb)
        # places on the ray, at u = (10 t) / q, are linear in s
        places = [10 * each / (qa + (each - near) * rate) for each in (near, t, far)]
        assert places[1] == pytest.approx(places[0] + s * (places[2] - places[0]))


@helper
def quadratic(start, ray, i, j, corners, near):
    return patch_quadratic(
        (start[0], start[1], start[2], start[3]), (ray[0], ray[1], ray[2], ray[3]), i, j, corners, near
    )


@pytest.mark.parametrize("seed", range(6))
def test_the_quadratic_of_a_patch_is_how_far_the_ray_is_from_it(seed):
    rng = np.random.default_rng(seed)
    start, ray = np.array([*rng.normal(size=3), 1.0]), np.array([*rng.normal(size=3), 0.2 * (seed % 2)])
    corners, near = tuple(rng.random(4)), 1.5 * (seed % 3)
    A, B, C, *places = quadratic(start, ray, 2.0, 3.0, corners, near)
    a, b, c, e = corners
    for s in (-0.7, 0.0, 1.3):
        x, y, n, w = start + (near + s) * ray
        u, v, q = np.array(places[:3]) + s * np.array(places[3:])
        np.testing.assert_allclose((u / q, v / q, q), (x / w - 2.0, y / w - 3.0, w), atol=1e-12)
        p, r = u / q, v / q
        height = (a * (1 - p) + b * p) * (1 - r) + (c * (1 - p) + e * p) * r
        assert A * s * s + B * s + C == pytest.approx(w * w * (n / w - height), abs=1e-11)
