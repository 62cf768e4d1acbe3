"""The spiral of directions: the paper's own numbers, its arc length, the horizon before and after closing it."""

from __future__ import annotations

import math

import numpy as np
import pytest
import spiral_twin
from scipy.spatial import cKDTree

from ibrpipe.core.spiral import directions

DENSITIES = (1 / 4, 1 / 16, 1 / 24, 1 / 64)


@pytest.mark.parametrize(("k", "count"), [(1 / 16, 42), (1 / 24, 93), (1 / 32, 164)])
def test_the_papers_sample_counts(k, count):
    assert directions.sample_count(k) == count
    assert len(directions.table(k, closed=False)) == count


@pytest.mark.parametrize(("k", "ratio"), [(1 / 16, 3.094), (1 / 32, 3.127)])
def test_the_papers_two_plane_ratios(k, ratio):
    assert directions.two_plane_ratio(k) == pytest.approx(ratio, abs=5e-4)


def test_the_ratio_tends_to_pi():
    assert directions.two_plane_ratio(1e-4) == pytest.approx(math.pi, abs=1e-6)


@pytest.mark.parametrize("k", DENSITIES)
def test_arc_length_is_the_integral_of_the_speed(k):
    for alpha in np.linspace(0.0, math.pi / (2 * k), 7):
        assert directions.arc_length(alpha, k) == pytest.approx(spiral_twin.arc_length(alpha, k), rel=1e-9, abs=1e-12)


@pytest.mark.parametrize("k", DENSITIES)
def test_published_samples_are_one_spacing_apart(k):
    alphas = directions.table(k, closed=False)
    lengths = [spiral_twin.arc_length(alpha, k) for alpha in alphas]
    np.testing.assert_allclose(np.diff(lengths), 2 * math.pi * k, rtol=1e-7)
    left = spiral_twin.arc_length(math.pi / (2 * k), k) - lengths[-1]
    assert 0 <= left < 2 * math.pi * k
    assert (k * alphas <= math.pi / 2).all()


@pytest.mark.parametrize("k", DENSITIES)
def test_closed_table_adds_one_turn_along_the_horizon(k):
    published, closed, extra = directions.table(k, False), directions.table(k), directions.closing_count(k)
    inner = closed[:-extra]
    np.testing.assert_array_equal(inner, published[: len(inner)])
    assert (k * published[len(inner) :] >= directions.LIMIT).all()
    assert (np.diff(closed) > 0).all()
    pitch = np.degrees(np.arccos(directions.directions(closed, k)[-extra:, 2]))
    np.testing.assert_allclose(pitch, 87.0, atol=1e-9)
    np.testing.assert_allclose(np.diff(closed[-extra:]), 2 * math.pi / extra)
    assert 2 * math.pi / extra <= 2 * math.pi * k + 1e-12


@pytest.mark.parametrize("k", DENSITIES)
@pytest.mark.parametrize("closed", [True, False])
def test_directions_are_unit_and_follow_equation_1(k, closed):
    limit = directions.LIMIT if closed else math.pi / 2
    alphas = directions.table(k, closed)
    found = directions.directions(alphas, k, limit)
    np.testing.assert_allclose(found, [spiral_twin.direction_of(a, k, limit) for a in alphas], atol=1e-14)
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), 1.0, atol=1e-14)
    np.testing.assert_array_equal(found[0], (0, 0, 1))
    assert (found[:, 2] > -1e-15).all()


def test_scale_factors_multiply_to_z():
    rng = np.random.default_rng(3)
    ways = rng.normal(size=(2000, 3))
    ways[:, 2] = np.abs(ways[:, 2])
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    factors = np.array([directions.scale_factors(way) for way in ways])
    np.testing.assert_allclose(factors.prod(axis=1), ways[:, 2], rtol=1e-12)
    assert (factors <= 1 + 1e-12).all()
    assert (factors > 0).all()


def test_scale_factors_on_the_axes():
    assert directions.scale_factors((0.0, 0.0, 1.0)) == (1.0, 1.0)
    assert directions.scale_factors((0.0, 0.6, 0.8)) == pytest.approx((1.0, 0.8))
    assert directions.scale_factors((0.6, 0.0, 0.8)) == pytest.approx((0.8, 1.0))
    assert directions.scale_factors((1.0, 0.0, 0.0)) == (0.0, 0.0)
    assert directions.scale_factors((0.6, 0.0, -0.8)) == (0.0, 0.0)


def covering_deg(ways):
    """Angle to the nearest sample over an even grid of hemisphere directions: (worst, mean), degrees."""
    number = np.arange(200_000)
    z, yaw = (number + 0.5) / len(number), number * math.pi * (3 - math.sqrt(5))
    across = np.sqrt(1 - z * z)
    grid = np.stack([across * np.cos(yaw), across * np.sin(yaw), z], axis=1)
    angle = np.degrees(2 * np.arcsin(cKDTree(ways).query(grid)[0] / 2))
    return angle.max(), angle.mean()


def test_closing_the_horizon_covers_it():
    k = 1 / 24
    before = covering_deg(directions.directions(directions.table(k, False), k, math.pi / 2))
    after = covering_deg(directions.directions(directions.table(k), k))
    assert before == pytest.approx((16.09, 5.82), abs=0.02)
    assert after == pytest.approx((10.63, 5.45), abs=0.02)
    assert len(directions.table(k)) == 112


@pytest.mark.parametrize("value", [-1.0, 0.0, 0.5, 1.0, 2.9, 3.0, 99.0])
def test_lower_bound_equals_searchsorted(value):
    alphas = np.array([0.0, 1.0, 1.0, 2.5, 3.0])
    assert directions.lower_bound(alphas, 0, len(alphas), value) == np.searchsorted(alphas, value, side="right") - 1


def test_lower_bound_of_nothing():
    assert directions.lower_bound(np.empty(0), 0, 0, 1.0) == -1
