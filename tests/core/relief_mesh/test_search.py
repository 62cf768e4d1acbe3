"""The roots of a ray in a cell, and the search along a ray: against numpy's roots and brute force."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
import relief_mesh_twin as twin

from ibrpipe.core.relief_mesh.map import build_bounds, pad_layer, plan_levels
from ibrpipe.core.relief_mesh.search import patch_along, rising_root, search_along


def test_a_rays_height_above_a_patch_is_the_quadratic():
    rng = np.random.default_rng(0)
    for _ in range(50):
        a, b, c, e, p, q, z, dx, dy, dz = rng.normal(size=10)
        A, B, C = patch_along(a, b, c, e, p, q, z, dx, dy, dz)
        for w in (-0.7, 0.0, 0.4, 2.0):
            x, y = p + w * dx, q + w * dy
            patch = (a * (1 - x) + b * x) * (1 - y) + (c * (1 - x) + e * x) * y
            assert A * w * w + B * w + C == pytest.approx(z + w * dz - patch, abs=1e-12)


def test_the_rising_root_is_the_one_with_a_positive_slope():
    rng = np.random.default_rng(1)
    missed = 0
    for A, B, C in rng.normal(size=(300, 3)):
        roots = [root.real for root in np.roots([A, B, C]) if abs(root.imag) < 1e-12]
        rising = [root for root in roots if 2 * A * root + B > 0]
        found = rising_root(A, B, C)
        missed += not rising
        assert found == pytest.approx(rising[0] if rising else np.inf, rel=1e-9)
    assert 30 < missed < 200


@pytest.mark.parametrize(
    ("quadratic", "root"),
    [((0, 2, -3), 1.5), ((0, -2, 3), np.inf), ((0, 0, 1), np.inf), ((0, 0, 0), np.inf), ((1, 0, -4), 2.0),
     ((1, 0, 4), np.inf), ((np.nan, 1, 1), np.inf)],
)  # fmt: skip
def test_rising_roots_at_the_edges(quadratic, root):
    assert rising_root(*map(float, quadratic)) == root


@pytest.mark.parametrize("two", [False, True])
@pytest.mark.parametrize("wraps", [True, False])
def test_the_search_along_a_ray_misses_nothing(wraps, two):
    rng = np.random.default_rng(2)
    height = rng.random((6, 9)).astype(np.float32)
    below = (height * rng.random((6, 9))).astype(np.float32) if two else None
    layers = twin.Layers(SimpleNamespace(height=height, back=below, edges="wrap" if wraps else "cut"))
    front, shift = pad_layer(1 - height, wraps), 0.0 if wraps else 1.0
    plan = plan_levels(front.shape[0] - 1, front.shape[1] - 1, wraps)
    back, highs = np.empty((0, 0), np.float32), np.empty(0, np.float32)
    if below is not None:
        back = pad_layer(1 - below, wraps)
        highs = build_bounds(back, plan, False)
    lows, hits = build_bounds(front, plan, True), 0
    for _ in range(150):
        start = np.array([*rng.uniform(0, (8, 5)), 0.0])
        way = np.array([*rng.normal(size=2) * 3, 1.0])
        end = 1.0
        if not wraps:
            for axis, most in ((0, 8), (1, 5)):
                end = min(end, (most - start[axis]) / way[axis] if way[axis] > 0 else -start[axis] / way[axis])
        ray = (start[0] + shift, start[1] + shift, 0.0, *way)
        found = search_along(front, back, lows, highs, plan, ray, 0.0, end, True)
        assert found == pytest.approx(layers.first(start, way, 0.0, end), abs=1e-6)
        hits += found < np.inf
    assert 50 < hits <= 150
