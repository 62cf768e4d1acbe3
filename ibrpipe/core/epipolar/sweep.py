"""Sweep of epipolar lines: for every pixel of every line, the first column of blocks that its ray can meet.

One pass over a line's columns serves all its pixels (schaufler1999, sec. 4, fig. 5): what the line has met so far spans
a range of depths at the far column, which only grows; the pixels that a column adds to it are those whose search starts
there. Lines are as wide as a pixel or more and blocks are bounded, so a start is never too late, for any pixel.

Symbols: see :mod:`ibrpipe.core.epipolar.lines`; low, high: range met so far, in d at the far column; first, last: bins
that have a start.
"""

from __future__ import annotations

import numpy as np
from numba import prange

from ibrpipe.core.epipolar import lines as el
from ibrpipe.core.jit import fused, helper, kernel

#: by how much, in bins and cells, ranges are widened, so that rounding loses no pixel
WIDEN = 1e-4
#: lines that are swept together, so that their tables' cache lines are shared
GROUP = 16
#: columns that are swept together
CHUNK = 256
#: rows of the working memory, CHUNK numbers each: first and last row of blocks, their bounds, range met so far, bins
ROW0, ROW1, NEAR, FAR, LOW, HIGH, BEGIN, END = (CHUNK * n for n in range(8))


@helper
def end_of_bins(across, sector):
    # where bins go (-inf or inf) as the ray turns square to the camera's axis
    steep = sector[el.UNDER + 1]
    if steep == 0.0:
        return np.inf
    depth = -(sector[el.UNDER] * across + sector[el.UNDER + 2]) / steep
    over = sector[el.OVER] * across + sector[el.OVER + 1] * depth + sector[el.OVER + 2]
    return np.inf if over > 0.0 else -np.inf


@fused
def bound_columns(number, start, count, left, right, scale, breadth, edges, work):
    # rows of blocks that a line passes in the columns from `start` on; no row where it is outside
    # left < right and keep > 0, so that the edges of a line do not cross
    for k in range(count):
        keep0, keep1 = edges[number, 0, start + k], edges[number, 0, start + k + 1]
        shift0, shift1 = edges[number, 1, start + k], edges[number, 1, start + k + 1]
        p0, p1, p2, p3 = left * keep0 + shift0, right * keep0 + shift0, left * keep1 + shift1, right * keep1 + shift1
        least, greatest = (p0 if p0 < p2 else p2) * scale, (p1 if p1 > p3 else p3) * scale
        inside = ((keep0 > el.NEAREST) | (keep1 > el.NEAREST)) & (greatest >= -WIDEN) & (least <= breadth + WIDEN)
        least, greatest = np.floor(least - WIDEN), np.floor(greatest + WIDEN)
        least = least if least > 0.0 else 0.0
        greatest = greatest if greatest < breadth - 1.0 else breadth - 1.0
        least = least if least < breadth - 1.0 else breadth - 1.0
        work[ROW0 + k] = least
        work[ROW1 + k] = (greatest if greatest > least else least) if inside else -1.0
        work[NEAR + k], work[FAR + k] = 65535.0, 0.0


@fused
def gather_bounds(start, count, first, along_step, across_step, nodes, work, indices):
    # bounds of the blocks of every column
    most = 0.0
    for k in range(count):
        rows = work[ROW1 + k] - work[ROW0 + k]
        most = most if most > rows else rows
    for row in range(int(most) + 1):
        for k in range(count):
            row_idx = work[ROW0 + k] + row
            row_idx = row_idx if row_idx <= work[ROW1 + k] else work[ROW0 + k]
            indices[k] = (
                np.int32(first) + np.int32(start + k) * np.int32(along_step) + np.int32(row_idx) * np.int32(across_step)
            )
        for k in range(count):
            indices[k] = np.int32(nodes[np.uint32(indices[k])])
        for k in range(count):
            inside, node = work[ROW0 + k] + row <= work[ROW1 + k], np.uint32(indices[k])
            near, far = np.float64(np.int32(node & np.uint32(65535))), np.float64(np.int32(node >> np.uint32(16)))
            near, far = near if inside else 65535.0, far if inside else 0.0
            work[NEAR + k] = near if near < work[NEAR + k] else work[NEAR + k]
            work[FAR + k] = far if far > work[FAR + k] else work[FAR + k]


@fused
def bound_depths(number, start, count, edges, low, high, grid, work):
    # range of depths at the far column that the line has met up to each column -> its last
    for k in range(count):
        near, far = work[NEAR + k], work[FAR + k]
        z0, z1 = grid[0] + near * grid[1], grid[0] + far * grid[1]
        drop0, drop1 = edges[number, 2, start + k], edges[number, 2, start + k + 1]
        r0, r1 = edges[number, 3, start + k], edges[number, 3, start + k + 1]
        d0, d1, d2, d3 = (z0 - drop0) * r0, (z0 - drop1) * r1, (z1 - drop0) * r0, (z1 - drop1) * r1
        least, greatest = d0 if d0 < d1 else d1, d2 if d2 > d3 else d3
        work[LOW + k] = least if near <= far else np.inf
        work[HIGH + k] = greatest if near <= far else -np.inf
    for k in range(count):
        low = work[LOW + k] if work[LOW + k] < low else low
        high = work[HIGH + k] if work[HIGH + k] > high else high
        work[LOW + k], work[HIGH + k] = low, high
    return low, high


@fused
def bound_bins(count, left, right, left_end, right_end, bins, least_shift, greatest_shift, sector, work):
    # bins that the line has met up to each column, from floor(least + least_shift) to floor(greatest + greatest_shift)
    over0, over1, over2 = sector[el.OVER], sector[el.OVER + 1], sector[el.OVER + 2]
    under0, under1, under2 = sector[el.UNDER], sector[el.UNDER + 1], sector[el.UNDER + 2]
    over_left, over_right = over0 * left + over2, over0 * right + over2
    under_left, under_right = under0 * left + under2, under0 * right + under2
    for k in range(count):
        low, high = work[LOW + k], work[HIGH + k]
        u0, u1, u2, u3 = (
            under_left + under1 * low, under_left + under1 * high,
            under_right + under1 * low, under_right + under1 * high,
        )  # fmt: skip
        b0 = (over_left + over1 * low) / u0 if u0 > 0.0 else left_end
        b1 = (over_left + over1 * high) / u1 if u1 > 0.0 else left_end
        b2 = (over_right + over1 * low) / u2 if u2 > 0.0 else right_end
        b3 = (over_right + over1 * high) / u3 if u3 > 0.0 else right_end
        least, greatest = b0 if b0 < b1 else b1, b1 if b0 < b1 else b0
        least, greatest = b2 if b2 < least else least, b2 if b2 > greatest else greatest
        least, greatest = b3 if b3 < least else least, b3 if b3 > greatest else greatest
        least, greatest = np.floor(least + least_shift), np.floor(greatest + greatest_shift)
        least = least if least > 0.0 else 0.0
        greatest = greatest if greatest < bins - 1.0 else bins - 1.0
        met = low <= high
        work[BEGIN + k] = least if met & (least < bins) else bins
        work[END + k] = greatest if met & (greatest > -1.0) else -1.0


@fused
def sweep_line(line, number, sectors, edges, nodes, meta, grid, work, indices, table):
    sector = sectors[number]
    level = int(sector[el.LEVEL])
    size = 2.0**level
    base, stride, rows = meta[level]
    swapped, backward = sector[el.AXIS] > 0.5, sector[el.SIGN] < 0.0
    columns, breadth = (rows, stride) if swapped else (stride, rows)
    along_step, across_step = (stride, 1) if swapped else (1, stride)
    left, right = sector[el.EDGE] + line * sector[el.WIDTH], sector[el.EDGE] + (line + 1) * sector[el.WIDTH]
    left_end, right_end = end_of_bins(left, sector), end_of_bins(right, sector)
    bins, step = int(sector[el.BINS]), int(sector[el.BIN_STEP])
    entry = int(sector[el.FIRST]) + line * int(sector[el.LINE_STEP])
    low, high, first, last = np.inf, -np.inf, bins, -1
    if backward:
        base, along_step = base + (columns - 1) * along_step, -along_step
    for start in range(max(int(sector[el.FROM]), 0), int(sector[el.TO]), CHUNK):
        count = min(CHUNK, int(sector[el.TO]) - start)
        bound_columns(number, start, count, left, right, 1.0 / size, float(breadth), edges, work)
        gather_bounds(start, count, base, along_step, across_step, nodes, work, indices)
        low, high = bound_depths(number, start, count, edges, low, high, grid, work)
        bound_bins(count, left, right, left_end, right_end, float(bins), -WIDEN, WIDEN, sector, work)
        for k in range(count):
            begin, end = int(work[BEGIN + k]), int(work[END + k])
            if begin > end or (begin >= first and end <= last):
                continue
            begins = (start + k) * size
            if backward:
                begins = max(sector[el.ALONG] - (columns - start - k) * size, 0.0)
            if last < first:
                first, last = begin, begin - 1
            for row_idx in range(begin, first):
                table[entry + row_idx * step] = begins
            for row_idx in range(last + 1, end + 1):
                table[entry + row_idx * step] = begins
            first, last = min(first, begin), max(last, end)
        if first == 0 and last == bins - 1:
            break


@kernel
def sweep_lines(sectors, edges, nodes, meta, grid, groups, parts, table):
    # sectors, edges: see epipolar_lines; nodes, meta: see quadtree; grid (2,): lowest depth, depth per step;
    # groups (5,) i64: first group of lines of each sector; table (entries,) f32: where along the sector's rays a pixel
    # starts, inf throughout but -inf in entry 0; filled in place
    for part in prange(parts):
        work, indices = np.empty(8 * CHUNK), np.empty(CHUNK, np.int32)
        for group in range(np.int64(part), groups[4], parts):
            number = 0
            while group >= groups[number + 1]:
                number += 1
            first = (group - groups[number]) * GROUP
            last = min(first + GROUP, int(sectors[number, el.LINES]))
            for line in range(first, last):
                sweep_line(line, number, sectors, edges, nodes, meta, grid, work, indices, table)
