"""Rays past the grid of voxels meet what they meet in the full search of every sheet."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from kernel_runs import on_all_thread_counts

import ibrpipe
from ibrpipe.renderers.scene import prepare
from ibrpipe.renderers.view_dependence.mirror import CLEAR, LIFT, cast, make_surface
from ibrpipe.renderers.view_dependence.occupancy import BITS, bit, build_occupancy

SIDE, REACH = 48, 1.0


def shell(height, f=(0, 0, -1), hole=0.0):
    """Layers of z = height(x, y), x and y from -1 to 1, seen along f, which is -z or +z."""
    step, down = 2 * REACH / SIDE, np.array(f, float)
    a = np.array([step, 0, 0])
    b = np.array([0, step, 0]) if down[2] < 0 else np.array([0, -step, 0])
    frame = ibrpipe.ParallelFrame(-0.5 * SIDE * (a + b) - 2 * down, a, b, down)
    v, u = np.mgrid[:SIDE, :SIDE] + 0.5
    x, y = (frame.origin + u[..., None] * a + v[..., None] * b)[..., :2].transpose(2, 0, 1)
    z = height(x, y)
    kept = x**2 + y**2 >= hole
    slope_y, slope_x = np.gradient(z, y[1, 0] - y[0, 0], x[0, 1] - x[0, 0])
    normal = np.stack([-slope_x, -slope_y, np.ones_like(z)], axis=-1) * -down[2]
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    depth = (z - frame.origin[2]) * down[2]
    offsets = np.zeros((SIDE, SIDE + 1), np.int64)
    offsets[:, 1:] = np.cumsum(kept.ravel()).reshape(SIDE, SIDE)
    offsets[1:, 0] = offsets[:-1, -1]
    count = int(kept.sum())
    return ibrpipe.LayeredDepthImage(frame, offsets, depth[kept], np.full((count, 3), 0.5), normal[kept])


def seen_by_camera():
    """Layers of a plane below, seen by a pinhole camera."""
    camera = ibrpipe.Camera.look_at((0.3, 0.2, 2.0), (0.0, 0.1, -0.5), width=40, height=32)
    ways = camera.pixel_rays()
    depth = np.where(np.abs(ways[..., 2]) > 0.2, (-0.8 - camera.center[2]) / ways[..., 2], 2.0).ravel()
    offsets = np.arange(32)[:, None] * 40 + np.arange(41)
    return ibrpipe.LayeredDepthImage(
        camera, offsets, depth, np.full((1280, 3), 0.5), np.tile((0.0, 0.0, 1.0), (1280, 1))
    )


def bowl(x, y):
    return 0.8 * (x**2 + y**2)


def dome(x, y):
    return 0.5 - 0.4 * (x**2 + y**2)


def ripples(x, y):
    return 0.1 * np.sin(9 * x) * np.cos(7 * y)


SCENES = {
    "bowl": [shell(bowl)],
    "dome": [shell(dome)],
    "thin": [shell(dome), shell(lambda x, y: dome(x, y) - 0.01, f=(0, 0, 1))],
    "ripples": [shell(ripples), shell(lambda x, y: bowl(x, y) + 0.3, hole=0.2)],
    "camera": [shell(ripples), seen_by_camera()],
}


def surface_of(layers):
    return make_surface(prepare(tuple(layers)), np.concatenate([each.normal for each in layers]))


def rays_of(layers, surface, count=6000):
    """Rays that leave samples, many of them grazing, and free ones, some along axes."""
    rng = np.random.default_rng(5)
    image = layers[0]
    frame, texels = image.frame, np.repeat(np.arange(SIDE * SIDE), np.diff(image.offsets, axis=1).ravel())
    chosen = rng.integers(0, len(texels), count)
    v, u = np.divmod(texels[chosen], SIDE)
    points = frame.origin + (u + 0.5)[:, None] * frame.a + (v + 0.5)[:, None] * frame.b
    points = points + image.depth[chosen, None] * frame.f
    normal = image.normal[chosen].astype(float)
    way = rng.normal(size=(count, 3))
    outward = (way * normal).sum(axis=1, keepdims=True)
    way += (np.abs(outward) * rng.choice([1.0, 0.05], (count, 1)) - outward) * normal
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    start = points + LIFT * surface.texel * normal + CLEAR * surface.texel * way
    far = rng.uniform(-3, 3, (count, 3))
    free = rng.uniform(-1, 1, (count, 3)) - far
    free[::7, :2] = 0.0
    free[1::7, 1:] = 0.0
    return np.concatenate([start, far]), np.concatenate([way, free])


@pytest.mark.parametrize("name", SCENES)
def test_the_grid_loses_no_hit(name):
    surface = surface_of(SCENES[name])
    origins, ways = rays_of(SCENES[name], surface)
    full = replace(surface, occupancy=replace(surface.occupancy, always=2**BITS - 1))
    wanted = cast(full, origins, ways)
    found = on_all_thread_counts(lambda: cast(surface, origins, ways))
    np.testing.assert_array_equal(found[0], wanted[0])
    np.testing.assert_array_equal(found[1], wanted[1])
    assert 0.02 < np.isfinite(found[0]).mean() < 0.98


def test_rays_that_leave_a_dome_are_not_searched_and_those_in_a_bowl_are():
    shares = {}
    for name in ("bowl", "dome"):
        surface = surface_of(SCENES[name])
        origins, ways = (each[:6000] for each in rays_of(SCENES[name], surface))
        shares[name] = (surface.occupancy.find_sheets(np.concatenate([origins, ways], axis=1)) != 0).mean()
    assert shares["dome"] < 0.2  # half of the rays graze it
    assert shares["bowl"] > 0.4


def test_a_grid_is_small_and_knows_all_sheets():
    surface = surface_of(SCENES["thin"])
    grid = surface.occupancy
    assert grid.bytes < 16e6
    assert grid.always == 0
    assert np.bitwise_or.reduce(grid.bits) == sum(bit(number) for number in range(len(surface.sheets)))
    assert bit(BITS) == bit(0)
    nothing = grid.find_sheets(np.empty((0, 6)))
    assert nothing.shape == (0,)


def test_without_sheets_nothing_is_met():
    empty = build_occupancy([], 1.0)
    surface = replace(surface_of(SCENES["dome"]), sheets=[], occupancy=empty)
    t, patches = cast(surface, np.zeros((3, 3)), np.eye(3))
    assert np.isinf(t).all()
    assert (patches == -1).all()
