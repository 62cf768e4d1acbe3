"""Pre-warp with both passes interspersed: fold-overs of any number come out right. Source: oliveira2000, sec. 3.2.2.

Every cell between four texels is warped in order of occlusion; each column of pixels that it meets receives its span at
once, over what was there before. No depth is compared. The spans are those of the line x = const through the warped
cell's edges, so neighbouring cells share their ends and leave no crack. Symbols: :mod:`ibrpipe.core.prewarp.rows`.
"""

from __future__ import annotations

import numpy as np
from numba import prange

from ibrpipe.core.jit import fused, kernel
from ibrpipe.core.prewarp.rows import HALF, HOLE, LANES, NONE, ONE

#: columns of pixels that one thread owns
STRIPE = 128


@kernel
def place_texels(height, codes, table, eye, shifts, lines, window, axis, out):
    # as warp_rows; eye f64: e_u, h, ground; lines (3, H) f32; axis f64: pixels per texel along rows, and where
    # u = 0 falls
    # out (3, H, W) f32: first and second coordinate and shift of every texel of the window, NaN where it is a hole or
    # at or behind the eye's plane
    e, h, ground = np.float32(eye[0]), np.float32(eye[1]), np.float32(eye[2])
    zoom, shift = np.float32(axis[0]), np.float32(axis[1])
    wall, coded = shifts.shape[0] > 0, table.shape[0] > 0
    tiny = np.float32(1e-6) * abs(h)
    for job in prange(window[1] - window[0]):
        k = window[0] + np.int64(job)
        for i in range(window[2], window[3] + 1):
            value = table[codes[k, i]] if coded else height[k, i]
            d = value - ground
            away = h - d
            away = away if abs(away) > tiny else -tiny
            g = shifts[k] if wall else (value if coded else d / away)
            u = np.float32(i) + HALF
            carried = value if wall else g
            good = g > NONE and value == value
            out[0, k, i] = zoom * (u + (u - e) * g) + shift if good else HOLE
            out[1, k, i] = lines[0, k] + lines[1, k] * carried
            out[2, k, i] = g


@fused
def meet_edge(positions, ka, ia, kb, ib, x, span):
    # widen span (least q, its g, greatest q, its g) by where the edge between two texels meets the line x
    pa, pb = positions[0, ka, ia], positions[0, kb, ib]
    if (pa <= x) == (pb <= x):
        return span
    t = (x - pa) / (pb - pa)
    q = positions[1, ka, ia] + t * (positions[1, kb, ib] - positions[1, ka, ia])
    g = positions[2, ka, ia] + t * (positions[2, kb, ib] - positions[2, ka, ia])
    low, g_low, high, g_high = span
    if q < low:
        low, g_low = q, g
    if q > high:
        high, g_high = q, g
    return low, g_low, high, g_high


@fused
def put_cell(positions, k, i, begin, end, left, top, out):
    a, b, c, d = positions[0, k, i], positions[0, k, i + 1], positions[0, k + 1, i], positions[0, k + 1, i + 1]
    if not (a == a and b == b and c == c and d == d):
        return
    low, high = min(min(a, b), min(c, d)), max(max(a, b), max(c, d))
    if high < np.float32(begin + left) or low > np.float32(end + left):
        return
    first = max(int(np.ceil(low - HALF)) - left, begin)
    last = min(int(np.ceil(high - HALF)) - left, end)
    rows = out.shape[0]
    for column in range(first, last):
        x = np.float32(column + left) + HALF
        span = (np.float32(np.inf), ONE, np.float32(-np.inf), ONE)
        span = meet_edge(positions, k, i, k, i + 1, x, span)
        span = meet_edge(positions, k + 1, i, k + 1, i + 1, x, span)
        span = meet_edge(positions, k, i, k + 1, i, x, span)
        span = meet_edge(positions, k, i + 1, k + 1, i + 1, x, span)
        lower, g, upper, g_upper = span
        if not lower < upper:
            continue
        begin_y = int(np.ceil(max(lower - HALF - np.float32(top), np.float32(0.0))))
        end_y = int(np.ceil(min(upper - HALF - np.float32(top), np.float32(rows))))
        slope = (g_upper - g) / (upper - lower)
        for y in range(begin_y, end_y):
            out[y, column] = g + (np.float32(y + top) + HALF - lower) * slope


@fused
def put_flat(positions, k, i, end, begin, stop, left, top, out):
    # cells i .. end - 1 of row k, none of which has moved: one rectangle
    low, high = positions[0, k, i], positions[0, k, end]
    first, last = max(int(np.ceil(low - HALF)) - left, begin), min(int(np.ceil(high - HALF)) - left, stop)
    one, other = positions[1, k, i] - HALF - np.float32(top), positions[1, k + 1, i] - HALF - np.float32(top)
    lowest, highest = np.float32(0.0), np.float32(out.shape[0])
    for y in range(int(np.ceil(max(min(one, other), lowest))), int(np.ceil(min(max(one, other), highest)))):
        for column in range(first, last):
            out[y, column] = lowest


@fused
def put_row(positions, breaks, flat, k, first, last, foot, begin, end, left, top, out):
    # cells of row k toward the foot from both sides, its own cell last
    middle = min(max(foot, first), last)
    broken, chunked = breaks.shape[0] > 0, flat.shape[0] > 0
    i = first
    while i < middle:
        if chunked and flat[k, i // LANES] & flat[k + 1, i // LANES]:
            to = min((i // LANES + 1) * LANES, middle)
            put_flat(positions, k, i, to, begin, end, left, top, out)
            i = to
            continue
        if not (broken and (breaks[k, i] | (breaks[k + 1, i] & 1) | (breaks[k, i + 1] & 2)) > 0):
            put_cell(positions, k, i, begin, end, left, top, out)
        i += 1
    i = last - 1
    while i >= middle:
        if chunked and flat[k, i // LANES] & flat[k + 1, i // LANES]:
            to = max(i // LANES * LANES, middle)
            put_flat(positions, k, to, i + 1, begin, end, left, top, out)
            i = to - 1
            continue
        if not (broken and (breaks[k, i] | (breaks[k + 1, i] & 1) | (breaks[k, i + 1] & 2)) > 0):
            put_cell(positions, k, i, begin, end, left, top, out)
        i -= 1


@kernel
def pipeline(positions, breaks, flat, ranges, feet, window, out):
    # positions (3, H, W) from place_texels; breaks (H, W) u8, bit 0: not joined to the right, bit 1: not to below;
    # empty = all are; flat (H, chunks) u8 as warp_rows
    # ranges (stripes, 2) i64 first and last texel that can reach a stripe; feet i64: last texel and
    # row not beyond the foot; window i64: first row, last row, count of columns, left, top, order (1 rows ascend, -1
    # descend, 0 both to foot); out (rows, stride) f32: shift at pixel centres, NaN = nothing
    first, last, count, left, top, order = window[0], window[1], window[2], window[3], window[4], window[5]
    middle = last if order > 0 else first if order < 0 else min(max(feet[1], first), last)
    for stripe in prange(ranges.shape[0]):
        begin = np.int64(stripe) * STRIPE
        end = min(begin + STRIPE, count)
        for y in range(out.shape[0]):
            for x in range(begin, end):
                out[y, x] = HOLE
        for k in range(first, middle):
            put_row(
                positions, breaks, flat, k, ranges[stripe, 0], ranges[stripe, 1], feet[0], begin, end, left, top, out
            )
        for back in range(last - middle):
            k = last - 1 - back
            put_row(
                positions, breaks, flat, k, ranges[stripe, 0], ranges[stripe, 1], feet[0], begin, end, left, top, out
            )
