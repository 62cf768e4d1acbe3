"""The second pass of the pre-warp, and the first of walls: columns and rows against their twins."""

from __future__ import annotations

import numpy as np
import pytest
from kernel_runs import on_all_thread_counts
from prewarp_twin import paint_line

from ibrpipe.core.prewarp.columns import scale_rows, warp_columns
from ibrpipe.core.prewarp.rows import LANES, PAD, first_pixel, last_before

ROWS, COLUMNS, COUNT, TOP = 15, 40, 27, -4


def blocks(values):
    """(H, columns) -> (blocks, H + 1, LANES), what is not used 0."""
    out = np.zeros((-(-values.shape[1] // LANES), len(values) + 1, LANES), np.float32)
    for x in range(values.shape[1]):
        out[x // LANES, :-1, x % LANES] = values[:, x]
    return out


def two_sides(e):
    """Both sides of a plane's columns toward the foot `e` of the eye."""
    foot, split = last_before(e, ROWS), first_pixel(e, TOP, COUNT)
    sides = np.array([[0, min(foot + 1, ROWS - 1), 1, 1, 0, split], [ROWS - 1, max(foot, 0), -1, -1, split, COUNT]])
    sides[:, 5] = np.where((sides[:, 1] - sides[:, 0]) * sides[:, 2] > 0, sides[:, 5], sides[:, 4])
    return sides


def column(values, lines, wall, h, gap, sides):
    """Twin of one column: every segment of each side painted in order."""
    values, lines = values.astype(float), lines.astype(float)
    places, out = lines[0] + lines[1] * values, np.full(COUNT, np.nan)
    depth = values if wall else h * values / (1 + values)
    for first, last, step, _, begin, end in sides:
        pairs = [(k, k + step) for k in range(first, last, step) if abs(depth[k + step] - depth[k]) <= gap]
        inside = lambda x, begin=begin, end=end: (x >= begin) & (x < end)  # noqa: E731
        got = paint_line(places, lines[2] if wall else values, inside, np.arange(COUNT), pairs)
        out[begin:end] = got[begin:end]
    return out


def compare(values, lines, wall, h, gap, sides, marked=False):
    packed, lines = blocks(values), lines.astype(np.float32)
    marks = np.empty((0, 0), np.uint8)
    if marked:
        marks = (packed == 0).all(axis=2).astype(np.uint8)
        assert 0.2 < marks.mean() < 0.8

    def warped():
        out = np.full((COUNT + 2 * PAD, 2 * LANES + 3), 7, np.float32)
        own = (
            np.where(marks[..., None] == 1, np.float32(9), packed) if marked else packed
        )  # zeros that were not written
        warp_columns(own, marks.copy(), lines, wall, h, gap, sides, values.shape[1], out)
        return (out,)

    (out,) = on_all_thread_counts(warped)
    found = out[PAD : COUNT + PAD, : values.shape[1]]
    wanted = np.stack([column(each, lines, wall, h, gap, sides) for each in values.T], axis=1)
    assert np.isclose(found, wanted, atol=1e-4, equal_nan=True).mean() > 0.98  # but for pixels at a segment's end
    return wanted


def field(seed, holes, low, high):
    rng = np.random.default_rng(seed)
    values = np.cumsum(rng.normal(size=(ROWS, COLUMNS)), axis=0)
    values = low + (high - low) * (values - values.min()) / np.ptp(values)
    values[rng.random(values.shape) < holes] = np.nan
    values[:, 11] = np.nan
    return values.astype(np.float32)


@pytest.mark.parametrize("e", [6.3, -8.0, 30.0])
@pytest.mark.parametrize("holes", [0.0, 0.1, 1.0])
@pytest.mark.parametrize("gap", [np.inf, 0.6])
def test_columns_of_a_plane_equal_the_twin(e, holes, gap):
    values, v = field(1, holes, -0.05, 0.35), np.arange(ROWS) + 0.5
    lines = np.stack([v - TOP - 0.5, v - e, np.zeros(ROWS)])
    wanted = compare(values, lines, False, 12.0, gap, two_sides(e))
    assert np.isnan(wanted[:, 11]).all()
    assert np.isfinite(wanted).any() == (holes < 1)


@pytest.mark.parametrize("e", [6.3, -8.0, 30.0])
@pytest.mark.parametrize("holes", [0.0, 0.1])
@pytest.mark.parametrize("gap", [np.inf, 0.6])
def test_marked_rows_count_as_zeros(e, holes, gap):
    values, v = field(1, holes, -0.05, 0.35), np.arange(ROWS) + 0.5
    for rows in (slice(0, 3), slice(5, 6), slice(8, 11), slice(ROWS - 3, ROWS)):
        values[rows, :LANES] = 0.0  # marked in the first block of columns, read in the second
    values[4:9, LANES:] = 0.0
    lines = np.stack([v - TOP - 0.5, v - e, np.zeros(ROWS)])
    compare(values, lines, False, 12.0, gap, two_sides(e), marked=True)


@pytest.mark.parametrize("holes", [0.0, 0.1])
@pytest.mark.parametrize("gap", [np.inf, 0.4])
def test_columns_of_a_wall_equal_the_twin(holes, gap):
    values, v, h, low, pitch = field(2, holes, 0.0, 3.0), np.arange(ROWS) + 0.5, 14.0, -1.0, 0.2
    g = (ROWS + 1.5 - v) / (v + 9.0)
    lines = np.stack([-(h * g + low) / pitch, (1 + g) / pitch, g])
    sides = np.array([[ROWS - 1, 0, -1, -1, 0, COUNT], [ROWS - 1, 0, -1, -1, COUNT, COUNT]])
    assert np.isfinite(compare(values, lines, True, h, gap, sides)).mean() > 0.2


@pytest.mark.parametrize("coded", [False, True])
@pytest.mark.parametrize("broken", [False, True])
def test_rows_of_a_wall_are_scaled_as_the_twin_says(coded, broken):
    rng = np.random.default_rng(3)
    height, codes = field(4, 0.1, 0.0, 3.0), rng.integers(0, 256, (ROWS, COLUMNS)).astype(np.uint8)
    table = rng.random(256).astype(np.float32) if coded else np.empty(0, np.float32)
    breaks = (rng.random((ROWS, COLUMNS)) < 0.2).astype(np.uint8) if broken else np.empty((0, 0), np.uint8)
    shifts, e, axis = rng.uniform(0.05, 1.4, ROWS).astype(np.float32), 13.7, np.array([1.2, 5.3])
    window, count = np.array([2, 12, 3, 36, 45]), 45
    out = np.full((2, ROWS + 1, LANES), 7, np.float32)
    scale_rows(height, codes, table, breaks, e, axis, shifts, window, out)
    u, wanted = np.arange(COLUMNS) + 0.5, np.full((ROWS, count), 7.0)
    for k in range(2, 12):
        places = axis[0] * (u + (u - e) * shifts[k]) + axis[1]
        pairs = [(i, i + 1) for i in range(3, 36) if not (broken and breaks[k, i] & 1)]
        values = (table[codes[k]] if coded else height[k]).astype(float)
        wanted[k] = paint_line(places, values, lambda x: x == x, np.arange(count), pairs)
    found = out.transpose(1, 0, 2).reshape(ROWS + 1, -1)
    assert np.isclose(found[:-1, :count], wanted, atol=1e-4, equal_nan=True).mean() > 0.98
    assert (found[2:12, count:] == 0).all()
    assert (found[-1] == 7).all()
    assert np.isfinite(wanted[2:12]).mean() > 0.4
