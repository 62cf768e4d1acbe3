"""The pipelined pre-warp: texels' places, and the cells painted between them, sampled and averaged."""

from __future__ import annotations

import numpy as np
import pytest
from kernel_runs import on_all_thread_counts
from prewarp_twin import warp_cells

from ibrpipe.core.prewarp.area import area_cells
from ibrpipe.core.prewarp.pipelined import pipeline, place_texels
from ibrpipe.core.prewarp.rows import PAD, last_before

ROWS, COLUMNS = 9, 12
EYE = np.array([4.7, 3.2, 9.0])
NONE, NONE8 = np.empty(0, np.float32), np.empty((0, 0), np.uint8)


def relief(seed=0, holes=0.1):
    rng = np.random.default_rng(seed)
    height = rng.uniform(0, 1.2, (ROWS, COLUMNS)).astype(np.float32)
    height[rng.random(height.shape) < holes] = np.nan
    return height


def lines_of(shift, e):
    v = np.arange(ROWS) + 0.5
    return np.stack([v + shift, v - e, np.zeros(ROWS)]).astype(np.float32)


def texels(height, codes=NONE8, table=NONE, shifts=NONE, ground=0.0, axis=(1.0, 0.0)):
    out = np.full((3, ROWS, COLUMNS), 7, np.float32)
    lines, window = lines_of(0.0, EYE[1]), np.array([1, 8, 2, 10])
    eye = np.array([EYE[0], EYE[2] - ground, ground])
    place_texels(height, codes, table, eye, shifts, lines, window, np.array(axis), out)
    return out


def test_texels_of_a_plane_are_placed_by_their_shifts():
    height = relief()
    height[4, 5], height[5, 5] = 9.0, 10.5  # at and behind the eye's plane
    out = on_all_thread_counts(lambda: (texels(height, ground=0.4, axis=(2.0, -3.0)),))[0]
    d = height.astype(float) - 0.4
    with np.errstate(divide="ignore"):
        g = d / (EYE[2] - height)
    u, v = np.arange(COLUMNS) + 0.5, (np.arange(ROWS) + 0.5)[:, None]
    good = np.isfinite(height) & (height < 9)
    inside = np.ix_(range(1, 8), range(2, 11))
    wanted = np.where(good, 2 * (u + (u - EYE[0]) * g) - 3, np.nan)
    steep = np.zeros(height.shape, bool)
    steep[4, 5] = True  # how far a texel in the eye's plane goes is rounding
    np.testing.assert_allclose(out[0][inside][~steep[inside]], wanted[inside][~steep[inside]], rtol=1e-5)
    np.testing.assert_allclose(out[1][inside][good[inside]], (v + (v - EYE[1]) * g)[inside][good[inside]], rtol=1e-5)
    np.testing.assert_allclose(out[2][inside][good[inside]], g[inside][good[inside]], rtol=1e-5, atol=1e-7)
    outside = np.ones(height.shape, bool)
    outside[inside] = False
    assert (out[:, outside] == 7).all()


@pytest.mark.parametrize("wall", [False, True])
def test_coded_texels_are_read_from_the_table(wall):
    rng = np.random.default_rng(1)
    codes, table = rng.integers(0, 256, (ROWS, COLUMNS)).astype(np.uint8), rng.random(256).astype(np.float32)
    table[:20] = np.nan
    shifts = rng.random(ROWS).astype(np.float32) if wall else NONE
    out = texels(relief(), codes, table, shifts)
    value, inside = table[codes], np.ix_(range(1, 8), range(2, 11))
    g = np.broadcast_to(shifts[:, None], value.shape) if wall else value
    u, v = np.arange(COLUMNS) + 0.5, (np.arange(ROWS) + 0.5)[:, None]
    wanted = np.where(np.isnan(value), np.nan, u + (u - EYE[0]) * g)
    np.testing.assert_allclose(out[0][inside], wanted[inside], rtol=1e-5)
    np.testing.assert_allclose(out[1][inside], (v + (v - EYE[1]) * value)[inside], rtol=1e-5)
    np.testing.assert_allclose(out[2][inside], g[inside], rtol=1e-6)


def placed(height):
    """(3, H, W) float32 places of all texels of the plane d = 0."""
    out = np.empty((3, ROWS, COLUMNS), np.float32)
    whole = np.array([0, ROWS, 0, COLUMNS - 1])
    place_texels(height, NONE8, NONE, np.array([EYE[0], EYE[2], 0.0]), NONE, lines_of(0.0, EYE[1]), whole,
                 np.array([1.0, 0.0]), out)  # fmt: skip
    return out


def window_of(count, left, top, stripe):
    """Ranges of all stripes, feet and window of the whole texture."""
    ranges = np.tile([0, COLUMNS - 1], (-(-count // stripe), 1))
    feet = np.array([last_before(EYE[0], COLUMNS), last_before(EYE[1], ROWS)])
    return ranges, feet, np.array([0, ROWS - 1, count, left, top, 0])


@pytest.mark.parametrize("holes", [0.0, 0.15])
def test_painted_cells_equal_the_twin_that_compares_depths(holes):
    height, (count, rows, left, top) = relief(2, holes), (17, 13, -2, -1)

    def warped():
        out = np.full((rows, count + 3), 7, np.float32)
        pipeline(placed(height), NONE8, NONE8, *window_of(count, left, top, 128), out)
        return (out,)

    (out,) = on_all_thread_counts(warped)
    wanted = warp_cells(height.astype(float), EYE, np.arange(count) + left + 0.5, np.arange(rows) + top + 0.5)
    assert np.isclose(out[:, :count], wanted, atol=1e-4, equal_nan=True).mean() > 0.97
    assert (out[:, count:] == 7).all()
    assert 40 < np.isfinite(wanted).sum() < wanted.size


def test_cells_at_texels_that_are_not_joined_stay_empty():
    height, breaks = relief(3, 0.0), np.zeros((ROWS, COLUMNS), np.uint8)
    breaks[:, 5], breaks[3, :] = 1, breaks[3, :] | 2
    out, whole = np.empty((2, 13, 17), np.float32)
    for broken, to in ((breaks, out), (NONE8, whole)):
        pipeline(placed(height), broken, NONE8, *window_of(17, -2, -1, 128), to)
    parts = height.astype(float), EYE, np.arange(17) - 1.5, np.arange(13) - 0.5
    wanted = np.full((13, 17), np.nan)
    for rows in (slice(0, 4), slice(4, ROWS)):
        for columns in (slice(0, 6), slice(6, COLUMNS)):
            only = np.full(height.shape, np.nan)
            only[rows, columns] = height[rows, columns]
            wanted = np.fmax(wanted, warp_cells(only, *parts[1:]))
    assert np.isclose(out, wanted, atol=1e-4, equal_nan=True).mean() > 0.97
    assert np.isfinite(whole).sum() > np.isfinite(out).sum() + 10


@pytest.mark.parametrize("scale", [0.3, 0.8, 1.9])
def test_averaged_cells_are_means_over_pixels(scale):
    """Cells that stay rectangles: a pixel is the mean of bilinear colours and shifts over its square."""
    rng = np.random.default_rng(4)
    x, y = (np.cumsum(rng.uniform(0.4, 1.6, n)) * scale for n in (COLUMNS, ROWS))
    places = np.stack([*np.broadcast_arrays(x, y[:, None]), rng.uniform(0, 0.1, (ROWS, COLUMNS))]).astype(np.float32)
    color = rng.random((ROWS, COLUMNS, 3)).astype(np.float32)
    count, rows = int(x[-1]) + 2, int(y[-1]) + 2

    def averaged():
        out = np.full((rows + 2 * PAD, count + 2, 4), 7, np.float32)
        area_cells(places, color, NONE8, *window_of(count, 0, 0, 32), 1.0, out)
        return (out,)

    out = on_all_thread_counts(averaged)[0][PAD : rows + PAD, :count]
    steps = 40
    at = [(np.arange(n * steps) + 0.5) / steps for n in (rows, count)]
    values, share = np.concatenate([color, places[2][..., None]], axis=2).astype(float), 1.0
    for axis, (to, known) in enumerate(zip(at, (y, x))):
        weights = np.stack([np.interp(to, known, unit, left=0, right=0) for unit in np.eye(len(known))], axis=1)
        mean = weights.reshape(-1, steps, len(known)).mean(axis=1)
        values = np.tensordot(mean, values, (1, axis)) if axis == 0 else np.einsum("xi,yic->yxc", mean, values)
        covered = mean.sum(axis=1)
        share = np.multiply.outer(share, covered) if axis else covered
    sure = np.abs(share - 0.5) > 0.05
    np.testing.assert_array_equal(np.isnan(out).any(axis=2)[sure], share[sure] < 0.5)
    full = share > 0.55
    wanted = values[full] / share[full][:, None]
    assert full.sum() > 3
    np.testing.assert_allclose(out[full], wanted, atol=0.02)
