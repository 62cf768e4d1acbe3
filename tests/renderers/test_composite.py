"""Frames put together by depth and coverage."""

from __future__ import annotations

import numpy as np
import pytest

import ibrpipe
from ibrpipe.errors import RendererError, ShapeError
from ibrpipe.types import Frame


def frame(color, depth, alpha, shape=(2, 3)):
    return Frame(
        np.tile(np.float32(color), (*shape, 1)),
        np.full(shape, depth, np.float32),
        None if alpha is None else np.full(shape, alpha, np.float32),
    )


def plain_over(layers):
    """One pixel of layers (colour, depth, alpha): a plain loop."""
    color, through, depth, farthest = np.zeros(3), 1.0, None, np.inf
    for tint, far, cover in sorted(layers, key=lambda each: each[1]):
        if cover > 0:
            color += through * cover * np.asarray(tint, float)
            through *= 1.0 - cover
            farthest = far
            depth = far if depth is None and through <= 0.5 else depth
    total = 1.0 - through
    return (color / total if total > 0 else color), (farthest if depth is None else depth), total


def test_frames_agree_with_a_loop_over_pixels():
    rng = np.random.default_rng(3)
    shape = (20, 30)
    depths = rng.uniform(1, 5, (4, *shape)).astype(np.float32)
    alphas = rng.choice(np.float32([0, 0.1, 0.5, 0.9, 1]), (4, *shape))
    depths[alphas == 0] = np.inf
    colors = rng.random((4, *shape, 3)).astype(np.float32)
    found = ibrpipe.composite([Frame(*each) for each in zip(colors, depths, alphas)])
    for y in range(shape[0]):
        for x in range(shape[1]):
            color, depth, alpha = plain_over(list(zip(colors[:, y, x], depths[:, y, x], alphas[:, y, x])))
            np.testing.assert_allclose(found.color[y, x], color, atol=1e-6)
            np.testing.assert_allclose(found.alpha[y, x], alpha, atol=1e-6)
            assert found.depth[y, x] == np.float32(depth)


def test_what_covers_half_shows_half_of_what_is_behind():
    near, far = frame((1, 0, 0), 1.0, 0.5), frame((0, 1, 0), 2.0, 1.0)
    for order in ([near, far], [far, near]):
        found = ibrpipe.composite(order)
        np.testing.assert_allclose(found.color[0, 0], [0.5, 0.5, 0])
        assert (found.alpha[0, 0], found.depth[0, 0]) == (1.0, 1.0)
    thin = ibrpipe.composite([frame((1, 0, 0), 1.0, 0.25), frame((0, 1, 0), 2.0, 0.25)])
    np.testing.assert_allclose(thin.color[0, 0], [4 / 7, 3 / 7, 0], atol=1e-6)
    assert (thin.alpha[0, 0], thin.depth[0, 0]) == (np.float32(0.4375), 2.0)


def test_opaque_frames_are_picked_to_the_bit_and_ties_go_to_the_first():
    one, two = frame((0.1, 0.2, 0.3), 1.0, 1.0), frame((0.7, 0.8, 0.9), 1.0, 1.0)
    np.testing.assert_array_equal(ibrpipe.composite([one, two]).color, one.color)
    np.testing.assert_array_equal(ibrpipe.composite([two, one]).color, two.color)


def test_what_is_not_covered_hides_nothing():
    found = ibrpipe.composite([frame((0, 0, 0), 1.0, 0.0), frame((0, 1, 0), 2.0, 1.0)])
    np.testing.assert_array_equal(found.color[0, 0], [0, 1, 0])
    assert found.depth[0, 0] == 2.0
    nothing = ibrpipe.composite([frame((9, 9, 9), np.inf, 0.0)] * 2)
    assert (nothing.color.max(), nothing.alpha.max(), nothing.depth.min()) == (0.0, 0.0, np.inf)


def test_cover_without_depth_takes_the_depth_beside_it_or_lies_behind_all():
    depth = np.full((3, 5), np.inf, np.float32)
    depth[1, 1] = 2.0
    rim = Frame(np.full((3, 5, 3), 0.5, np.float32), depth, np.full((3, 5), 0.5, np.float32))
    found = ibrpipe.composite([rim, frame((1, 0, 0), 3.0, 1.0, (3, 5))])
    np.testing.assert_allclose(found.color[0, 0], [0.75, 0.25, 0.25])
    np.testing.assert_array_equal(found.color[0, 4], [1, 0, 0])
    np.testing.assert_array_equal(found.depth[1], [2, 2, 2, 3, 3])


def test_frames_without_alpha_are_opaque():
    found = ibrpipe.composite([frame((1, 0, 0), 3.0, None), frame((0, 1, 0), 2.0, None)])
    np.testing.assert_array_equal(found.color[0, 0], [0, 1, 0])
    assert found.alpha is None


def test_frames_that_do_not_fit_are_told():
    with pytest.raises(RendererError, match="some frames hold alpha and some do not"):
        ibrpipe.composite([frame((1, 0, 0), 3.0, None), frame((0, 1, 0), 2.0, 1.0)])
    with pytest.raises(ShapeError, match="frames differ in size"):
        ibrpipe.composite([frame((1, 0, 0), 3.0, 1.0), frame((0, 1, 0), 2.0, 1.0, (3, 3))])
