"""The sampled searches called directly: nearest samples against the twin, interpolated ones against the surface."""

from __future__ import annotations

import epipolar_twin
import ldi_twin
import numpy as np
import pytest
from small_fields import FRAME, depth_image, empty_picture

from ibrpipe.core.epipolar import lines as el
from ibrpipe.core.epipolar import near, samples, sweep
from ibrpipe.renderers.epipolar.samples import FINEST, SPACING, _within, build_raster
from ibrpipe.renderers.fields import build_field
from ibrpipe.types import Camera, ReliefTexture

EYES = {"front": (7.31, 6.73, 22), "low": (-14, 6.3, 7.1), "epipole": (6.6, 5.7, -15), "within": (5.2, 4.1, 1.6)}


def smooth(holes=False, n=11):
    y, x = np.mgrid[:n, : n + 3]
    height = 1.5 + np.sin(0.5 * x) * np.cos(0.4 * y)
    if holes:
        height[5:8, 4:9] = np.nan
    color = np.stack([x / (n + 3), y / n, np.full(x.shape, 0.5)], 2)
    return ReliefTexture(FRAME, color, height)


SOURCES = {"relief": smooth(), "holes": smooth(True), "wall": depth_image()}


def camera_of(name):
    target = (6.6, 6.0, 1.5) if name != "within" else (9.0, 8.0, 1.2)
    return Camera.look_at(EYES[name], target, fov_y_deg=30 if name == "low" else 55, width=23, height=17)


def laid(source, camera, linear):
    field = build_field(source)
    raster = build_raster(source, field, 1e-9 * field.reach)
    start, turn = raster.pose.field_from_pixel(camera)
    pixels, (rows, columns) = raster.pose.pixel_from_field(camera), raster.depth.shape
    search = "linear" if linear else "nearest"
    sectors, edges, entries = el.lay_lines(
        start, turn, pixels, (columns - 1, rows - 1), (camera.width, camera.height), SPACING[search], FINEST[search],
        0.0,
    )  # fmt: skip
    return raster, (start, turn, pixels[2], raster.pose.perspective), sectors, edges, entries


def searched(source, camera, linear, parts=2):
    raster, view, sectors, edges, entries = laid(source, camera, linear)
    own, depth, ids = (raster.depth.ravel(), raster.depth.shape[1], raster.steps), *empty_picture(camera)
    near.meet_near(own, view, linear, _within(raster, view[0]), raster.ends, raster.eye, 4, depth, ids)
    table, groups = np.full(entries, np.inf, np.float32), np.zeros(5, np.int64)
    groups[1:] = np.cumsum(-(-sectors[:, el.LINES].astype(np.int64) // sweep.GROUP))
    samples.sweep_samples(sectors, edges, own[0], own[1], linear, raster.gaps, raster.steps, groups, parts, table)
    reach = raster.ends[1] - raster.ends[0]
    samples.pick_samples(own, view, (sectors, table), linear, reach, raster.eye, 4, parts, depth, ids)
    return raster, view, depth, ids


@pytest.mark.parametrize("eye", ["front", "low", "epipole"])
@pytest.mark.parametrize("name", ["relief", "holes"])
def test_nearest_samples_equal_the_twin(name, eye):
    source, camera = SOURCES[name], camera_of(eye)
    raster, view, depth, ids = searched(source, camera, False)
    _, _, sectors, edges, _ = laid(source, camera, False)
    want = epipolar_twin.nearest(*view, sectors, edges, raster.depth, raster.steps, (23, 17))
    same = np.isclose(depth, want, rtol=1e-5) | (np.isinf(depth) & np.isinf(want))
    assert np.isfinite(want).sum() > 30
    assert np.mean(~same) <= 0.005  # ties of rounding
    hit = ids[np.isfinite(depth)].astype(int) - 4
    assert np.isfinite(raster.depth.ravel()[hit]).all()
    np.testing.assert_array_equal(searched(source, camera, False, parts=1)[2], depth)


@pytest.mark.parametrize("eye", ["front", "low", "epipole", "within"])
def test_interpolated_samples_lie_on_the_surface(eye):
    camera = camera_of(eye)
    _, _, depth, _ = searched(SOURCES["relief"], camera, True)
    want = ldi_twin.cast(SOURCES["relief"], camera, 0.0)
    both = np.isfinite(depth) & np.isfinite(want)
    assert both.sum() > 30
    assert np.mean(np.isfinite(depth) != np.isfinite(want)) < 0.04
    assert np.mean(np.abs(depth[both] - want[both]) < 0.15) > 0.9


def test_rays_that_are_short_in_the_reference_meet_their_samples():
    source = SOURCES["wall"]
    camera = source.camera.resized(16, 14)
    raster, view, *_ = laid(source, camera, False)
    own, depth, ids = (raster.depth.ravel(), raster.depth.shape[1], raster.steps), *empty_picture(camera)
    near.meet_near(own, view, False, False, raster.ends, raster.eye, 0, depth, ids)
    want = np.repeat(np.repeat(source.depth, 2, 0), 2, 1)
    np.testing.assert_array_equal(np.isfinite(depth), np.isfinite(want))
    np.testing.assert_allclose(depth[np.isfinite(depth)], want[np.isfinite(want)], rtol=1e-5)


def test_nothing_but_background_is_nowhere():
    camera = camera_of("front")
    raster, view, sectors, edges, entries = laid(SOURCES["relief"], camera, True)
    flat, (depth, ids) = np.full(raster.depth.size, np.nan, np.float32), empty_picture(camera)
    own, table = (flat, raster.depth.shape[1], raster.steps), np.full(entries, np.inf, np.float32)
    near.meet_near(own, view, True, True, raster.ends, raster.eye, 0, depth, ids)
    groups = np.cumsum([0, *-(-sectors[:, el.LINES].astype(np.int64) // sweep.GROUP)])
    samples.sweep_samples(sectors, edges, flat, own[1], True, True, raster.steps, groups, 1, table)
    samples.pick_samples(own, view, (sectors, table), True, 2.0, raster.eye, 0, 1, depth, ids)
    assert np.isinf(table).all()
    assert np.isinf(depth).all()


@pytest.mark.parametrize("linear", [False, True])
def test_colours_are_those_of_the_samples(linear):
    camera = camera_of("front")
    raster, view, depth, ids = searched(SOURCES["holes"], camera, linear)
    out, known = np.full((*depth.shape, 3), -1, np.float32), np.zeros(depth.shape, np.float32)
    start, turn = view[:2]
    flat, stride, color = raster.depth.ravel(), raster.depth.shape[1], raster.color
    samples.shade_samples(depth, ids, 4, start, turn, flat, stride, color, linear, out, known)
    np.testing.assert_array_equal(known > 0, np.isfinite(depth))
    assert (out[np.isinf(depth)] == -1).all()
    for y, x in np.argwhere(np.isfinite(depth)):
        v, u = divmod(int(ids[y, x]) - 4, stride)
        want = color[v, u]
        if linear:
            place = start + float(depth[y, x]) * turn @ (x + 0.5, y + 0.5, 1.0)
            p, r = place[:2] / place[3]
            i, j = int(np.clip(np.floor(p), 0, stride - 2)), int(np.clip(np.floor(r), 0, len(color) - 2))
            corners = [(j + (k >> 1), i + (k & 1)) for k in range(4)]
            weights = np.array([max(1 - abs(p - m), 1e-6) * max(1 - abs(r - n), 1e-6) for n, m in corners])
            weights *= [np.isfinite(raster.depth[at]) for at in corners]
            if weights.sum() == 0:
                continue
            want = weights @ [color[at] for at in corners] / weights.sum()
        np.testing.assert_allclose(out[y, x], want, atol=1e-5)
