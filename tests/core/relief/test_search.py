"""The pyramid, the searches and the colours of the relief renderer, kernel by kernel, against plain twins."""

from __future__ import annotations

import ldi_twin
import numpy as np
import pytest
from kernel_runs import on_all_thread_counts
from relief_twin import linear_binary
from small_fields import CAMERAS, lies_between, relief

from ibrpipe.core.ldi.quadtree import EMPTY, STEPS
from ibrpipe.core.relief import beam, exact, linear, pyramid, shade
from ibrpipe.renderers.relief.height_fields import build_field, pairs
from ibrpipe.renderers.relief.options import ReliefOptions
from ibrpipe.types import Camera

NOWHERE = np.empty((0, 0, 2))


@pytest.mark.parametrize("shape", [(2, 2), (3, 9), (70, 5)])
@pytest.mark.parametrize("gap", [np.inf, 1.5])
def test_blocks_equal_a_scan(shape, gap):
    rng = np.random.default_rng(0)
    height = (rng.random(shape) * 3).astype(np.float32)
    height[rng.random(shape) < 0.1] = np.nan
    plan, low, scale = pyramid.plan_blocks(shape[0] - 1, shape[1] - 1), -0.1, STEPS / 3.3
    nodes = np.full(pyramid.count_nodes(plan), 7, np.uint32)
    pyramid.pack_cells(height, low, scale, gap, plan, nodes)
    for level in range(1, plan[4] + 1):
        pyramid.halve_blocks(nodes, level, plan)
    four = np.full((4, plan[2], plan[3]), np.nan)
    four[:, : shape[0] - 1, : shape[1] - 1] = height[:-1, :-1], height[:-1, 1:], height[1:, :-1], height[1:, 1:]
    four[:, ~(np.ptp(four, axis=0) <= gap)] = np.nan
    for level in range(plan[4] + 1):
        size, first = 1 << level, pyramid.first_node(level, plan)
        for number, (j, i) in enumerate(np.ndindex(plan[2] >> level, plan[3] >> level)):
            own, node = four[:, j * size : (j + 1) * size, i * size : (i + 1) * size], int(nodes[first + number])
            if np.isnan(own).all():
                assert node == EMPTY
                continue
            least, greatest = (np.nanmin(own) - low) * scale, (np.nanmax(own) - low) * scale
            assert node & 0xFFFF <= least <= (node & 0xFFFF) + 1.02
            assert (node >> 16) - 1.02 <= greatest <= node >> 16


def rays_of(field, camera):
    start, turn = field.pose.field_from_pixel(camera)
    return np.ascontiguousarray(start[:3]), np.ascontiguousarray(turn[:3]).ravel()


def exactly(source, camera):
    field = build_field(source)
    plan, nodes = field.pyramid
    grid, window = field.grid.copy(), np.array([0, camera.width, 0, camera.height])
    grid[2], grid[3] = grid[0], grid[0] + STEPS / grid[1]
    depth = np.full((camera.height, camera.width), np.inf, np.float32)
    places = np.full((*depth.shape, 2), np.nan)
    exact.search_exact(
        pairs(field.height), nodes, plan, grid, *rays_of(field, camera), 0.0, field.whole, window, depth, places
    )
    return depth, places


@pytest.mark.parametrize("view", CAMERAS)
@pytest.mark.parametrize("holes", [0.0, 0.1])
def test_exact_hits_equal_brute_force(view, holes):
    source, camera = relief((12, 9), holes), CAMERAS[view]
    depth, places = on_all_thread_counts(lambda: exactly(source, camera))
    larger, smaller = (ldi_twin.cast(source, camera, slack) for slack in (1e-5, -1e-5))
    lies_between(depth, larger, smaller, tight=2e-5)
    field = build_field(source)
    start, turn = field.pose.field_from_pixel(camera)
    for y, x in np.argwhere(np.isfinite(depth)):
        want = start + float(depth[y, x]) * turn @ (x + 0.5, y + 0.5, 1.0)
        np.testing.assert_allclose(places[y, x], want[:2], atol=1e-4)
    assert np.isnan(places[np.isinf(depth)]).all()


def test_settled_depths_are_roots_of_their_patch():
    source, camera = relief((5, 6), holes=0.0), CAMERAS["front"]
    field = build_field(source)
    start, turn = rays_of(field, camera)
    buf, out, found = np.zeros(exact.SLOTS * exact.PITCH, np.float32), np.full(exact.LANES, -1.0), 0
    a, b, c, e = (float(field.height[2 + (k >> 1), 3 + (k & 1)]) for k in range(4))
    for slot, value in ((exact.C0, a), (exact.C1, b), (exact.C2, c), (exact.C3, e), (exact.COLUMN, 3), (exact.ROW, 2)):
        buf[slot : slot + exact.LANES] = value
    buf[exact.NEAR : exact.NEAR + exact.LANES] = 10.2
    exact.settle(start, turn, 4.0, 4.0, buf, out)
    for k, t in enumerate(out):
        u, v, d = start + t * turn.reshape(3, 3) @ (4.5 + k % exact.ACROSS, 4.5 + k // exact.ACROSS, 1.0)
        p, q = u - 3, v - 2
        over = d - ((a * (1 - p) + b * p) * (1 - q) + (c * (1 - p) + e * p) * q)
        if t != np.float64(np.float32(10.2)):
            found += 1
            assert abs(over) < 1e-6  # differences of corners are taken in float32, and p, q reach 4 cells
    assert found > exact.LANES // 2


@pytest.mark.parametrize("eye", [(2.13, 1.07, 11.1), (-9.1, 2.13, 5.57)])
def test_linear_search_equals_the_published_one(eye):
    """The published search knows fields seen from above alone."""
    source, camera = relief((12, 9), holes=0.0), Camera.look_at(eye, (4.1, 3.03, 1), width=17, height=13)
    field = build_field(source)
    plan, nodes = field.pyramid
    window = np.array([0, camera.width, 0, camera.height])
    depth = np.full((camera.height, camera.width), np.inf, np.float32)
    rays, pace = rays_of(field, camera), field.pace(camera, ReliefOptions(linear_steps=24, binary_steps=8))
    linear.search_linear(pairs(field.height), nodes, plan, field.grid, *rays, 1.0, pace, window, depth, NOWHERE)
    want = linear_binary(source, camera, 24, 8)
    same = np.isclose(depth, want, rtol=1e-4) | (np.isinf(depth) & np.isinf(want))
    assert np.isfinite(want).sum() > 12
    assert np.mean(~same) <= 0.02


@pytest.mark.parametrize("eye", [(4.1, 3.07, 11.1), (-9.1, 2.13, 5.57)])
def test_tiles_of_rays_along_the_normal_take_fewer_steps(eye):
    source, camera = relief((12, 9), holes=0.0), Camera.look_at(eye, (4.1, 3.03, 1), width=40, height=33)
    field, options = build_field(source), ReliefOptions(linear_steps=24, least_steps=6, binary_steps=8)
    plan, nodes = field.pyramid
    depth = np.full((camera.height, camera.width), np.inf, np.float32)
    pace, window = field.pace(camera, options), np.array([0, camera.width, 0, camera.height])
    rays = rays_of(field, camera)
    linear.search_linear(pairs(field.height), nodes, plan, field.grid, *rays, 1.0, pace, window, depth, NOWHERE)
    counts, pictures = set(), {}
    normal = source.frame.f
    for y, x in np.ndindex(3, 3):
        corners = np.array([[16 * x, 16 * y], [16 * x + 16, 16 * y], [16 * x, 16 * y + 16], [16 * x + 16, 16 * y + 16]])
        ways = camera.pixel_rays(corners.astype(float))
        grazing = (np.abs(ways @ normal) / np.linalg.norm(ways, axis=1)).min()
        steps = min(int(np.ceil(6 + 18 * (1 - grazing) - 1e-6)), 24)
        counts.add(steps)
        if steps not in pictures:
            pictures[steps] = linear_binary(source, camera, steps, 8)
        tile = slice(16 * y, 16 * y + 16), slice(16 * x, 16 * x + 16)
        want, found = pictures[steps][tile], depth[tile]
        same = np.isclose(found, want, rtol=1e-4) | (np.isinf(found) & np.isinf(want))
        assert np.mean(~same) <= 0.03
    assert len(counts) > 1
    assert min(counts) < (10 if eye[2] > 10 else 24)


def test_a_field_of_holes_is_nowhere():
    camera, height = CAMERAS["front"], np.full((5, 4), np.nan, np.float32)
    plan, nodes = pyramid.build_pyramid(height, 0.0, 100.0, np.inf)
    depth, window = np.full((13, 17), np.inf, np.float32), np.array([0, 17, 0, 13])
    rays = rays_of(build_field(relief()), camera)
    grid = np.array([0.0, 100.0, 0.0, STEPS / 100.0, 4.0])
    exact.search_exact(pairs(height), nodes, plan, grid, *rays, 0.0, False, window, depth, NOWHERE)
    assert np.isinf(depth).all()


def test_places_of_numbered_cells():
    field, camera = build_field(relief()), CAMERAS["front"]
    start, turn = field.pose.field_from_pixel(camera)
    depth, ids = np.full((13, 17), 10.0, np.float32), np.full((13, 17), 2**32 - 1, np.uint32)
    ids[5, 6], ids[7, 8] = 3 * 8 + 2, 0
    places = np.full((13, 17, 2), np.nan)
    shade.place_hits(depth, ids, np.uint32(8), start, turn, places)
    assert np.isfinite(places).sum() == 4
    for (y, x), (i, j) in (((5, 6), (2, 3)), ((7, 8), (0, 0))):
        u, v = (start + 10.0 * turn @ (x + 0.5, y + 0.5, 1.0))[:2]
        np.testing.assert_allclose(places[y, x], (np.clip(u, i, i + 1), np.clip(v, j, j + 1)), atol=1e-6)


def test_colours_are_means_of_the_known_corners():
    rng = np.random.default_rng(2)
    color = rng.random((5, 6, 4)).astype(np.float32)
    color[..., 3] = rng.random((5, 6)) < 0.6
    color[:2, :2, 3] = 0
    mine, places = rng.random((4, 5)) < 0.8, rng.random((4, 5, 2)) * (5.4, 4.4) - 0.2
    mine[0, 0], places[0, 0] = True, (0.5, 0.5)
    out, alpha = np.full((4, 5, 3), -1, np.float32), np.zeros((4, 5), np.float32)
    shade.color_heights(mine, places, color, out, alpha)
    assert alpha[0, 0] == 0
    for y, x in np.ndindex(4, 5):
        i, j = int(np.clip(places[y, x, 0], 0, 4)), int(np.clip(places[y, x, 1], 0, 3))
        p, q = np.clip(places[y, x] - (i, j), 0, 1)
        corners = color[[j, j, j + 1, j + 1], [i, i + 1, i, i + 1]].astype(float)
        weights = np.array([(1 - p) * (1 - q), p * (1 - q), (1 - p) * q, p * q]) * corners[:, 3]
        seen = mine[y, x] and weights.sum() > 0
        assert alpha[y, x] == seen
        want = weights @ corners[:, :3] / weights.sum() if seen else -np.ones(3)
        np.testing.assert_allclose(out[y, x], want, atol=1e-5)


@pytest.mark.parametrize("least", [0.0, 1.5, 100.0])
def test_a_ray_is_cut_off_where_it_passes_the_box(least):
    rng, (columns, rows, bottom, top) = np.random.default_rng(6), (7.0, 5.0, -1.0, 2.0)
    low, high = np.array([0.0, 0.0, bottom]), np.array([columns, rows, top])
    met_any = missed_any = 0
    for n in range(200):
        start, Q_of = rng.uniform(-4, 9, 3), rng.normal(size=9) * (rng.random(9) < 0.7)
        px, py = rng.uniform(0, 3, 2)
        way = Q_of.reshape(3, 3) @ (px, py, 1.0)
        ends = np.linspace(least, 40, 400_001) if n < 30 else None
        *found, near, length, met = beam.clip_ray(Q_of, start, px, py, least, columns, rows, bottom, top)
        enter, leave = least, np.inf
        for axis in range(3):
            if way[axis] == 0.0:
                leave = leave if low[axis] <= start[axis] <= high[axis] else -np.inf
            else:
                one, other = (low[axis] - start[axis]) / way[axis], (high[axis] - start[axis]) / way[axis]
                enter, leave = max(enter, min(one, other)), min(leave, max(one, other))
        assert met == (enter <= leave)
        if not met:
            assert (*found, near, length) == (0.0, 0.0, 0.0, 0.0, -1.0)
            missed_any += 1
            continue
        np.testing.assert_allclose((*found, near), (*way, enter), rtol=1e-9, atol=1e-12)
        assert length == pytest.approx(leave - enter, rel=1e-9) or not way.any()
        if ends is not None and leave < 40:
            points = start + ends[:, None] * way
            inside = ends[((points >= low) & (points <= high)).all(axis=1)]
            assert inside.min() == pytest.approx(near, abs=1e-3)
            assert inside.max() == pytest.approx(near + length, abs=1e-3)
        met_any += 1
    assert missed_any > 20
    assert met_any > 12 or least == 100.0
