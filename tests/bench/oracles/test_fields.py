"""The oracle against the plain twin of the surfaces, against itself (brute force and walk), and against mpmath."""

from __future__ import annotations

import ldi_twin
import mpmath
import numpy as np
import pytest

from ibrpipe.bench.oracles import fields
from ibrpipe.bench.oracles.surface import build_surface, height_surface
from ibrpipe.types import Camera, DepthImage, LayeredDepthImage, ParallelFrame, ReliefTexture

PLAIN = ParallelFrame((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1))
SKEW = ParallelFrame((3, -2, 5), (0.5, 0.1, 0.02), (-0.2, 0.7, 0.1), np.array([0.3, -0.2, 0.9]) / np.sqrt(0.94))


def rough(frame, shape=(9, 12), seed=1, holes=0.1):
    rng = np.random.default_rng(seed)
    height = rng.random(shape) * 2
    height[rng.random(shape) < holes] = np.nan
    return ReliefTexture(frame, rng.random((*shape, 3)), height)


def two_layers(frame, shape=(6, 8), seed=2):
    rng = np.random.default_rng(seed)
    counts = rng.integers(0, 3, shape)
    ends = np.cumsum(counts).reshape(shape)
    offsets = np.concatenate([np.r_[0, ends[:-1, -1]][:, None], ends], 1)
    depth = np.concatenate([np.sort(2 + 2 * rng.random(n)) for n in counts.ravel()])
    normal = rng.normal(size=(len(depth), 3)) * 0.3 - (frame.R[2] if isinstance(frame, Camera) else frame.f)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    normal[rng.random(len(depth)) < 0.3] = np.nan
    return LayeredDepthImage(frame, offsets, depth, rng.random((len(depth), 3)), normal)


OWN = Camera.look_at((1, 2, 3), (0.5, -1, 0), width=8, height=6)
AIMED = Camera.look_at((-9, 4, 7), (4, 4, 1.5), width=33, height=25)
SOURCES = {
    "relief": (rough(PLAIN), AIMED),
    "skew relief": (rough(SKEW), Camera.look_at((1, 3, 11), (5, 0.5, 6), width=33, height=25)),
    "one texel wide": (rough(PLAIN, (7, 1), holes=0), Camera.look_at((3, 3, -9), (0.5, 3, 1), width=20, height=20)),
    "layers": (two_layers(PLAIN), Camera.look_at((1, 3, -8), (4, 3, 3), width=33, height=25)),
    "perspective layers": (
        two_layers(OWN),
        Camera.look_at(OWN.center + np.array((0.3, 0.2, 0.1)), (0.5, -1, 0), width=30),
    ),
    "depth image": (
        DepthImage(OWN, np.ones((6, 8, 3)), 3 + np.random.default_rng(3).random((6, 8))),
        Camera.look_at(OWN.center + np.array((0.3, 0.2, 0.1)), (0.5, -1, 0), width=30, height=24),
    ),
}


@pytest.mark.parametrize("name", SOURCES)
def test_oracle_equals_twin(name):
    source, camera = SOURCES[name]
    camera = camera.resized(30, 24)
    wanted = ldi_twin.cast(source, camera, 0.0)
    surface = build_surface(source)
    for brute in (True, False):
        grid = fields.pixel_centers(camera)
        got = fields.cast([surface], camera, grid, brute=brute)[0].reshape(wanted.shape)
        same = np.isfinite(got) == np.isfinite(wanted)
        assert np.mean(~same) < 0.003  # corners that are predicted are stored as float32
        both = np.isfinite(got) & np.isfinite(wanted)
        assert both.sum() > 20
        close = np.isclose(got[both], wanted[both], rtol=2e-6)
        assert np.mean(~close) < 0.003


@pytest.mark.parametrize("split", [False, True])
@pytest.mark.parametrize("name", SOURCES)
def test_walk_equals_brute_force(name, split):
    source, camera = SOURCES[name]
    surface, grid = build_surface(source), fields.pixel_centers(camera, 2)
    brute, walk = (fields.cast([surface], camera, grid, split=split, brute=choice) for choice in (True, False))
    np.testing.assert_array_equal(brute[0], walk[0])
    np.testing.assert_array_equal(brute[1], walk[1])


def exact_root(surface, camera, pixel, patch):
    """The same hit with 50 digits, from the same float64 inputs."""
    with mpmath.workdps(50):
        one = mpmath.mpf
        inverse = mpmath.inverse(mpmath.matrix(surface.frame.world_from_local.tolist()))
        center = mpmath.matrix([one(float(x)) for x in camera.center])
        origin = mpmath.matrix([one(float(x)) for x in surface.frame.origin])
        way = mpmath.matrix(camera.world_from_pixel.tolist()) * mpmath.matrix([*map(one, map(float, pixel)), one(1)])
        start, ray = inverse * (center - origin), inverse * way
        a, b, c, e = (one(float(x)) for x in surface.corners[patch])
        column, row = (one(float(x)) + one(surface.shift) for x in surface.cells[patch])

        def miss(t):
            p, q, d = start[0] + t * ray[0] - column, start[1] + t * ray[1] - row, start[2] + t * ray[2]
            return d - (a * (1 - p) * (1 - q) + b * p * (1 - q) + c * (1 - p) * q + e * p * q)

        def root(guess):
            return mpmath.findroot(miss, one(float(guess)))

        return root


@pytest.mark.parametrize("distance", [10.0, 1e4, 1e6])
def test_oracle_against_fifty_digits(distance):
    source = rough(SKEW, holes=0)
    surface = build_surface(source)
    target = np.array([5.0, 0.5, 6.0])
    eye = target + distance * np.array([0.3, 0.2, 0.93])
    camera = Camera.look_at(eye, target, fov_y_deg=float(np.degrees(9 / distance)), width=16, height=12)
    grid = fields.pixel_centers(camera)
    depth, patch, _ = fields.cast([surface], camera, grid)
    found = np.flatnonzero(np.isfinite(depth))
    assert len(found) > 20
    for i in found[::5]:
        wanted = exact_root(surface, camera, grid[i], patch[i])(depth[i])
        assert abs(float(wanted - mpmath.mpf(float(depth[i])))) < 1e-12 * max(distance, 10.0) + 4e-10 * (distance > 1e5)


def test_triangles_meet_the_bilinear_surface_where_it_is_flat():
    height = np.add.outer(np.arange(7) * 0.3, np.arange(9) * -0.2)
    surface = height_surface(ReliefTexture(PLAIN, np.zeros((7, 9, 3)), height), height)
    grid = fields.pixel_centers(AIMED)
    smooth, cut = (fields.cast([surface], AIMED, grid, split=choice)[0] for choice in (False, True))
    both = np.isfinite(smooth) & np.isfinite(cut)
    assert both.sum() > 30
    np.testing.assert_allclose(smooth[both], cut[both], rtol=1e-12)


def test_clear_pixels_and_doubt():
    """Rays through the interior are clear; an eye on the surface and a border in view are not."""
    surface = build_surface(rough(PLAIN, holes=0))
    seen = fields.cast_truth([surface], AIMED)
    clear = seen.clear(1e-3)
    assert 0.9 < clear.mean() < 1.0 or clear.all()
    assert (seen.earliest <= seen.depth).all()
    assert (seen.depth <= seen.latest).all()
    level = height_surface(ReliefTexture(PLAIN, np.zeros((9, 9, 3)), np.ones((9, 9))), np.ones((9, 9)))
    within = Camera.look_at((4.5, 4.5, 1.0), (9, 4.5, 1.0), width=9, height=9)
    assert not fields.cast_truth([level], within).clear(1e-3)[4].any()


def test_colours_are_bilinear():
    y, x = np.mgrid[:9, :12] + 0.5
    source = ReliefTexture(PLAIN, np.stack([x / 12, y / 9, np.full_like(x, 0.5)], -1), np.zeros((9, 12)))
    camera, surface = Camera.look_at((6, 4, 9), (6, 5, 0), width=20, height=20), build_surface(source)
    grid = fields.pixel_centers(camera)
    hits = fields.cast([surface], camera, grid)
    color, there = fields.colors_at([surface], camera, grid, hits)
    point = camera.center + hits[0][there, None] * (
        np.column_stack([grid, np.ones(len(grid))])[there] @ camera.world_from_pixel.T
    )
    np.testing.assert_allclose(color[there, 0], point[:, 0] / 12, atol=1e-6)
    np.testing.assert_allclose(color[there, 1], point[:, 1] / 9, atol=1e-6)
