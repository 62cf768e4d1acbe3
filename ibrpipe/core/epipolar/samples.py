"""The sampled searches along epipolar lines: nearest reference samples as published, or interpolated ones.

A line is swept along its middle, one sample per column (schaufler1999, sec. 4 and 5): a pixel's correspondence is the
first sample that is not nearer to the background than the pixel's ray there (the paper's disparity test). ``nearest``
then returns the depth of that very sample; ``linear`` interpolates across and along the columns beside it, on the
pixel's own ray (the paper's future work, sec. 8). Where neighbours may be apart (depth images; ``steps`` finite), a
sample is a level tile as wide as a texel, and a step between two tiles of one surface is met as well.

Symbols: see :mod:`ibrpipe.core.epipolar.lines`; samples lie where along and across are whole numbers; NaN = background.
Packed arguments: see :mod:`ibrpipe.core.epipolar.near`; ``layout`` (first, along_step, across_step): index in `flat` of
a sector's first sample, steps to the next column and row; ``lines`` (sectors, table) of a sweep.
"""

from __future__ import annotations

import numpy as np
from numba import prange

from ibrpipe.core.epipolar import lines as el
from ibrpipe.core.epipolar.near import is_short, joined
from ibrpipe.core.epipolar.sweep import (
    BEGIN,
    CHUNK,
    END,
    FAR,
    GROUP,
    HIGH,
    LOW,
    NEAR,
    ROW0,
    ROW1,
    bound_bins,
    end_of_bins,
)
from ibrpipe.core.jit import fused, inlined, kernel

#: pixels that are looked up together
LANES = 256
#: rows of the working memory: table entry, column, ray at the column, what it is compared with
ENTRY, COLUMN, TEXEL, UPPER, LOWER, SHARE, ABOVE, T = (LANES * n for n in range(8))
#: how far the ray is above the samples at the four columns about a pixel's start, and those samples
FOUR_F, FOUR_D = LANES * 8, LANES * 12
WORK = LANES * 16


@inlined
def across_rows(upper, lower, share, steps):
    # depth between two rows; where steps are limited and they are not one surface, that of the nearer row
    between, nearer = upper + share * (lower - upper), lower if share >= 0.5 else upper
    apart = (steps[0] < np.inf) & (not joined(upper, lower, steps))
    return (nearer if share == share else np.nan) if apart else between


@fused
def sample_columns(number, start, count, middle, breadth, layout, edges, linear, steps, flat, work):
    # depth at the far column of the sample of each column, NaN = background
    first, along_step, across_step = layout
    for k in range(count):
        position = middle * edges[number, 0, start + k] + edges[number, 1, start + k]
        row = np.floor(position if linear else position + 0.5)
        row = row if row < breadth - 1.0 else (breadth - 1.0 if linear and position <= breadth else row)
        inside = (row >= 0.0) & (row < breadth + (0.0 if linear else 1.0))
        work[ROW0 + k] = row if inside else 0.0
        work[ROW1 + k] = position - row if inside else np.nan
    for k in range(count):
        work[LOW + k] = flat[np.uint32(first + (start + k) * along_step + np.int64(work[ROW0 + k]) * across_step)]
    if linear:
        for k in range(count):
            row = np.int64(work[ROW0 + k]) + 1
            work[HIGH + k] = flat[np.uint32(first + (start + k) * along_step + row * across_step)]
    for k in range(count):
        share = work[ROW1 + k]
        value = across_rows(work[LOW + k], work[HIGH + k], share, steps) if linear else work[LOW + k] + 0.0 * share
        inside = edges[number, 0, start + k] > el.NEAREST
        work[FAR + k] = value
        value = (value - edges[number, 2, start + k]) * edges[number, 3, start + k]
        work[NEAR + k] = value if inside else np.nan


@inlined
def between_columns(number, column, columns, edges):
    # keep and shift_d half a column before a column
    one, other = (
        (column - 1, column) if 0 < column < columns else ((0, 1) if column == 0 else (columns - 2, columns - 1))
    )
    share = 0.5 if 0 < column < columns else (-0.5 if column == 0 else 1.5)
    keep = edges[number, 0, one] + share * (edges[number, 0, other] - edges[number, 0, one])
    return max(keep, el.NEAREST), edges[number, 2, one] + share * (edges[number, 2, other] - edges[number, 2, one])


@fused
def span_tiles(number, start, count, columns, there, edges, steps, work):
    # LOW, HIGH: range of depths at the far column that the tile of each column spans, with the step from the one
    # before it; there: sample of the column before `start` -> sample of the last column
    for k in range(count):
        here, inside = work[FAR + k], work[NEAR + k] == work[NEAR + k]
        keep, drop = between_columns(number, start + k, columns, edges)
        enter, step = (here - drop) / keep, (there - drop) / keep
        keep, drop = between_columns(number, start + k + 1, columns, edges)
        leave = (here - drop) / keep
        low, high = min(enter, leave), max(enter, leave)
        if joined(here, there, steps):
            low, high = min(low, step), max(high, step)
            enter = work[NEAR + k - 1] if k > 0 else step
        if k + 1 < count and joined(here, work[FAR + k + 1], steps):
            leave = work[NEAR + k + 1]
        if (enter - leave) * steps[2] < 0.0:  # rays that pass to greater depth see samples sink from column to column
            low, high = np.nan, np.nan
        work[LOW + k], work[HIGH + k] = low if inside else np.nan, high if inside else np.nan
        there = here if inside else np.nan
    return there


@fused
def sweep_samples_of_line(line, number, sectors, edges, flat, stride, linear, gaps, steps, work, table):
    sector = sectors[number]
    swapped, backward = sector[el.AXIS] > 0.5, sector[el.SIGN] < 0.0
    columns, breadth = int(sector[el.ALONG]) + 1, sector[el.ACROSS]
    along_step, across_step = (stride, 1) if swapped else (1, stride)
    middle = sector[el.EDGE] + (line + 0.5) * sector[el.WIDTH]
    end, base = end_of_bins(middle, sector), 0
    bins, step = int(sector[el.BINS]), int(sector[el.BIN_STEP])
    entry = int(sector[el.FIRST]) + line * int(sector[el.LINE_STEP])
    low, high, first, last, before, there = np.inf, -np.inf, bins, -1, np.nan, np.nan
    tiles = steps[0] < np.inf
    if backward:
        base, along_step = (columns - 1) * along_step, -along_step
    for start in range(0, columns, CHUNK):
        count = min(CHUNK, columns - start)
        layout = (base, along_step, across_step)
        sample_columns(number, start, count, middle, breadth, layout, edges, linear, steps, flat, work)
        if tiles:
            there = span_tiles(number, start, count, columns, there, edges, steps, work)
        for k in range(0 if tiles else count):
            value = work[NEAR + k]
            if gaps:  # what lies between this sample and the one before it
                low, high = value if value < before else before, value if value > before else before
                if (before - value) * steps[2] < 0.0:
                    low, high = np.nan, np.nan
                before = value
            else:
                low, high = value if value < low else low, value if value > high else high
            work[LOW + k], work[HIGH + k] = low, high
        bound_bins(count, middle, middle, end, end, float(bins), 0.5, -0.5, sector, work)
        for k in range(count):
            begin, finish = int(work[BEGIN + k]), int(work[END + k])
            if gaps:
                for bin_idx in range(begin, finish + 1):
                    old = table[entry + bin_idx * step]
                    table[entry + bin_idx * step] = old if old < np.inf else np.float32(start + k)
                continue
            if begin > finish or (begin >= first and finish <= last):
                continue
            if last < first:
                first, last = begin, begin - 1
            for bin_idx in range(begin, first):
                table[entry + bin_idx * step] = start + k
            for bin_idx in range(last + 1, finish + 1):
                table[entry + bin_idx * step] = start + k
            first, last = min(first, begin), max(last, finish)
        if first == 0 and last == bins - 1:
            break


@kernel
def sweep_samples(sectors, edges, flat, stride, linear, gaps, steps, groups, parts, table):
    # flat (rows * stride,) f32 depths of samples, NaN = background; gaps: is there any, or a step that is no surface;
    # steps (2,): greatest step within a surface, a constant and a share of the depth; table (entries,) f32: column
    # at which a pixel's correspondence lies, counted along its sector, inf throughout; other arguments as of
    # epipolar_sweep.sweep_lines
    for part in prange(parts):
        work = np.empty(8 * CHUNK)
        for group in range(np.int64(part), groups[4], parts):
            number = 0
            while group >= groups[number + 1]:
                number += 1
            first = (group - groups[number]) * GROUP
            for line in range(first, min(first + GROUP, int(sectors[number, el.LINES]))):
                sweep_samples_of_line(line, number, sectors, edges, flat, stride, linear, gaps, steps, work, table)


@fused
def find_columns(number, x0, y, count, start, Q_of, slope, reach, sectors, table, work):
    # COLUMN: column of every pixel's correspondence in a sector, inf for none -> is there any; slope: row of `Q_of` by
    # which depth changes, reach: range of depths; rays that are short in the reference are left to `epipolar_near`
    l0, l1, l2, lines = sectors[number, 0], sectors[number, 1], sectors[number, 2], sectors[number, el.LINES]
    s0, s1, s2 = sectors[number, 3], sectors[number, 4], sectors[number, 5]
    b0, b1, b2, bins = sectors[number, 6], sectors[number, 7], sectors[number, 8], sectors[number, el.BINS]
    first, line_step, bin_step = sectors[number, el.FIRST], sectors[number, el.LINE_STEP], sectors[number, el.BIN_STEP]
    py, P0, P1, P3 = y + 0.5, start[0], start[1], start[3]
    x_x, x_y = P3 * Q_of[0, 0] - P0 * Q_of[3, 0], P3 * Q_of[0, 1] - P0 * Q_of[3, 1]
    y_x, y_y = P3 * Q_of[1, 0] - P1 * Q_of[3, 0], P3 * Q_of[1, 1] - P1 * Q_of[3, 1]
    x_1, y_1 = P3 * Q_of[0, 2] - P0 * Q_of[3, 2], P3 * Q_of[1, 2] - P1 * Q_of[3, 2]
    g_x, g_1 = Q_of[slope, 0], Q_of[slope, 1] * py + Q_of[slope, 2]
    swapped, sign = number >= 2, -1.0 if number & 1 else 1.0
    for k in range(count):
        px = x0 + k + 0.5
        wx, wy = x_x * px + x_y * py + x_1, y_x * px + y_y * py + y_1
        mine = (abs(wx) < abs(wy)) if swapped else (abs(wx) >= abs(wy))
        mine &= (sign * (wy if swapped else wx) > 0.0) & (not is_short(wx, wy, g_x * px + g_1, reach))
        line = np.floor((l0 * px + l1 * py + l2) / (s0 * px + s1 * py + s2))
        bin_idx = np.floor(b0 * px + b1 * py + b2)
        mine &= (line >= 0.0) & (line < lines) & (bin_idx >= 0.0) & (bin_idx < bins)
        work[ENTRY + k] = first + line * line_step + bin_idx * bin_step if mine else 0.0
    least = np.inf
    for k in range(count):
        column = table[np.uint32(np.int64(work[ENTRY + k]))]
        work[COLUMN + k] = column
        least = column if column < least else least
    return least < np.inf


@fused
def meet_column(number, shift, x0, y, count, size, view, raster, linear, out, work):
    # where the pixels' rays are at the columns `shift` beyond theirs, and at `out` how far they are above the samples
    # there; in homogeneous numbers, as a sample before a ray's vanishing point may be met at a column beyond it; size:
    # last row across, columns along
    breadth, columns = size
    start, Q_of, _, _ = view
    flat, stride, steps = raster
    axis, other = number >> 1, 1 - (number >> 1)
    backward = (number & 1) == 1
    along_step, across_step = (stride, 1) if axis == 1 else (1, stride)
    Pa, Pc, Pd, Pq, py = start[axis], start[other], start[2], start[3], y + 0.5
    a0, a1 = Q_of[axis, 0], Q_of[axis, 1] * py + Q_of[axis, 2]
    c0, c1 = Q_of[other, 0], Q_of[other, 1] * py + Q_of[other, 2]
    d0, d1, q0, q1 = Q_of[2, 0], Q_of[2, 1] * py + Q_of[2, 2], Q_of[3, 0], Q_of[3, 1] * py + Q_of[3, 2]
    for k in range(count):
        px, column = x0 + k + 0.5, work[COLUMN + k] + shift
        inside = (column >= 0.0) & (column < columns)
        edge = columns - 1.0 - column if backward else column
        edge = edge if inside else 0.0
        a, q = a0 * px + a1, q0 * px + q1
        t, one, under = edge * Pq - Pa, a - edge * q, a * Pq - Pa * q  # camera depth t / one
        wide = 1.0 / under
        position = (one * Pc + t * (c0 * px + c1)) * wide
        row = np.floor(position if linear else position + 0.5)
        row = row if (row < breadth) | (not linear) else row - 1.0
        inside &= (row >= 0.0) & (row < breadth + (0.0 if linear else 1.0))
        inside &= (t * under > 0.0) & ((t * one > 0.0) | (q > 0.0))
        work[TEXEL + k] = edge * along_step + (row if inside else 0.0) * across_step
        work[SHARE + k] = position - row if inside else np.nan
        work[ABOVE + k] = (one * Pd + t * (d0 * px + d1)) * wide
    for k in range(count):
        work[UPPER + k] = flat[np.uint32(np.int64(work[TEXEL + k]))]
    if linear:
        for k in range(count):
            work[LOWER + k] = flat[np.uint32(np.int64(work[TEXEL + k]) + across_step)]
    for k in range(count):
        upper, share = work[UPPER + k], work[SHARE + k]
        value = across_rows(upper, work[LOWER + k], share, steps) if linear else upper + 0.0 * share
        work[out + FOUR_F + k], work[out + FOUR_D + k] = work[ABOVE + k] - value, value


@fused
def cut_steps(count, steps, work):
    # COLUMN's tile alone is met where its neighbours among the four columns are not of its surface
    for k in range(count):
        d0, d1 = work[FOUR_D + k], work[FOUR_D + LANES + k]
        d2, d3 = work[FOUR_D + 2 * LANES + k], work[FOUR_D + 3 * LANES + k]
        near = joined(d1, d2, steps)
        work[FOUR_F + k] = work[FOUR_F + k] if near & joined(d0, d1, steps) else np.nan
        work[FOUR_F + LANES + k] = work[FOUR_F + LANES + k] if near else np.nan
        work[FOUR_F + 3 * LANES + k] = work[FOUR_F + 3 * LANES + k] if joined(d2, d3, steps) else np.nan


@fused
def cross_between(number, x0, y, count, columns, start, Q_of, tiles, work):
    # camera depth T where a ray first changes side between four columns, else within the tile of the pixel's own
    # column (tiles) or at that column; d of the ray and of the samples is linear in the column, which the camera
    # depth of perspective frames is not
    axis, backward = number >> 1, (number & 1) == 1
    Pa, Pd, Pq, py = start[axis], start[2], start[3], y + 0.5
    a0, a1 = Q_of[axis, 0], Q_of[axis, 1] * py + Q_of[axis, 2]
    d0, d1, q0, q1 = Q_of[2, 0], Q_of[2, 1] * py + Q_of[2, 2], Q_of[3, 0], Q_of[3, 1] * py + Q_of[3, 2]
    for k in range(count):
        px = x0 + k + 0.5
        a, q = a0 * px + a1, q0 * px + q1
        f0, f1, f2, f3 = (
            work[FOUR_F + k], work[FOUR_F + LANES + k], work[FOUR_F + 2 * LANES + k], work[FOUR_F + 3 * LANES + k],
        )  # fmt: skip
        rate = (Pq * (d0 * px + d1) - q * Pd) / (a * Pq - Pa * q)  # of the ray's d per column of the reference
        level = (f2 if backward else -f2) / rate
        level = level if level < 0.5 else 0.5
        shift = (level if level > -0.5 else -0.5) if tiles & (rate != 0.0) else 0.0
        shift = shift if f2 == f2 else np.inf
        shift = f2 / (f2 - f3) if f2 * f3 <= 0.0 else shift
        shift = f1 / (f1 - f2) - 1.0 if f1 * f2 <= 0.0 else shift
        shift = f0 / (f0 - f1) - 2.0 if f0 * f1 <= 0.0 else shift
        edge = work[COLUMN + k] + shift
        edge = columns - 1.0 - edge if backward else edge
        t = (edge * Pq - Pa) / (a - edge * q)
        work[T + k] = t if (abs(edge) < np.inf) & (t == t) else np.inf


@kernel
def pick_samples(raster, view, lines, linear, reach, eye, base, parts, depth, ids):
    # reach: range of depths; depth (h, w) f32 and ids (h, w) u32 are lowered in place; a hit's id is base + its sample
    # (linear: the upper or left one of those it lies between)
    _, stride, steps = raster
    start, Q_of, weight, perspective = view
    sectors, table = lines
    rows, columns = depth.shape
    slope, tiles = 3 if perspective else 2, steps[0] < np.inf
    for part in prange(parts):
        work = np.empty(WORK)
        for y in range(np.int64(part), rows, parts):
            for x0 in range(0, columns, LANES):
                count = min(LANES, columns - x0)
                for number in range(4):
                    if sectors[number, el.USED] == 0.0:
                        continue
                    if not find_columns(number, x0, y, count, start, Q_of, slope, reach, sectors, table, work):
                        continue
                    breadth, wide = sectors[number, el.ACROSS], sectors[number, el.ALONG] + 1.0
                    if linear:
                        for shift in range(4):
                            meet_column(
                                number, shift - 2.0, x0, y, count, (breadth, wide), view, raster, True, shift * LANES,
                                work,
                            )  # fmt: skip
                        if tiles:
                            cut_steps(count, steps, work)
                        cross_between(number, x0, y, count, wide, start, Q_of, tiles, work)
                    else:
                        meet_column(number, 0.0, x0, y, count, (breadth, wide), view, raster, False, 0, work)
                        for k in range(count):
                            texel, d = work[TEXEL + k], work[UPPER + k]
                            v = np.floor((texel + 0.5) / stride)
                            u = texel - v * stride
                            t = weight[0] * u + weight[1] * v + weight[2] * d + weight[3]
                            t = -t / d if perspective else t
                            work[T + k] = t if work[FOUR_F + k] == work[FOUR_F + k] else np.inf
                    for k in range(count):
                        t, x = np.float32(work[T + k]), x0 + k
                        if work[COLUMN + k] < np.inf and t > eye and t < depth[y, x]:
                            depth[y, x], ids[y, x] = t, np.uint32(base + np.int64(work[TEXEL + k]))


@kernel
def shade_samples(depth, ids, base, start, Q_of, flat, stride, color, linear, out, known):
    # color (rows, stride, 3) f32; hits with ids in [base, base + samples): out (h, w, 3) f32 and known (h, w) f32
    rows, columns = len(flat) // stride, stride
    for y in prange(depth.shape[0]):
        for x in range(depth.shape[1]):
            sample = np.int64(ids[y, x]) - base
            if not depth[y, x] < np.inf or sample < 0 or sample >= len(flat):
                continue
            v, u = sample // stride, sample % stride
            if not linear:
                for k in range(3):
                    out[y, x, k] = color[v, u, k]
                known[y, x] = 1.0
                continue
            px, py, t = x + 0.5, y + 0.5, float(depth[y, x])
            q = start[3] + t * (Q_of[3, 0] * px + Q_of[3, 1] * py + Q_of[3, 2])
            p = (start[0] + t * (Q_of[0, 0] * px + Q_of[0, 1] * py + Q_of[0, 2])) / q
            r = (start[1] + t * (Q_of[1, 0] * px + Q_of[1, 1] * py + Q_of[1, 2])) / q
            i, j = min(max(int(np.floor(p)), 0), columns - 2), min(max(int(np.floor(r)), 0), rows - 2)
            total, red, green, blue = 0.0, 0.0, 0.0, 0.0
            for corner in range(4):
                m, n = i + (corner & 1), j + (corner >> 1)
                value = flat[n * stride + m]
                if value == value:
                    weight = max(1.0 - abs(p - m), 1e-6) * max(1.0 - abs(r - n), 1e-6)
                    total += weight
                    red += weight * color[n, m, 0]
                    green += weight * color[n, m, 1]
                    blue += weight * color[n, m, 2]
            known[y, x] = 1.0
            if total > 0.0:
                out[y, x, 0], out[y, x, 1], out[y, x, 2] = red / total, green / total, blue / total
