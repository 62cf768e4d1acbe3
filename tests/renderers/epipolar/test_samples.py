"""The sampled searches of `epipolar` against a plain twin, and how far they are from the exact one."""

from __future__ import annotations

import epipolar_twin
import numpy as np
import pytest
from kernel_runs import on_all_thread_counts

import ibrpipe
from ibrpipe.core.epipolar import lines as el
from ibrpipe.errors import RendererError
from ibrpipe.renderers.epipolar import samples
from ibrpipe.types import Camera, DepthImage, ParallelFrame, ReliefTexture

EYES = [(9, 7, 30), (-20, 8.3, 9.1), (8.2, -13, 5), (30, 24, 12), (8.6, 7.7, -20)]


def smooth(n=16, holes=False):
    y, x = np.mgrid[:n, : n + 3]
    height = 1.5 + np.sin(0.5 * x) * np.cos(0.4 * y)
    if holes:
        height[5:8, 4:9] = np.nan
    color = np.stack([x / (n + 3), y / n, np.full(x.shape, 0.5)], 2)
    return ReliefTexture(ParallelFrame((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)), color, height)


def ball(camera):
    """A ball before nothing, as a depth image."""
    y, x = np.mgrid[: camera.height, : camera.width] + 0.5
    ways = np.stack([x, y, np.ones_like(x)], -1) @ camera.world_from_pixel.T
    a, b, c = (ways**2).sum(-1), ways @ camera.center, camera.center @ camera.center - 1.0
    square = b * b - a * c
    depth = np.where(square > 0, (-b - np.sqrt(np.maximum(square, 0))) / a, np.inf)
    return DepthImage(camera, np.full((*depth.shape, 3), 0.5), depth.astype(np.float32))


def laid(source, camera):
    raster = ibrpipe.prepare(source, "epipolar").data.rasters[0][1]
    start, directions = raster.pose.field_from_pixel(camera)
    rows, columns = raster.depth.shape
    sectors, edges, _ = el.lay_lines(
        start, directions, raster.pose.pixel_from_field(camera), (columns - 1, rows - 1), (camera.width, camera.height),
        samples.SPACING["nearest"], samples.FINEST["nearest"], 0.0,
    )  # fmt: skip
    return raster, start, directions, sectors, edges


@pytest.mark.parametrize("eye", EYES)
@pytest.mark.parametrize("holes", [False, True])
def test_nearest_equals_the_twin(eye, holes):
    source, camera = smooth(holes=holes), Camera.look_at(eye, (9, 8, 1), fov_y_deg=50, width=37, height=29)
    raster, start, directions, sectors, edges = laid(source, camera)
    weight = raster.pose.pixel_from_field(camera)[2]
    want = epipolar_twin.nearest(start, directions, weight, False, sectors, edges, raster.depth, raster.steps, (37, 29))
    got = ibrpipe.render(source, camera, "epipolar", search="nearest").depth
    same = np.isclose(got, want, rtol=1e-5) | (np.isinf(got) & np.isinf(want))
    assert np.isfinite(want).sum() > 50
    assert np.mean(~same) <= 0.002  # ties of rounding


def test_nearest_equals_the_twin_on_depth_images():
    camera = Camera.look_at((0, -3, 1), (0, 0, 0), width=24, height=20)
    source = ball(camera)
    for eye in ((0.6, -3, 0.8), (0, -2.5, 1), (0, -4, 1.4), (1, -2.5, 1.6)):
        view = Camera.look_at(eye, (0, 0, 0), width=33, height=27)
        raster, start, directions, sectors, edges = laid(source, view)
        weight = raster.pose.pixel_from_field(view)[2]
        want = epipolar_twin.nearest(
            start, directions, weight, True, sectors, edges, raster.depth, raster.steps, (33, 27)
        )
        got = ibrpipe.render(source, view, "epipolar", search="nearest").depth
        same = np.isclose(got, want, rtol=1e-5) | (np.isinf(got) & np.isinf(want))
        assert np.isfinite(want).sum() > 50
        assert np.mean(~same) <= 0.004


@pytest.mark.parametrize("eye", EYES)
def test_every_pixel_that_meets_the_map_lies_once_in_the_table_of_lines(eye):
    camera = Camera.look_at(eye, (9, 8, 1), fov_y_deg=50, width=37, height=29)
    source = smooth()
    _, start, directions, sectors, _ = laid(source, camera)
    y, x = np.mgrid[:29, :37] + 0.5
    p = np.stack([x, y, np.ones_like(x)])
    w = np.einsum("ij,jyx->iyx", start[3] * directions[:2] - np.outer(start[:2], directions[3]), p)
    claims = np.zeros(x.shape, int)
    for number, own in enumerate(sectors):
        along, across = (w[0], w[1]) if number < 2 else (w[1], w[0])
        inside = (np.abs(along) >= np.abs(across)) if number < 2 else (np.abs(along) > np.abs(across))
        inside &= (along < 0) if number & 1 else (along > 0)
        if own[el.USED]:
            with np.errstate(divide="ignore"):  # at the epipole
                line = np.tensordot(own[0:3], p, 1) / np.tensordot(own[3:6], p, 1)
            place = np.tensordot(own[6:9], p, 1)
            claims += inside & (line >= 0) & (line < own[el.LINES]) & (place >= 0) & (place < own[el.BINS])
    hit = np.isfinite(ibrpipe.render(source, camera).depth)
    assert hit.sum() > 50
    assert (claims[hit] == 1).all()
    assert claims.max() == 1


@pytest.mark.parametrize("eye", EYES)
def test_only_lines_that_cross_the_map_are_laid(eye):
    """Seen from afar, or beside the map, most lines of the picture pass it by."""
    camera = Camera.look_at(np.array(eye) * 6 - (45, 40, 5), (9, 8, 1), fov_y_deg=70, width=320, height=240)
    _, start, _, sectors, _ = laid(smooth(), camera)
    columns, rows = 18, 15
    for own in sectors[sectors[:, el.USED] > 0]:
        axis = int(own[el.AXIS])
        length, breadth = (rows, columns) if axis else (columns, rows)
        along = length - start[axis] if own[el.SIGN] < 0 else start[axis]
        place = own[el.EDGE] + own[el.WIDTH] * np.arange(own[el.LINES] + 1)
        columns_met = np.linspace(max(along, 0), length, 50)[:, None]
        across = start[1 - axis] + (place - start[1 - axis]) * (columns_met - along) / (length - along)
        middle = 0.5 * (across[:, 1:] + across[:, :-1])
        room = el.MARGIN + own[el.WIDTH]
        assert ((middle > -room) & (middle < breadth + room)).any(0).all()


@pytest.mark.parametrize("search", ["nearest", "linear"])
@pytest.mark.parametrize("eye", EYES)
def test_sampled_searches_are_near_the_exact_one(search, eye):
    source, camera = smooth(64), Camera.look_at(np.array(eye) * 4, (36, 32, 1), fov_y_deg=30, width=120, height=90)
    exact = ibrpipe.render(source, camera, "epipolar")
    got = ibrpipe.render(source, camera, "epipolar", search=search)
    both = np.isfinite(exact.depth) & np.isfinite(got.depth)
    assert np.mean(np.isfinite(exact.depth) != np.isfinite(got.depth)) < 0.03
    error = np.abs(got.depth[both] - exact.depth[both])
    assert np.median(error) < (
        0.02 if search == "linear" else 1.0
    )  # texels; half a texel in plan is more along the ray
    # they do sample, but where rays move by under two texels within the map's depths linear walks texel by texel
    walked = search == "linear" and eye in (EYES[0], EYES[4])
    assert np.median(error) == 0 if walked else np.median(error) > 0
    assert np.median(np.abs(got.color[both] - exact.color[both])) < 0.02


def test_thread_count_changes_no_byte():
    source = ibrpipe.prepare(
        [smooth(holes=True), ball(Camera.look_at((0, -3, 1), (0, 0, 0), width=24, height=20))], "epipolar"
    )
    camera = Camera.look_at((9, -12, 14), (6, 6, 1), width=61, height=47)
    for search in ("nearest", "linear"):

        def compute(search=search):
            frame = ibrpipe.render(source, camera, "epipolar", search=search)
            return frame.depth, frame.color

        on_all_thread_counts(compute)


def test_unknown_search():
    with pytest.raises(RendererError, match="choose among: exact, nearest, linear"):
        ibrpipe.render(smooth(), Camera.look_at((9, 7, 30), (9, 8, 1)), "epipolar", search="fast")


def test_steps_of_a_depth_image_are_not_bridged():
    camera = Camera.look_at((0, -3, 0), (0, 0, 0), width=40, height=40)
    depth = np.full((40, 40), 5.0, np.float32)
    depth[10:30, 10:30] = 2.0
    source = DepthImage(camera, np.full((40, 40, 3), 0.5), depth)
    view = Camera.look_at((0.8, -3, 0), (0.8, 0, 0), width=40, height=40)
    for search in ("nearest", "linear"):
        seen = ibrpipe.render(source, view, "epipolar", search=search).depth
        there = np.isfinite(seen)
        assert np.isclose(seen[there], 2.0, atol=0.1).sum() > 100
        assert np.mean(np.isclose(seen[there], 2.0, atol=0.1) | np.isclose(seen[there], 5.0, atol=0.1)) > 0.98


@pytest.mark.parametrize("search", ["exact", "nearest"])
def test_frames_do_not_share_memory(search):
    """Working memory that is kept from frame to frame leaves earlier frames, and smaller ones after it, as they are."""
    source = ibrpipe.prepare(smooth(), "epipolar")
    wide, small = (Camera.look_at((9, -12, 14), (9, 8, 1), width=w, height=40) for w in (60, 30))
    first = ibrpipe.render(source, wide, "epipolar", search=search)
    kept = first.depth.copy(), first.color.copy()
    alone = ibrpipe.render(source, small, "epipolar", search=search)
    again = ibrpipe.render(source, wide, "epipolar", search=search)
    np.testing.assert_array_equal(first.depth, kept[0])
    np.testing.assert_array_equal(first.color, kept[1])
    np.testing.assert_array_equal(again.depth, kept[0])
    np.testing.assert_array_equal(alone.depth, ibrpipe.render(source, small, "epipolar", search=search).depth)


@pytest.mark.parametrize("search", ["nearest", "linear"])
def test_coincident_eyes_and_forward_motion_lose_nothing(search):
    reference = Camera.look_at((0.3, -0.2, 6.0), (0, 0, 0), (0, 1, 0), 40.0, 40, 30)
    y, x = np.mgrid[:30, :40]
    depth = 5.0 + 0.3 * np.sin(0.3 * x) + 0.2 * np.cos(0.4 * y)
    source = DepthImage(reference, np.full((30, 40, 3), 0.5), depth)
    for share, most in ((0.0, 0.02), (0.5, 0.03)):
        eye = reference.center + share * 5.0 * reference.R[2]
        view = Camera.look_at(eye, eye + reference.R[2], (0, 1, 0), 30.0, 61, 47)
        exact = ibrpipe.render(source, view, "epipolar").depth
        seen = ibrpipe.render(source, view, "epipolar", search=search).depth
        assert np.isfinite(exact).all()
        assert np.isfinite(seen).all()
        assert np.abs(seen - exact).mean() < most * 5.0 * (1.0 if search == "nearest" else 0.2)


@pytest.mark.parametrize("search", ["nearest", "linear"])
def test_eye_right_above_a_texel_sees_the_texel(search):
    source = smooth()
    view = Camera.look_at((8.3, 7.2, float(source.height[7, 8]) + 0.4), (12, 9, 0.5), fov_y_deg=60, width=37, height=29)
    exact, seen = (ibrpipe.render(source, view, "epipolar", search=name).depth for name in ("exact", search))
    assert np.mean(np.isfinite(exact) & np.isinf(seen)) < 0.02


@pytest.mark.parametrize("search", ["nearest", "linear"])
def test_hits_near_a_vanishing_point_are_kept_where_the_way_to_it_is_long(search):
    """Far rows are met within a texel of where the ray ends in the map, near ones many texels before it."""
    reference = Camera.look_at((0, 0, 0), (0, 1, 0), (0, 0, 1), 50.0, 40, 30)
    depth = np.geomspace(30.0, 2.0, 30)[:, None] * np.ones((1, 40))
    source = DepthImage(reference, np.full((30, 40, 3), 0.5), depth)
    view = Camera.look_at((0.3, -0.1, 0.3), (0, 60, 0), (0, 0, 1), 45.0, 61, 47)
    exact, seen = (ibrpipe.render(source, view, "epipolar", search=name).depth for name in ("exact", search))
    assert np.isfinite(exact).mean() > 0.95
    assert np.mean(np.isfinite(exact) != np.isfinite(seen)) < 0.005
    both = np.isfinite(exact) & np.isfinite(seen)
    assert (np.abs(np.log(seen[both] / exact[both])) < 2 * np.log(15.0) / 29).all()  # rows of the map
