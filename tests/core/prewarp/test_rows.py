"""The pre-warp: exact factorisation of the 3-D warp, kernels against their twin, order, singular places."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from kernel_runs import on_all_thread_counts
from prewarp_twin import mean_over_pixels, paint_line, warp_cells, warp_plane, warp_wall

import ibrpipe
from ibrpipe.core.prewarp import area, equations, rows
from ibrpipe.renderers.prewarp.faces import plane_face, sight, wall_face
from ibrpipe.renderers.prewarp.passes import Settings, warp_face
from ibrpipe.renderers.prewarp.source import build_relief

RNG = np.random.default_rng(5)


def unit(v):
    return np.asarray(v, float) / np.linalg.norm(v)


@settings(deadline=None, max_examples=200)
@given(st.integers(0, 2**32 - 1))
def test_prewarp_then_homography_is_the_3d_warp(seed):
    rng = np.random.default_rng(seed)
    f = unit(rng.normal(size=3))
    a, b = 0.05 * rng.normal(size=(2, 3))
    if abs(np.linalg.det([unit(a), unit(b), f])) < 0.1:
        return
    origin = rng.normal(size=3)
    normal = unit(np.cross(a, b)) * np.sign(np.cross(a, b) @ f)
    eye = origin + 10 * (a + b) + (2 + 3 * rng.random()) * normal + 0.5 * rng.normal(size=3)
    camera = ibrpipe.Camera.look_at(eye, origin + 10 * (a + b), rng.normal(size=3))
    u, v = 20 * rng.random((2, 50))
    d = rng.uniform(-0.5, 0.5, 50)
    points = origin + np.outer(u, a) + np.outer(v, b) + np.outer(d, f)
    project = camera.K @ camera.cam_from_world
    whole = np.c_[points, np.ones(50)] @ project.T
    k = equations.coefficients(origin - camera.center, a, b, f)
    u_i, v_i = equations.prewarped(u, v, d, k)
    good = np.isfinite(u_i)
    flat = np.stack([u_i, v_i, np.ones(50)], 1) @ equations.plane_homography(origin, a, b, project).T
    want, got = whole[:, :2] / whole[:, 2:], flat[:, :2] / flat[:, 2:]
    size = np.maximum(1.0, np.abs(want))
    assert good.sum() > 5
    assert (np.abs(got - want)[good] / size[good]).max() < 1e-9


def test_coefficients_of_a_right_angled_frame_are_the_papers():
    a, b, f = 0.1 * np.eye(3)[0], 0.2 * np.eye(3)[1], np.eye(3)[2]
    c = np.array([0.3, -0.4, -2.0])
    k1, k2, k3 = equations.coefficients(c, a, b, f)
    assert k3 == pytest.approx(1 / (c @ f))
    assert k1 == pytest.approx((f @ np.cross(b, c)) / (a @ np.cross(b, c)))
    assert k2 == pytest.approx((f @ np.cross(c, a)) / (b @ np.cross(c, a)))


def test_eye_in_the_plane_and_texels_behind_the_eye_are_culled():
    k = equations.coefficients((0.0, 0.0, 0.0), *np.eye(3))
    assert not np.isfinite(k[2])
    k = equations.coefficients((0.0, 0.0, -2.0), *np.eye(3))
    u, _ = equations.prewarped(1.0, 1.0, np.array([1.9, 2.0, 2.5]), k)
    assert np.isfinite(u[0])
    assert np.isnan(u[1:]).all()


@settings(deadline=None, max_examples=200)
@given(st.integers(0, 2**32 - 1), st.booleans())
def test_of_two_samples_on_one_ray_the_nearer_is_nearer_to_the_foot(seed, behind):
    rng = np.random.default_rng(seed)
    eye = np.array([*rng.normal(size=2), -3.0 if behind else 3.0])
    way = np.array([*rng.normal(size=2), 1.0 if behind else -1.0])
    near, far = (eye + t * way for t in np.sort(rng.uniform(0.2, 5.0, 2)))
    k = equations.coefficients(-eye, *np.eye(3))
    for axis in range(2):
        meet = [equations.prewarped(*point, k)[axis] for point in (near, far)]
        assert meet[0] == pytest.approx(meet[1], abs=1e-9)
        assert abs(near[axis] - eye[axis]) <= abs(far[axis] - eye[axis])


def relief(height, gap=np.inf):
    frame = ibrpipe.ParallelFrame((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1))
    made = build_relief(ibrpipe.ReliefTexture(frame, np.ones((*height.shape, 3)), height))
    return made if gap == np.inf else type(made)(made.frame, made.height, made.color, gap, False)


def bumpy(rows, columns, holes=0.0):
    height = np.cumsum(RNG.normal(size=(rows, columns)), axis=1) * 0.4
    height = (height - height.min() + 0.5).astype(np.float32)
    height[RNG.random(height.shape) < holes] = np.nan
    return height


def agree(got, want, places, limit=1e-4):
    """Equal but for pixels whose centre lies at a segment's end, where rounding decides."""
    same = np.isnan(got) == np.isnan(want)
    close = np.abs(got - want) <= limit * (1 + np.abs(want))
    right = (same & (close | np.isnan(want))).mean()
    assert right > 1 - places, right


@pytest.mark.parametrize("eye", [(11.3, 7.9, 40.0), (-20.0, 9.0, 30.0), (60.0, -30.0, 25.0), (8.0, 90.0, 12.0)])
@pytest.mark.parametrize("holes", [0.0, 0.1])
@pytest.mark.parametrize("gap", [np.inf, 0.7])
def test_both_passes_equal_the_twin(eye, holes, gap):
    height = bumpy(17, 23, holes)
    source = relief(height, gap)
    camera = ibrpipe.Camera.look_at(eye, (11, 8, 0), (0, 1, 0), 150.0, 64, 64)
    view = sight(source.frame, camera)
    face = plane_face(view, 17, 23, 0.0)
    _, left, top, columns = warp_face(source, view, face)
    (shifts,) = on_all_thread_counts(lambda: (warp_face(source, view, face)[0][:, :columns].copy(),))
    x, y = np.arange(columns) + left + 0.5, np.arange(len(shifts)) + top + 0.5
    want = warp_plane(height.astype(float), eye, x, y, gap)
    inside = np.zeros(want.shape, bool)
    x0, x1, y0, y1 = face.window
    inside[np.ix_((y > y0) & (y < y1), (x > x0) & (x < x1))] = True
    agree(np.where(inside, shifts[:, :columns], 0), np.where(inside, want, 0), 0.02)


def test_rows_and_texels_without_displacement_equal_the_twin():
    height = bumpy(17, 23)
    height[:9] = 0.0
    height[:, 12:] = 0.0
    source, eye = relief(height), (11.3, 7.9, 40.0)
    view = sight(source.frame, ibrpipe.Camera.look_at(eye, (11, 8, 0), (0, 1, 0), 150.0, 64, 64))
    face = plane_face(view, 17, 23, 0.0)
    shifts, left, top, columns = warp_face(source, view, face)
    x, y = np.arange(columns) + left + 0.5, np.arange(len(shifts)) + top + 0.5
    inside = np.ix_((y > 0.5) & (y < 16.5), (x > 0.5) & (x < 22.5))
    agree(shifts[:, :columns][inside], warp_plane(height.astype(float), eye, x, y)[inside], 0.02)
    assert (shifts[:, :columns][inside][:6, 13:] == 0).all()


@pytest.mark.parametrize("eye", [(11.3, -9.0, 14.0), (30.0, 3.2, 9.0), (5.0, -100.0, 30.0)])
@pytest.mark.parametrize("holes", [0.0, 0.1])
def test_walls_equal_the_twin(eye, holes):
    height = bumpy(17, 23, holes)
    low, high = float(np.nanmin(height)), float(np.nanmax(height))
    source = relief(height)
    camera = ibrpipe.Camera.look_at(eye, (11, 16, 2), (0, 0, 1), 150.0, 64, 64)
    view = sight(source.frame, camera)
    face = wall_face(view, 23, 16.5, low, high, 0.25)
    shifts, left, top, columns = warp_face(source, view, face)
    x, y = np.arange(columns) + left + 0.5, low + 0.25 * (np.arange(len(shifts)) + top + 0.5)
    want = warp_wall(height.astype(float), eye, 16.5, x, y)
    agree(shifts[:, :columns], want, 0.02)


@pytest.mark.parametrize("eye", [(11.3, 7.9, 60.0), (-20.0, 9.0, 50.0)])
def test_pipelined_equals_the_twin_of_two_passes_where_nothing_folds(eye):
    y, x = np.mgrid[:17, :23]
    height = (1.5 + np.sin(0.4 * x) * np.cos(0.3 * y)).astype(np.float32)
    source = relief(height)
    camera = ibrpipe.Camera.look_at(eye, (11, 8, 0), (0, 1, 0), 150.0, 64, 64)
    view = sight(source.frame, camera)
    face = plane_face(view, 17, 23, 0.0)
    _, left, top, columns = warp_face(source, view, face, Settings("pipelined"))
    (shifts,) = on_all_thread_counts(
        lambda: (warp_face(source, view, face, Settings("pipelined"))[0][:, :columns].copy(),)
    )
    want = warp_plane(height.astype(float), eye, np.arange(columns) + left + 0.5, np.arange(len(shifts)) + top + 0.5)
    both = np.isfinite(shifts) & np.isfinite(want)
    assert both.mean() > 0.7
    assert (np.isfinite(shifts) != np.isfinite(want)).mean() < 0.01
    assert np.abs(shifts - want)[both].max() < 1e-4


@pytest.mark.parametrize("eye", [(11.3, 7.9, 40.0), (-20.0, 9.0, 30.0), (60.0, -30.0, 25.0)])
@pytest.mark.parametrize("holes", [0.0, 0.1])
def test_pipelined_fold_overs_equal_the_twin_that_compares_depths(eye, holes):
    height = bumpy(17, 23, holes)
    source = relief(height)
    view = sight(source.frame, ibrpipe.Camera.look_at(eye, (11, 8, 0), (0, 1, 0), 150.0, 64, 64))
    face = plane_face(view, 17, 23, 0.0)
    shifts, left, top, columns = warp_face(source, view, face, Settings("pipelined"))
    x, y = np.arange(columns) + left + 0.5, np.arange(len(shifts)) + top + 0.5
    want = warp_cells(height.astype(float), eye, x, y)
    x0, x1, y0, y1 = face.window
    inside = np.ix_((y > y0) & (y < y1), (x > x0) & (x < x1))
    agree(shifts[:, :columns][inside], want[inside], 0.02)


@pytest.mark.parametrize("step", [0.1, 0.45, 1.7])
def test_area_filter_takes_the_mean_over_pixels(step):
    count, texels = 16, 150
    places = (np.cumsum(RNG.uniform(0.2, 1.8, texels)) * step - 2.0).astype(np.float32)
    values = RNG.random((texels, 4)).astype(np.float32)
    line = np.stack([places, values[:, 3]])[:, None]
    sides = np.array([[0, texels - 1, 1, 1, 1], [0, texels - 1, 1, 1, 0]])
    out = np.empty((1, count, 4), np.float32)
    none = np.empty((0, 0), np.uint8)
    area.area_rows(line, values[None, :, :3].copy(), none, sides, float(count), np.array([0, 1]), out)
    for channel in range(4):
        mean, share = mean_over_pixels(places.astype(float), values[:, channel].astype(float), count)
        sure = np.abs(share - 0.5) > 0.01
        np.testing.assert_array_equal(np.isnan(out[0, sure, channel]), share[sure] < 0.5)
        good = share > 0.51
        assert good.sum() > 8
        np.testing.assert_allclose(out[0, good, channel], mean[good], atol=2e-3)


@pytest.mark.parametrize("e", [16.3, -5.0, 60.0])
@pytest.mark.parametrize("kind", ["whole", "holes", "broken", "coded", "careful", "zoomed", "flat", "flat holes"])
def test_rows_alone_equal_the_twin(kind, e):
    """`warp_rows` itself: what it reads, the rows and texels of its window, and nothing beside them."""
    rng, none = np.random.default_rng(6), np.empty((0, 0), np.uint8)
    height, count, ground, h = bumpy(7, 40, 0.1 if kind == "holes" else 0.0), 45, 0.3, 60.0
    codes, table, breaks = none, np.empty(0, np.float32), none
    if kind == "coded":
        codes = rng.integers(0, 256, height.shape).astype(np.uint8)
        table = np.where(np.arange(256) < 9, np.nan, rng.uniform(-0.02, 0.05, 256)).astype(np.float32)
    if kind == "broken":
        breaks = (rng.random(height.shape) < 0.15).astype(np.uint8)
    flat = none
    if "flat" in kind:  # row 1 all of it, row 2 its first chunk, row 3 none, row 4 all of it, row 5 its second chunk
        height[[1, 4]] = height[2, :33] = height[5, 32:] = ground
        height[2, 36] = np.nan if kind == "flat holes" else height[2, 36]
        flat = np.array([[0, 0], [1, 1], [1, 0], [0, 0], [1, 1], [0, 1], [0, 0]], np.uint8)
    zoom, shift = (1.7, -9.2) if kind == "zoomed" else (1.0, 2.1)
    shift = -3.4 if "flat" in kind else shift
    window = np.array([1, 6, 2, 37, count, kind == "careful"])

    def warped():
        out, marks = np.full((2, 9, 32), 7, np.float32), np.full((2, 9), 5, np.uint8)
        pose = np.array([e, h, ground]), np.array([zoom, shift])
        rows.warp_rows(height, codes, table, breaks, flat, *pose, window, out, marks)
        return out, marks

    out, marks = on_all_thread_counts(warped)
    assert (marks[:, [0, 6, 7, 8]] == 5).all()
    assert set(np.unique(marks[:, 1:6])) <= {0, 1}
    assert (out[marks == 1] == 7).all()
    if kind == "flat":
        assert marks[0, [1, 4]].tolist() == [1, 1]
    out = np.where((marks == 1)[..., None], np.float32(0), out)
    found = out.transpose(1, 0, 2).reshape(9, -1)
    assert (found[[0, 6, 7, 8]] == 7).all()
    assert (found[1:6, count:] == 0).all()
    d = height[1:6, 2:38].astype(float) - ground
    shifts = table[codes][1:6, 2:38].astype(float) if kind == "coded" else d / (h - d)
    joined = np.ones((5, 35), bool) if kind != "broken" else breaks[1:6, 2:37] == 0
    u, x = np.arange(2, 38) + 0.5, (np.arange(count) - shift) / zoom
    wanted = [warp_window(g, u, e, x, own) for g, own in zip(shifts, joined)]
    agree(found[1:6, :count], np.array(wanted), 0.02)
    assert np.isfinite(wanted).any()


def warp_window(shifts, u, e, x, joined):
    """One line of texels at u toward the foot `e`, from both sides."""
    places, last = u + (u - e) * shifts, len(u) - 1
    rising = [(i, i + 1) for i in range(last) if u[i] <= e and joined[i]]
    falling = [(i + 1, i) for i in range(last - 1, -1, -1) if u[i + 1] >= e and joined[i]]
    before = paint_line(places, shifts, lambda s: s < e, x, rising)
    return np.where(x < e, before, paint_line(places, shifts, lambda s: s >= e, x, falling))


@pytest.mark.parametrize("wall", [False, True])
@pytest.mark.parametrize("step", [0.3, 1.4])
def test_averaged_columns_take_the_mean_over_pixels(step, wall):
    """`area_columns` itself, on columns whose places rise; one column is empty, one is parted by a gap."""
    count, h, texels = 11, 30.0, 60
    v, values = np.arange(texels), RNG.uniform(0.02, 0.04, (texels, 4, 4)).astype(np.float32)
    values[..., :3] = RNG.random((texels, 4, 3))
    lines = np.stack([step * v - 2.0, np.full(texels, 3.0), RNG.random(texels)]).astype(np.float32)
    values[:, 1] = np.nan
    values[30:, 2, 3] += 0.2
    sides = np.array([[0, texels - 1, 1, 1, 1], [0, texels - 1, 1, 1, 0]])
    out = np.full((count + 4, 6, 4), 7, np.float32)
    area.area_columns(values, lines, wall, h, np.inf, sides, float(count), out)
    assert np.isnan(out[2:-2, 1]).all()
    assert (out[:, 4:] == 7).all()
    for column in (0, 2, 3):
        places = lines[0].astype(float) + lines[1] * values[:, column, 3].astype(float)
        if not (np.diff(places) > 0).all():
            continue
        carried = lines[2] if wall else values[:, column, 3]
        for channel, line in enumerate((*values[:, column, :3].T, carried)):
            mean, share = mean_over_pixels(places, line.astype(float), count)
            good = share > 0.51
            assert good.sum() > 8
            np.testing.assert_allclose(out[2:-2][good, column, channel], mean[good], atol=3e-3)
    parted = np.empty_like(out)
    area.area_columns(values, lines, wall, h, 0.1 if wall else 2.0, sides, float(count), parted)
    np.testing.assert_array_equal(parted[2:-2, 0], out[2:-2, 0])
    assert np.isnan(parted[2:-2, 2]).sum() >= np.isnan(out[2:-2, 2]).sum()
