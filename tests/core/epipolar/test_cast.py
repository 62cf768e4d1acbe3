"""Sweep and exact casts called directly, against trying every patch in float64."""

from __future__ import annotations

import epipolar_twin
import ldi_twin
import numpy as np
import pytest
from kernel_runs import on_all_thread_counts
from small_fields import CAMERAS, depth_image, empty_picture, layers, lies_between, relief

import ibrpipe
from ibrpipe.core.epipolar import cast, patches, sweep
from ibrpipe.core.epipolar import lines as el
from ibrpipe.renderers.fields import build_field
from ibrpipe.renderers.ldi.renderer import pack_rays
from ibrpipe.renderers.search.epipolar_lines import COARSENESS, EYE, FINEST, SPACING, height_map, patch_map
from ibrpipe.types import Camera

SOURCES = {"relief": relief(), "whole relief": relief((20, 12), holes=0.0), "layers": layers(), "wall": depth_image()}
LISTED = {"layers": SOURCES["layers"], "wall": SOURCES["wall"]}


def map_of(source):
    field = build_field(source)
    return height_map(field, 3) if hasattr(field, "height") else patch_map(field, 3)


def swept(one, camera, parts=2):
    start, turn = one.field.pose.field_from_pixel(camera)
    sectors, edges, entries = el.lay_lines(
        start, turn, one.field.pose.pixel_from_field(camera), (one.box[0], one.box[1]), (camera.width, camera.height),
        SPACING, FINEST, COARSENESS, (one.box[2], one.box[3]),
    )  # fmt: skip
    table, groups = np.full(entries, np.inf, np.float32), np.zeros(5, np.int64)
    table[0] = -np.inf
    groups[1:] = np.cumsum(-(-sectors[:, el.LINES].astype(np.int64) // sweep.GROUP))
    if groups[4]:
        sweep.sweep_lines(sectors, edges, one.nodes, one.meta, one.grid, groups, parts, table)
    return sectors, table


@pytest.mark.parametrize("view", CAMERAS)
@pytest.mark.parametrize("name", SOURCES)
def test_no_pixel_starts_after_its_hit(name, view):
    source, camera = SOURCES[name], CAMERAS[view]
    one = map_of(source)
    start, turn = one.field.pose.field_from_pixel(camera)
    sectors, table = swept(one, camera)
    hits, checked = ldi_twin.cast(source, camera, 0.0), 0
    for y, x in np.argwhere(np.isfinite(hits)):
        found = epipolar_twin.place_of_pixel(start, turn, sectors, x + 0.5, y + 0.5)
        if found is None:
            continue
        own, line, place = sectors[found[0]], *found[1:]
        along = float(table[int(own[el.FIRST] + line * own[el.LINE_STEP] + place * own[el.BIN_STEP])])
        assert along < np.inf
        axis = int(own[el.AXIS])
        edge = along if own[el.SIGN] > 0 else own[el.ALONG] - along
        Q = turn @ (x + 0.5, y + 0.5, 1.0)
        t = (edge * start[3] - start[axis]) / (Q[axis] - edge * Q[3])
        assert t <= hits[y, x] * (1 + 1e-6)
        checked += 1
    assert checked > 5


def cast_one(source, camera, lines=None, parts=2):
    one, (depth, ids) = map_of(source), empty_picture(camera)
    field, pyramid, view = one.field, (one.nodes, one.meta, one.grid), one.field.pose.field_from_pixel(camera)
    lines, eye = lines or swept(one, camera, parts), EYE * one.field.reach
    if hasattr(field, "height"):
        heights = (field.height.ravel(), field.height.shape[1])
        cast.cast_heights(heights, pyramid, view, one.box, eye, lines, one.base, parts, depth, ids)
    else:
        listed = (one.starts, field.corners, field.masks)
        patches.cast_patches(listed, pyramid, view, one.box, eye, lines, one.base, parts, depth, ids)
    return depth, ids


@pytest.mark.parametrize("view", CAMERAS)
@pytest.mark.parametrize("name", SOURCES)
def test_casts_equal_brute_force(name, view):
    source, camera = SOURCES[name], CAMERAS[view]
    depth, ids = on_all_thread_counts(lambda: cast_one(source, camera))
    lies_between(depth, *(ldi_twin.cast(source, camera, slack) for slack in (1e-6, -1e-6)))
    assert ((ids == 2**32 - 1) == np.isinf(depth)).all()
    assert ids.min() >= 3
    np.testing.assert_array_equal(cast_one(source, camera, parts=1)[0], depth)


@pytest.mark.parametrize("name", SOURCES)
def test_where_lines_let_rays_start_changes_nothing(name):
    source, camera = SOURCES[name], CAMERAS["front"]
    nowhere = np.zeros((4, el.SECTOR_SIZE)), np.array([-np.inf], np.float32)
    np.testing.assert_allclose(cast_one(source, camera, nowhere)[0], cast_one(source, camera)[0], rtol=1e-6)


@pytest.mark.parametrize("mask", [15, 1, 6, 0])
def test_one_ray_meets_one_patch_as_the_twin_does(mask):
    field, camera = build_field(layers()), Camera.look_at((2, 1, -9), (4, 3, 1.5), fov_y_deg=8, width=17, height=13)
    start, turn = field.pose.field_from_pixel(camera)
    view, depths = (pack_rays(start, turn), 0.0), np.array([1.1, 1.6, 1.3, 0.9])
    present, found = [bool(mask & (1 << k)) for k in range(4)], 0
    for y, x in np.ndindex(camera.height, camera.width):
        Q = turn @ (x + 0.5, y + 0.5, 1.0)
        want = [np.inf, np.inf]
        for n, slack in enumerate((1e-6, -1e-6)):
            for t, good in ldi_twin.roots(start, Q, 4.0, 3.0, depths, present, True, slack):
                want[n] = min(want[n], float(t)) if good else want[n]
        got = patches.meet_ray(x + 0.5, y + 0.5, 4.0, 3.0, tuple(depths), mask, 9.0, view)
        assert want[0] * (1 - 1e-9) <= got <= want[1] * (1 + 1e-9)
        found += got < np.inf
    assert (found > 0) == (mask > 0)


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_ray_along_an_axis_is_walked_forward_alone(axis, sign):
    """A direction that is exactly 0 across keeps the ray in its row: no hit beside it or behind its start."""
    height = np.ones((9, 9))
    height[6, 2], height[2, 6] = -6.0, -6.0
    one = map_of(relief_of(height if axis == 0 else height.T))
    field, pyramid = (one.field.height.ravel(), 9), (one.nodes, one.meta, one.grid)
    met = 0
    for across in (0.5, 2.5, 3.5, 4.0, 5.75):
        P, Q, inverse = np.array([4.0 - 6.0 * sign, across, 0.95]), np.array([sign, 0.0, 1e-3]), [sign, 1e290]
        order = [axis, 1 - axis, 2]
        i, j = np.array([0 if sign > 0 else 7, int(across)])[order[:2]]
        t0, t1, *_, i, j = cast.walk(
            field, pyramid, tuple(P[order]), tuple(Q[order]), tuple(inverse[k] for k in order[:2]), 2.0, 10.0, np.nan,
            i, j, (8.0, 8.0),
        )  # fmt: skip
        crossed = rows_crossed(height, across, P, Q)
        assert (i >= 0) == bool(crossed)
        if crossed:
            assert 2.0 <= t0 <= crossed[0] <= t1 <= 10.0
            met += 1
    assert met == 2


def relief_of(height):
    """The height field as a relief texture, cells one unit wide."""
    frame = ibrpipe.ParallelFrame((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1))
    return ibrpipe.ReliefTexture(frame, np.ones((*height.shape, 3)), height)


def rows_crossed(height, across, P, Q):
    """Where the ray, on the line `across`, crosses the field's profile: parameters t in [2, 10], ascending."""
    row, share = min(int(across), 7), across - min(int(across), 7)
    profile, t = (1 - share) * height[row] + share * height[row + 1], np.linspace(2.0, 10.0, 80001)
    above = P[2] + t * Q[2] - np.interp(P[0] + t * Q[0], np.arange(9.0), profile)
    return list(t[1:][(above[1:] > 0) != (above[:-1] > 0)])
