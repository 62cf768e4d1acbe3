"""Rays through the grid of voxels meet what they meet when every patch is tried."""

from __future__ import annotations

from dataclasses import replace

import numba
import numpy as np
import pytest
from kernel_runs import on_all_thread_counts

import ibrpipe
from ibrpipe.renderers.scene import prepare
from ibrpipe.renderers.view_dependence.mirror import CLEAR, LIFT, cast, make_surface
from ibrpipe.renderers.view_dependence.voxel_grid import VoxelGrid, build_grid, outline_patches

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


def all_loose(surface):
    """The surface with a grid that knows nothing: every patch is tried for every ray."""
    tags = np.column_stack([np.arange(len(surface.records)), surface.records[:, [2, 0, 1]]]).astype(np.int32)
    return replace(surface, grid=replace(build_grid([], 1.0), loose=tags))


@pytest.mark.parametrize("name", SCENES)
def test_the_grid_loses_no_hit(name):
    if numba.config.DISABLE_JIT and name not in ("bowl", "dome"):
        pytest.skip("most of a minute as plain Python; bowl and dome are tried so")
    surface = surface_of(SCENES[name])
    origins, ways = rays_of(SCENES[name], surface)
    some = slice(None, None, 5)  # all patches are tried for each
    wanted = cast(all_loose(surface), origins[some], ways[some])
    found = on_all_thread_counts(lambda: cast(surface, origins, ways))
    np.testing.assert_allclose(found[0][some], wanted[0], rtol=1e-9)
    met = np.isfinite(wanted[0])
    assert (found[1][some] == wanted[1]).mean() > 0.999  # on seams either
    assert (found[1][some][~met] == -1).all()
    assert 0.02 < met.mean() < 0.98


def test_hulls_hold_the_corners_and_normals_of_all_patches():
    surface = surface_of(SCENES["camera"])
    grid = surface.grid
    fields = [field for _, field in prepare(tuple(SCENES["camera"])).patches]
    parts = [outline_patches(pose, field.cells, field.corners) for pose, field in zip(surface.poses, fields)]
    assert all(part.placed.all() for part in parts)
    points, normals = (np.concatenate([getattr(part, name) for part in parts]) for name in ("points", "normals"))
    owner = np.repeat(np.arange(len(grid.hulls)), np.diff(grid.starts))
    hulls, patch = grid.hulls[owner], grid.listed[:, 0]
    heights = (((points[patch] - grid.frame[:3]) / grid.frame[3]) * hulls[:, None, :3]).sum(axis=2)
    assert (heights >= hulls[:, 4:5]).all()
    assert (heights <= hulls[:, 5:6]).all()
    narrow = hulls[:, 3] <= 1
    assert narrow.any()
    cosines = (normals[patch] * hulls[:, None, :3]).sum(axis=2)[narrow]
    assert (cosines >= np.sqrt(np.maximum(1 - hulls[narrow, 3:4] ** 2, 0)) - 1e-9).all()
    assert set(patch) == set(range(len(surface.records)))


def test_a_patch_of_a_parallel_frame_lies_where_its_corners_are():
    corners = np.array([[1.0, 1.5, 2.0, 3.0]], np.float32)  # field coordinates are world coordinates, depth along z
    found = outline_patches(np.eye(4), np.array([[5, 7]], np.int32), corners)
    assert found.placed.all()
    np.testing.assert_allclose(found.points[0], [(5, 7, 1.0), (6, 7, 1.5), (5, 8, 2.0), (6, 8, 3.0)])
    slopes = [(0.5, 1.0), (0.5, 1.5), (1.0, 1.0), (1.0, 1.5)]  # along u and along v, at every corner
    wanted = np.array([(u, v, -1.0) for u, v in slopes])
    np.testing.assert_allclose(found.normals[0], wanted / np.linalg.norm(wanted, axis=1, keepdims=True))


def test_a_patch_with_a_corner_at_nothing_has_no_place_and_every_ray_may_meet_it():
    corners = np.array([[1.0, bad, 1.0, 1.0] for bad in (np.nan, np.inf, 1.0)], np.float32)
    found = outline_patches(np.eye(4), np.zeros((3, 2), np.int32), corners)
    np.testing.assert_array_equal(found.placed, [False, False, True])
    grid = build_grid([found], 1.0)
    np.testing.assert_array_equal(grid.loose, [[0, 0, 0, 0], [1, 0, 0, 0]])
    assert set(grid.listed[:, 0]) == {2}


def test_a_grid_is_small_and_lists_patches_in_order():
    grid = surface_of(SCENES["thin"]).grid
    assert isinstance(grid, VoxelGrid)
    assert grid.bytes < 16e6
    assert len(grid.loose) == 0
    inner = np.ones(len(grid.listed), bool)
    inner[grid.starts[:-1]] = False
    assert (np.diff(grid.listed[:, 0])[inner[1:]] > 0).all()


def test_without_patches_nothing_is_met():
    surface = replace(surface_of(SCENES["dome"]), grid=build_grid([], 1.0))
    t, patches = cast(surface, np.zeros((3, 3)), np.eye(3))
    assert np.isinf(t).all()
    assert (patches == -1).all()
