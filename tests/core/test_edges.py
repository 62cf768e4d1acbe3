"""Pixels that show an edge, against a plain loop over pixels."""

from __future__ import annotations

import numpy as np
import pytest

from ibrpipe.core import edges


def found(depth, known):
    shape = (depth.shape[0] + 4, depth.shape[1] + 4)
    inverse, colored, out = np.empty(shape, np.float32), np.empty(shape, np.uint8), np.full(depth.shape, 9, np.uint8)
    edges.invert_depths(depth, known, inverse, colored)
    edges.find_edges(inverse, colored, out)
    return inverse, colored, out


def at(picture, y, x):
    return picture[min(max(y, 0), picture.shape[0] - 1), min(max(x, 0), picture.shape[1] - 1)]


def steps(values):
    before, one, two, after = (float(value) for value in values)
    foretold = min(abs(one - before), abs(after - two))
    return abs(two - one) > 0.003 * max(one, two) + 2.0 * foretold


def twin(depth, known):
    with np.errstate(divide="ignore"):
        inverse = (np.float32(1) / depth).astype(np.float32)
    out = np.zeros(depth.shape, bool)
    for y, x in np.ndindex(depth.shape):
        for dy, dx in ((0, 1), (1, 0)):
            out[y, x] |= steps([at(inverse, y + k * dy, x + k * dx) for k in (-2, -1, 0, 1)])
            out[y, x] |= steps([at(inverse, y + k * dy, x + k * dx) for k in (-1, 0, 1, 2)])
        around = [at(known, y + dy, x + dx) > 0 for dy, dx in ((-1, 0), (1, 0), (0, -1), (0, 1))]
        out[y, x] |= any(each != (known[y, x] > 0) for each in around)
    return out


@pytest.mark.parametrize("shape", [(11, 13), (1, 1), (1, 7), (5, 1)])
def test_edges_equal_the_plain_loop(shape):
    rng = np.random.default_rng(4)
    depth = (5 + rng.integers(0, 3, shape) + 0.01 * rng.random(shape)).astype(np.float32)
    depth[rng.random(shape) < 0.2] = np.inf
    known = (np.isfinite(depth) & (rng.random(shape) < 0.9)).astype(np.float32)
    inverse, colored, out = found(depth, known)
    with np.errstate(divide="ignore"):
        np.testing.assert_array_equal(inverse, np.pad(np.float32(1) / depth, 2, mode="edge"))
    np.testing.assert_array_equal(colored, np.pad(known, 2, mode="edge") > 0)
    np.testing.assert_array_equal(out, twin(depth, known))


def test_a_slanted_plane_has_no_edge_and_a_step_has_two_pixels():
    """Inverse depth of a plane is linear in pixels, however steep the plane is."""
    x = np.arange(40)
    depth = np.broadcast_to(1 / (0.01 + 0.02 * x), (9, 40)).astype(np.float32).copy()
    known = np.ones_like(depth)
    assert not found(depth, known)[2][:, 2:-2].any()  # beside the picture nothing tells the slope
    depth[:, 20:] *= 0.5
    edge = found(depth, known)[2] > 0
    assert edge[:, 19:21].all()
    assert edge[:, 2:-2].sum() == 2 * 9


def test_where_only_one_of_two_pixels_has_a_colour_both_are_edges():
    known = np.ones((5, 8), np.float32)
    known[:, 4:] = 0  # a surface that no photo saw goes on
    edge = found(np.full((5, 8), 3, np.float32), known)[2] > 0
    np.testing.assert_array_equal(edge, np.broadcast_to(np.isin(np.arange(8), (3, 4)), (5, 8)))


def test_nothing_hit_is_no_edge():
    depth = np.full((4, 6), np.inf, np.float32)
    assert not found(depth, np.zeros_like(depth))[2].any()
