"""Slow plain twin of the sampled search of the `epipolar` renderer: one pixel, one line, one column at a time."""

from __future__ import annotations

import numpy as np

from ibrpipe.core.epipolar import lines as el
from ibrpipe.core.epipolar import near


def ends_of(samples):
    """Least and greatest depth, a little apart."""
    low, high = float(np.nanmin(samples)), float(np.nanmax(samples))
    pad = 1e-6 * (high - low) + 1e-9 * max(abs(low), abs(high))
    return low - pad, high + pad


def place_of_pixel(start, turn, sectors, px, py):
    """(sector, line, bin) of a pixel, None where it has none; exactly one sector claims a pixel."""
    p = np.array([px, py, 1.0])
    Q = turn @ p
    wx, wy = start[3] * Q[0] - Q[3] * start[0], start[3] * Q[1] - Q[3] * start[1]
    number = (0 if wx > 0 else 1) if abs(wx) >= abs(wy) else (2 if wy > 0 else 3)
    own = sectors[number]
    if not own[el.USED]:
        return None
    line, place = (own[0:3] @ p) / (own[3:6] @ p), own[6:9] @ p
    if not (0 <= line < own[el.LINES] and 0 <= place < own[el.BINS]):
        return None
    return number, int(line), int(place)


def correspondence(own, edges, samples, steps, line, place):
    """Column (counted along the sector) at which the ray of a bin's middle first passes a sample, or None."""
    columns, rows = int(own[el.ALONG]) + 1, int(own[el.ACROSS]) + 1
    middle = own[el.EDGE] + (line + 0.5) * own[el.WIDTH]
    over, under, b = own[el.OVER : el.OVER + 3], own[el.UNDER : el.UNDER + 3], place + 0.5
    d_far = (b * (under[0] * middle + under[2]) - over[0] * middle - over[2]) / (over[1] - b * under[1])
    if steps[0] < np.inf:
        return tile(own, edges, samples, steps, middle, d_far)
    before, there = None, np.nan
    for column in range(columns):
        keep, across, down, inverse = edges[:, column]
        row, sample = int(np.floor(middle * keep + across + 0.5)), np.nan
        if keep > el.NEAREST and 0 <= row < rows:
            sample = sample_at(own, samples, column, row)
        here = (sample - down) * inverse
        one = abs(sample - there) <= steps[0] + steps[1] * max(abs(sample), abs(there))
        there = sample
        if one and before is not None and min(before, here) <= d_far <= max(before, here):
            return column
        before = None if np.isnan(here) else here
    return None


def tile(own, edges, samples, steps, middle, d_far):
    """Column whose texel, or the step to it from the one before, a ray first crosses, or None."""
    columns, rows = int(own[el.ALONG]) + 1, int(own[el.ACROSS]) + 1
    there = np.nan
    for column in range(columns):
        row = int(np.floor(middle * edges[0, column] + edges[1, column] + 0.5))
        here = sample_at(own, samples, column, row) if 0 <= row < rows and edges[0, column] > el.NEAREST else np.nan
        ways = [
            between(edges, column - 0.5),
            between(edges, column + 0.5),
        ]  # (keep, drop): the ray is at d * keep + drop
        over = [d_far * max(keep, el.NEAREST) + drop - here for keep, drop in ways]
        step = abs(here - there) <= steps[0] + steps[1] * max(abs(here), abs(there))
        if over[0] * over[1] <= 0 or (step and over[0] * (over[0] + here - there) <= 0):
            return column
        there = here
    return None


def between(edges, column):
    """Interpolate (keep, shift_d) at a column between whole ones, or half a column beyond them."""
    one = min(max(int(np.floor(column)), 0), edges.shape[1] - 2)
    return tuple(edges[n, one] + (column - one) * (edges[n, one + 1] - edges[n, one]) for n in (0, 2))


def sample_at(own, samples, column, row):
    """Sample in column `column` along the sector."""
    column = int(own[el.ALONG]) - column if own[el.SIGN] < 0 else column
    return samples[column, row] if own[el.AXIS] else samples[row, column]


def short_way(start, turn, perspective, ends, px, py):
    """(places (n, 2), depths (n,)) of a ray at many depths of the field, None where its way there is long."""
    Q = turn @ (px, py, 1.0)
    W, g = start[3] * Q[:2] - Q[3] * start[:2], Q[3] if perspective else Q[2]
    if g == 0 or np.abs(W).max() * (ends[1] - ends[0]) > near.SHORT * abs(g):
        return None
    eye = start[2] / start[3] if start[3] > 0 else -np.inf
    first = max(ends[0], eye) if g > 0 else min(ends[1], eye)
    d = np.linspace(first, ends[1] if g > 0 else ends[0], 5001)
    if (d[-1] - d[0]) * g <= 0:
        return np.empty((0, 2)), np.empty(0)
    origin = Q[:2] / Q[3] if perspective else start[:2] - start[2] * Q[:2] / g
    return origin + d[:, None] * W / g, d


def nearest_short(samples, steps, places, depths):
    """(row, column) of the first sample that a ray crosses on its short way, or None."""
    i, j = np.floor(places + 0.5).astype(int).T
    inside = (i >= 0) & (i < samples.shape[1]) & (j >= 0) & (j < samples.shape[0])
    value = np.where(inside, samples[np.where(inside, j, 0), np.where(inside, i, 0)], np.nan).astype(float)
    over = depths - value
    one = np.abs(value[1:] - value[:-1]) <= steps[0] + steps[1] * np.maximum(np.abs(value[1:]), np.abs(value[:-1]))
    met = np.flatnonzero(one & (over[:-1] * over[1:] <= 0))
    return (j[met[0] + 1], i[met[0] + 1]) if len(met) else None


def nearest(start, turn, weight, perspective, sectors, edges, samples, steps, size):
    """(h, w) depth of the nearest reference sample of every pixel, inf for background."""
    depth = np.full((size[1], size[0]), np.inf)
    for y in range(size[1]):
        for x in range(size[0]):
            way = short_way(start, turn, perspective, ends_of(samples), x + 0.5, y + 0.5)
            if way is not None:
                found = nearest_short(samples, steps, *way)
                if found is not None:
                    d = float(samples[found])
                    w = weight @ (found[1], found[0], d, 1.0)
                    depth[y, x] = -w / d if perspective else w
                continue
            found = place_of_pixel(start, turn, sectors, x + 0.5, y + 0.5)
            if found is None:
                continue
            number, line, place = found
            own = sectors[number]
            column = correspondence(own, edges[number], samples, steps, line, place)
            if column is None:
                continue
            axis = int(own[el.AXIS])
            edge = own[el.ALONG] - column if own[el.SIGN] < 0 else column
            Q = turn @ (x + 0.5, y + 0.5, 1.0)
            t = (edge * start[3] - start[axis]) / (Q[axis] - edge * Q[3])
            under = start[3] + t * Q[3]
            row = int(np.floor((start[1 - axis] + t * Q[1 - axis]) / under + 0.5))
            beyond = t < 0 and under < 0 and Q[3] > 0  # the vanishing point, within a texel of the hit
            if not (0 <= row <= own[el.ACROSS] and (t > 0 or beyond)):
                continue
            d = sample_at(own, samples, column, row)
            place_uv = (row, edge) if axis else (edge, row)
            w = weight @ (*place_uv, d, 1.0)
            w = -w / d if perspective else w
            if w > 0:
                depth[y, x] = w
    return depth
