"""Direction look-up against its brute-force twin: random directions, pole, horizon, yaw wrap; residuals at a point."""

from __future__ import annotations

import math

import numpy as np
import pytest
import spiral_twin

from ibrpipe.core.spiral import directions
from ibrpipe.core.spiral.lookup import coded_of, neighbours, residual_at

DENSITIES = (1 / 4, 1 / 16, 1 / 24, 1 / 64)
BOTH = pytest.mark.parametrize("closed", [True, False])


def parts(k, closed):
    """(alphas, limit, closing, directions) of one spiral."""
    limit = directions.LIMIT if closed else math.pi / 2
    alphas = directions.table(k, closed)
    return alphas, limit, directions.closing_count(k) if closed else 0, directions.directions(alphas, k, limit)


def ask(ways, k, closed):
    """Return indices (N, 4) and weights (N, 4) for directions (N, 3)."""
    alphas, limit, closing, _ = parts(k, closed)
    indices, weights = np.full((len(ways), 4), -1), np.full((len(ways), 4), np.nan)
    for i, (x, y, z) in enumerate(ways):
        neighbours(float(x), float(y), float(z), alphas, 0, len(alphas), k, limit, closing, indices[i], weights[i])
    return indices, weights


def dense(indices, weights, count):
    out = np.zeros((len(indices), count))
    np.add.at(out, (np.arange(len(indices))[:, None], indices), weights)
    return out


def toward(pitch, yaw):
    pitch, yaw = np.broadcast_arrays(pitch, yaw)
    return np.stack([np.sin(pitch) * np.cos(yaw), np.sin(pitch) * np.sin(yaw), np.cos(pitch)], axis=-1)


def random_ways(count, seed):
    rng = np.random.default_rng(seed)
    return toward(np.arccos(rng.random(count)), 2 * np.pi * rng.random(count))


def special_ways(k, closed):
    """Pole, horizon, the samples themselves, and both sides of yaw 0."""
    pitch = np.linspace(0.0, np.pi / 2, 60)
    wrap = [toward(pitch, yaw) for yaw in (0.0, 1e-15, -1e-15, 1e-9, -1e-9, np.pi, -np.pi)]
    flat = toward(np.pi / 2, np.linspace(0.0, 2 * np.pi, 200))
    signed = [(1.0, -0.0, 0.0), (0.0, 0.0, 1.0), (-0.0, -0.0, 1.0), (1e-300, -1e-300, 1.0), (0.0, -1.0, 0.0)]
    return np.concatenate([*wrap, flat, np.array(signed), parts(k, closed)[3]])


def assert_as_twin(ways, k, closed):
    alphas, limit, closing, _ = parts(k, closed)
    for chunk in np.array_split(ways, max(1, len(ways) // 10_000)):
        indices, weights = ask(chunk, k, closed)
        assert indices.min() >= 0
        assert indices.max() < len(alphas)
        assert weights.min() >= 0
        np.testing.assert_allclose(weights.sum(axis=1), 1.0, atol=1e-12)
        wanted = spiral_twin.lookup(chunk, alphas, k, limit, closing)
        np.testing.assert_allclose(dense(indices, weights, len(alphas)), wanted, atol=1e-9)


@BOTH
def test_a_hundred_thousand_random_directions(closed):
    assert_as_twin(random_ways(100_000, 5), 1 / 24, closed)


@BOTH
@pytest.mark.parametrize("k", DENSITIES)
def test_every_density_and_every_special_direction(k, closed):
    assert_as_twin(np.concatenate([special_ways(k, closed), random_ways(5000, 6)]), k, closed)


@BOTH
@pytest.mark.parametrize("k", DENSITIES)
def test_a_samples_own_direction_gives_that_sample(k, closed):
    ways = parts(k, closed)[3]
    found = dense(*ask(ways, k, closed), len(ways))
    np.testing.assert_allclose(found, np.eye(len(ways)), atol=1e-6)


@pytest.mark.parametrize("k", DENSITIES)
def test_closed_spiral_interpolates_a_smooth_function_everywhere(k):
    samples = parts(k, True)[3]
    ways = np.concatenate([special_ways(k, True), random_ways(4000, 7)])
    indices, weights = ask(ways, k, True)
    blended = (weights[:, :, None] * samples[indices]).sum(axis=1)
    error = np.degrees(np.linalg.norm(blended - ways, axis=1))
    # the first turn has few samples, and 3 degrees of horizon are clamped
    assert error.max() <= max(0.36 * np.degrees(2 * np.pi * k), 3.01)


@pytest.mark.parametrize("k", DENSITIES)
def test_published_spiral_fails_at_the_horizon(k):
    """What the closing turn mends: past the published end the last sample stands in, however far away it is."""
    samples = parts(k, False)[3]
    ways = toward(np.pi / 2, np.linspace(0.0, 2 * np.pi, 400))
    indices, weights = ask(ways, k, False)
    blended = (weights[:, :, None] * samples[indices]).sum(axis=1)
    assert np.degrees(np.linalg.norm(blended - ways, axis=1)).max() > 90 * k


@BOTH
@pytest.mark.parametrize("k", DENSITIES)
def test_small_turns_change_little(k, closed):
    samples, step = parts(k, closed)[3], 1e-7
    rng = np.random.default_rng(8)
    ways = np.concatenate([special_ways(k, closed), random_ways(3000, 9)])
    moved = ways + step * rng.normal(size=ways.shape)
    moved /= np.linalg.norm(moved, axis=1, keepdims=True)
    moved[:, 2] = np.maximum(moved[:, 2], 0.0)
    values = [(w[:, :, None] * samples[i]).sum(axis=1) for i, w in (ask(ways, k, closed), ask(moved, k, closed))]
    change = np.linalg.norm(values[1] - values[0], axis=1) / np.linalg.norm(moved - ways, axis=1).clip(1e-12)
    pitch = np.arccos(np.clip(ways[:, 2], -1, 1)).clip(1e-8)  # near the pole yaw turns fast
    assert (change < (2.5 if closed else 0.5 / k) + 2 * np.pi * k / (4 * pitch)).all()


@BOTH
@pytest.mark.parametrize("k", DENSITIES)
def test_all_ways_to_the_pole_end_there(k, closed):
    samples = parts(k, closed)[3]
    for pitch in (1e-2, 1e-4, 1e-8):
        indices, weights = ask(toward(pitch, np.linspace(-4, 4, 200)), k, closed)
        blended = (weights[:, :, None] * samples[indices]).sum(axis=1)
        assert np.linalg.norm(blended - (0, 0, 1), axis=1).max() < 2 * pitch


def test_residuals_as_twin_with_holes_and_borders():
    rng = np.random.default_rng(10)
    sizes = np.array([(5, 7), (1, 1), (3, 2), (6, 4)], np.int32)
    starts = np.concatenate([[0], np.cumsum(sizes.prod(axis=1))]).astype(np.int64)
    texels = rng.integers(0, 256, (starts[-1], 4)).astype(np.uint8)
    texels[:, 3] = rng.random(len(texels)) < 0.7
    ways, zero, scale = random_ways(4, 11), np.array([32.0, 0.0, 128.0, 32.0]), np.array([0.5, 1.3])
    ways[:, 2] = np.maximum(ways[:, 2], 0.1)
    images = [(ways[i], zero[i], texels[starts[i] : starts[i + 1]].reshape(*sizes[i], 4)) for i in range(4)]
    indices, found = np.array([2, 0, 3, 1]), 0
    for _ in range(600):
        point, weights = rng.uniform(-0.3, 1.3, 3), rng.dirichlet(np.ones(4))
        point[2] *= 0.3
        weights[rng.integers(4)] = 0.0
        total = np.zeros(4)
        packed = ways, sizes, starts, texels, zero
        residual_at(tuple(point), packed, tuple(scale), indices, weights, total)
        wanted = spiral_twin.residual_at(point, weights, [images[i] for i in indices], scale)
        np.testing.assert_allclose(total, wanted, atol=1e-9)
        found += total[3] > 0
    assert 300 < found < 600


def test_depth_correction_reads_the_same_surface_point():
    """A point's own residual, marked in each image where its ray leaves, is found again from any depth."""
    way, size = np.array([[0.3, -0.2, math.sqrt(1 - 0.13)]]), 40
    for depth in (0.0, 0.4, 1.1):
        texels = np.zeros((size * size, 4), np.float32)
        texels[:, 3] = 1
        u, v = 0.5 + depth * way[0, 0] / way[0, 2] * 0.5, 0.5 + depth * way[0, 1] / way[0, 2] * 0.25
        rows, columns = np.mgrid[:size, :size] + 0.5
        texels[:, 0] = (columns / size - u).ravel()
        texels[:, 1] = (rows / size - v).ravel()
        total = np.zeros(4)
        residual_at(
            (0.5, 0.5, depth),
            (way, np.array([[size, size]], np.int32), np.array([0, size * size]), texels, np.zeros(1)),
            (0.5, 0.25), np.zeros(4, np.int64), np.array([1.0, 0, 0, 0]), total
        )  # fmt: skip
        np.testing.assert_allclose(total, (0, 0, 0, 1), atol=1e-6)


def test_display_code_of_the_table():
    linear = (np.arange(4096) / 4095) ** 2
    encode = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055).astype(np.float32)
    for value in (0.0, 1e-5, 0.0031, 0.02, 0.5, 0.999, 1.0, 7.0):
        exact = 12.92 * value if value <= 0.0031308 else 1.055 * value ** (1 / 2.4) - 0.055
        assert coded_of(value, encode) == pytest.approx(exact, abs=2e-6)
