"""Pre-warped planes as the camera sees them: depth, owner, colour and averaged pictures against their twins."""

from __future__ import annotations

import numpy as np
import prewarp_twin as twin
import pytest
from kernel_runs import on_all_thread_counts

from ibrpipe.core.prewarp.area import view_area
from ibrpipe.core.prewarp.view import NOBODY, view_color, view_depth, view_owner

SHAPE = (14, 19)
#: a plane of 9 x 7 pixels, seen aslant; rows x, y, weight, weight of depth
HOMOGRAPHY = np.array([[0.6, 0.05, -1.7], [-0.04, 0.62, -0.9], [0.004, -0.009, 1.1], [0, 0, 3.0]])
BOUNDS = np.array([0.4, 6.8, 0.2, 8.6, 7, 9])
CASES = {
    "all": (HOMOGRAPHY, BOUNDS),
    "partly behind": (HOMOGRAPHY * [[1], [1], [1], [1]] - [[0] * 3, [0] * 3, [0.09, 0, 0], [0] * 3], BOUNDS),
    "nothing": (HOMOGRAPHY, np.array([3.0, 2.0, 0.2, 8.6, 7, 9])),
}


def shifts(holes=0.1, seed=0):
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[:9, :7]
    out = (0.2 * np.sin(x) * np.cos(0.7 * y) + 0.5 * (x > 4)).astype(np.float32)
    out[rng.random(out.shape) < holes] = np.nan
    out[2, 2] = -1.5  # behind the eye
    return out


def same(found, wanted, share=0.985):
    """Equal but for pixels on an edge, where rounding decides."""
    assert np.isclose(found, wanted, rtol=2e-4, atol=2e-4, equal_nan=True).mean() > share


@pytest.mark.parametrize("jump", [np.inf, 0.1])
@pytest.mark.parametrize("case", CASES)
def test_depth_equals_the_twin_whatever_the_threads(case, jump):
    homography, bounds = CASES[case]
    rng, wide = np.random.default_rng(1), np.full((9, 11), 7, np.float32)
    wide[:, :7] = shifts()
    before = rng.uniform(1.5, 4, SHAPE).astype(np.float32)
    before[rng.random(SHAPE) < 0.5] = np.inf

    def seen(fresh):
        out = before.copy()
        view_depth(wide.ravel(), 11, homography, bounds, jump, fresh, out)
        return (out,)

    wanted = twin.view_depth(shifts(), homography, bounds, jump, SHAPE)
    same(on_all_thread_counts(lambda: seen(True))[0], wanted)
    same(seen(False)[0], np.minimum(wanted, before))
    assert np.isfinite(wanted).any() == (case != "nothing")
    assert np.isinf(wanted).any()


@pytest.mark.parametrize("case", ["all", "nothing"])
def test_owner_is_that_of_the_nearest_pixel(case):
    homography, bounds = CASES[case]
    owners = np.random.default_rng(2).integers(0, 4, (9, 7)).astype(np.uint8)
    owners[owners == 3] = NOBODY
    out = np.full(SHAPE, 77, np.uint8)
    view_owner(owners, homography, bounds, out)
    wanted = np.full(SHAPE, 77)
    for y, x, u, v, _ in twin.plane_points(homography, bounds, SHAPE):
        owner = owners[min(int(v), 8), min(int(u), 6)]
        wanted[y, x] = 77 if owner == NOBODY else owner
    same(out, wanted)
    assert len(set(wanted.ravel())) == (4 if case == "all" else 1)


def texture(rows, columns):
    color = np.random.default_rng(3).random((rows, columns, 3)).astype(np.float32)
    return color, np.concatenate([color, np.zeros((rows, columns, 1), np.float32)], axis=2).reshape(-1, 4)


@pytest.mark.parametrize("shape", [(9, 7), (1, 6), (5, 1), (1, 1)])
@pytest.mark.parametrize("whose", ["first", "nearer", "owned"])
def test_colour_equals_the_twin(shape, whose):
    rng = np.random.default_rng(4)
    depth = rng.uniform(2, 4, SHAPE).astype(np.float32)
    depth[rng.random(SHAPE) < 0.2] = np.inf
    before = np.where(rng.random(SHAPE) < 0.5, depth, np.float32(np.inf)) if whose == "nearer" else np.empty((0, 0))
    owner = rng.integers(0, 2, SHAPE).astype(np.uint8) if whose == "owned" else np.empty((0, 0), np.uint8)
    ways, eye = np.array([[0.12, 0.01, -0.4], [0.0, 0.17, -0.3]]), np.array([2.0, 1.0])
    color, packed = texture(*shape)
    size = np.array(shape)

    def drawn():
        out, alpha = np.full((*SHAPE, 3), 5, np.float32), np.full(SHAPE, 5, np.float32)
        view_color(depth, before.astype(np.float32), owner, 1, ways, eye, packed, size, out, alpha)
        return out, alpha

    out, alpha = on_all_thread_counts(drawn)
    mine = np.isfinite(depth)
    mine &= {"first": True, "nearer": ~(before == depth) if before.size else True, "owned": owner == 1}[whose]
    wanted = twin.view_color(depth, ways, eye, color)
    np.testing.assert_allclose(out[mine], wanted[mine], atol=1e-5)
    rest = 0 if whose == "first" else 5  # a first texture writes what it does not cover, too
    assert (out[~mine] == rest).all()
    np.testing.assert_array_equal(alpha, np.where(mine, 1, rest))
    assert 0 < mine.sum() < mine.size


@pytest.mark.parametrize("jump", [np.inf, 0.1])
@pytest.mark.parametrize("case", CASES)
def test_averaged_pictures_equal_the_twin(case, jump):
    homography, bounds = CASES[case]
    picture = np.random.default_rng(5).random((9, 8, 4)).astype(np.float32)
    picture[:, :7, 3] = shifts()
    picture[np.isnan(picture[..., 3])] = np.nan

    def drawn():
        depth = np.full(SHAPE, 2.9, np.float32)
        depth[:5] = np.inf
        color, alpha = np.zeros((*SHAPE, 3), np.float32), np.zeros(SHAPE, np.float32)
        view_area(picture, homography, bounds, jump, depth, color, alpha)
        return depth, color, alpha

    depth, color, alpha = on_all_thread_counts(drawn)
    wanted, colors = twin.view_area(picture[:, :7], homography, bounds, jump, SHAPE)
    before = np.where(np.arange(SHAPE[0])[:, None] < 5, np.inf, 2.9) + np.zeros(SHAPE)
    same(depth, np.minimum(wanted, before))
    nearer = wanted < before
    same(alpha, nearer)
    same(color, np.where(nearer[..., None], colors, 0))
    bare = np.full(SHAPE, np.inf, np.float32)
    view_area(picture, homography, bounds, jump, bare, np.empty((0, 0, 3), np.float32), np.empty((0, 0), np.float32))
    same(bare, wanted)  # without colours only the depth is lowered
