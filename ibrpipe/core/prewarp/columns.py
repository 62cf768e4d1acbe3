"""The 1-D pre-warp, second pass: columns, many side by side. Source: oliveira2000, sec. 3.2. See `core.prewarp`."""

from __future__ import annotations

import numpy as np
from numba import prange

from ibrpipe.core.jit import fused, kernel
from ibrpipe.core.prewarp.rows import HOLE, LANES, ONE, PAD, ZERO

#: where positions and values (of two rows in turn), first and second values and slopes begin in the working memory
POSITIONS, VALUES, FIRSTS, SECONDS, SLOPES = 0, 2 * LANES, 4 * LANES, 5 * LANES, 6 * LANES
#: where rows that are kept begin in it
KEPT = 7 * LANES
#: where cells of two rows, least and greatest cell, and counts of holes begin in the working memory of integers
LOWEST, HIGHEST, BAD = 2 * LANES, 3 * LANES, 4 * LANES


@fused
def paint_column(values, lines, wall, h, gap, lane, x, side, out):
    # column `lane` of `values` into column x, segment by segment in the order of `side`
    begin, end, count = side[4], side[5], out.shape[0] - 2 * PAD
    for y in range(begin, end):
        out[y + PAD, x] = HOLE
    joined, cell, position, shift, depth = False, np.int64(0), ZERO, ZERO, ZERO
    for o in range((side[1] - side[0]) * side[2] + 1):
        k = side[0] + o * side[2]
        value = values[k, lane]
        if value != value:
            joined = False
            continue
        to = lines[0, k] + lines[1, k] * value
        g = lines[2, k] if wall else value
        deep = value if wall else h * value / (ONE + value)
        c = np.int64(np.ceil(min(max(to, ZERO), np.float32(count))))
        if joined and c != cell and abs(deep - depth) <= gap:
            slope = (g - shift) / (to - position)
            for y in range(max(min(c, cell), begin), min(max(c, cell), end)):
                out[y + PAD, x] = g + (np.float32(y) - to) * slope
        joined, cell, position, shift, depth = True, c, to, g, deep


@fused
def place_row(values, lines, wall, k, least, most, half, buf, cells):
    # positions, values and cells of row k; `half`: which of the two rows kept -> how many lanes hold something
    base, gain, own = lines[0, k], lines[1, k], lines[2, k]
    row, some = values[k], np.int32(0)
    for lane in range(LANES):
        value = row[lane]
        to = base + gain * value if value == value else ZERO
        buf[POSITIONS + half + lane] = to
        buf[VALUES + half + lane] = (own if value == value else HOLE) if wall else value
        cell = np.int32(np.ceil(min(max(to, least), most)))
        cells[half + lane] = cell
        cells[LOWEST + lane] = min(cells[LOWEST + lane], cell)
        cells[HIGHEST + lane] = max(cells[HIGHEST + lane], cell)
        some += np.int32(1) if value == value else np.int32(0)
    return some


@fused
def paint_lanes(values, rule, x, k, step, halves, ahead, ends, buf, cells, out):
    # of rows k - step and k: the segments of columns with holes, to their ends and no farther; rule: wall, h, gap;
    # halves: where the memory keeps row k and the one before; ends: first pixel, last + 1
    (wall, h, gap), (half, other), (begin, end) = rule, halves, ends
    for lane in range(LANES):
        if cells[BAD + lane] == 0 or buf[VALUES + half + lane] != buf[VALUES + half + lane]:
            continue
        if buf[VALUES + other + lane] != buf[VALUES + other + lane]:
            continue
        if gap < np.inf:
            p, q = values[k - step, lane], values[k, lane]
            if not wall:
                p, q = h * p / (ONE + p), h * q / (ONE + q)
            if abs(p - q) > gap:
                continue
        c, n = np.int64(cells[other + lane]), np.int64(cells[half + lane])
        first = np.float32(c) - ahead
        for y in range(max(min(c, n), begin), min(max(c, n), end)):
            out[y + PAD, x + lane] = buf[FIRSTS + lane] + (np.float32(y) - first) * buf[SLOPES + lane]


@fused
def cell_of(base, least, most):
    # cell of a row without displacement
    return np.int32(np.ceil(min(max(base, least), most)))


@fused
def recall_row(values, base, cell, half, buf, cells):
    # what `place_row` leaves of a marked row, and its values
    for lane in range(LANES):
        values[lane] = ZERO
        buf[POSITIONS + half + lane], buf[VALUES + half + lane] = base, ZERO
        cells[half + lane] = cell


@fused
def pass_columns(values, marks, lines, wall, h, gap, x, side, buf, cells, out):
    # write what each row passes forward (see `core.prewarp`), columns x to x + LANES; pixels of `side` and up to PAD on
    begin, end, count = side[4], side[5], out.shape[0] - 2 * PAD
    marked, least_flat, most_flat = marks.shape[0] > 0, np.int32(count), np.int32(0)
    rising = side[3] > 0
    least, most = np.float32(begin), np.float32(end)
    holes = np.int32(0)
    for lane in range(LANES):
        cells[LOWEST + lane], cells[HIGHEST + lane] = np.int32(count), np.int32(0)
        holes += np.int32(0) if cells[BAD + lane] == 0 else np.int32(1)
    total = (side[1] - side[0]) * side[2]
    sign = np.float32(1.0 if rising else -1.0)
    ahead, start = ZERO if rising else ONE, np.uint64(x)
    for o in range(total + 1):
        half, other = (o & 1) * LANES, ((o + 1) & 1) * LANES
        if o == total:
            least, most = ZERO, np.float32(count)
        k = side[0] + o * side[2]
        before = k - side[2]
        if marked and marks[k] != 0:
            cell = cell_of(lines[0, k], least, most)
            least_flat, most_flat = min(least_flat, cell), max(most_flat, cell)
            if o > 0 and marks[before] != 0 and o < total:
                c = cell_of(lines[0, before], least, most)
                for y in range(min(c, cell), max(c, cell)):
                    for lane in range(LANES):
                        out[np.uint64(y + PAD), start + np.uint64(lane)] = ZERO
                continue
            some = np.int32(LANES)
            recall_row(values[k], lines[0, k], cell, half, buf, cells)
        else:
            some = place_row(values, lines, wall, k, least, most, half, buf, cells)
        if o == 0 or some == 0:
            continue
        if marked and marks[before] != 0:
            c = cell_of(lines[0, before], np.float32(begin), np.float32(end))
            recall_row(values[before], lines[0, before], c, other, buf, cells)
        for lane in range(LANES):
            position, g = buf[POSITIONS + other + lane], buf[VALUES + other + lane]
            run = buf[POSITIONS + half + lane] - position
            slope = (buf[VALUES + half + lane] - g) / (run if run != ZERO else ONE)
            value = g + (np.float32(cells[other + lane]) - ahead - position) * slope
            buf[FIRSTS + lane], buf[SECONDS + lane] = value, value + sign * slope
            buf[SLOPES + lane] = slope
        if holes == LANES:
            pass
        elif rising:
            for lane in range(LANES):
                if holes > 0 and cells[BAD + lane] != 0:
                    continue
                c, n, column = np.int64(cells[other + lane]), np.int64(cells[half + lane]), start + np.uint64(lane)
                out[np.uint64(c + PAD), column] = buf[FIRSTS + lane]
                out[np.uint64(c + PAD + 1), column] = buf[SECONDS + lane]
                if n - c > 2:
                    for y in range(c + 2, min(n, end)):
                        step = np.float32(y - c)
                        out[np.uint64(y + PAD), column] = buf[FIRSTS + lane] + step * buf[SLOPES + lane]
        else:
            for lane in range(LANES):
                if holes > 0 and cells[BAD + lane] != 0:
                    continue
                c, n, column = np.int64(cells[other + lane]), np.int64(cells[half + lane]), start + np.uint64(lane)
                out[np.uint64(c + PAD - 1), column] = buf[FIRSTS + lane]
                out[np.uint64(c + PAD - 2), column] = buf[SECONDS + lane]
                if c - n > 2:
                    for y in range(max(n, begin), c - 2):
                        step = np.float32(y - c + 1)
                        out[np.uint64(y + PAD), column] = buf[FIRSTS + lane] + step * buf[SLOPES + lane]
        if holes > 0:
            rule, ends = (wall, h, gap), (begin, end)
            paint_lanes(values, rule, x, k, side[2], (half, other), ahead, ends, buf, cells, out)
    half = (total & 1) * LANES
    for lane in range(LANES):
        cells[LOWEST + lane] = min(cells[LOWEST + lane], least_flat)
        cells[HIGHEST + lane] = max(cells[HIGHEST + lane], most_flat)
        if cells[BAD + lane] != 0:
            continue
        c = np.int64(cells[half + lane])
        low, high = (max(min(c, end), begin), end) if rising else (begin, min(max(c, begin), end))
        for y in range(low, high):
            out[y + PAD, x + lane] = HOLE
        beyond = cells[HIGHEST + lane] > c if rising else cells[LOWEST + lane] < c
        if beyond and low < high:
            unmark(values, marks, side)
            paint_column(values, lines, wall, h, gap, lane, x + lane, side, out)


@fused
def unmark(values, marks, side):
    # write the zeros that marks stand for
    for k in range(min(side[0], side[1]), max(side[0], side[1]) + 1 if marks.shape[0] > 0 else 0):
        if marks[k] != 0:
            marks[k] = 0
            for lane in range(LANES):
                values[k, lane] = ZERO


@fused
def find_holes(values, marks, wall, h, gap, first, last, cells):
    # cells[BAD:]: whether something is missing in a column -> whether all is missing in all of them
    marked = marks.shape[0] > 0
    for k in range(first, last + 1):
        if marked and marks[k] != 0:
            continue
        row = values[k]
        for lane in range(LANES):
            value = row[lane]
            cells[BAD + lane] += np.int32(0) if value == value else np.int32(1)
    empty = np.int32(0)
    for lane in range(LANES):
        empty += np.int32(1) if cells[BAD + lane] == last + 1 - first else np.int32(0)
    if gap < np.inf:
        for k in range(first, last):
            here, there = marked and marks[k] != 0, marked and marks[k + 1] != 0
            if here and there:
                continue
            for lane in range(LANES):
                p, q = ZERO if here else values[k, lane], ZERO if there else values[k + 1, lane]
                if not wall:
                    p, q = h * p / (ONE + p), h * q / (ONE + q)
                cells[BAD + lane] |= np.int32(1) if abs(p - q) > gap else np.int32(0)
    return empty == LANES


@kernel
def warp_columns(values, marks, lines, wall, eye, gap, sides, columns, out):
    # values (blocks, >= H, LANES) f32 and marks (blocks, >= H) u8 from the first pass, marks empty = none
    # lines (3, H) f32: a row's position, counted
    # from the centre of the first pixel, is lines[0] + lines[1] * value, its shift lines[2] (wall) or the value itself
    # eye f64: h from the plane; gap: greatest step of depth between joined samples
    # sides (2, 6) i64: first row, last row in order, step, 1 = positions rise in order, -1 = they fall, first pixel,
    # last pixel + 1; the first side ends where the second begins
    # out (PAD + count + PAD, stride) f32: shift at pixel centres, NaN = nothing; what lies in the PAD is void
    h, count = np.float32(eye), out.shape[0] - 2 * PAD
    nothing = np.empty(0, np.uint8)
    first = min(min(sides[0, 0], sides[0, 1]), min(sides[1, 0], sides[1, 1]))
    last = max(max(sides[0, 0], sides[0, 1]), max(sides[1, 0], sides[1, 1]))
    for block in prange((columns + LANES - 1) // LANES):
        x = np.int64(block) * LANES
        buf = np.empty(KEPT + 2 * LANES, np.float32)
        cells = np.zeros(5 * LANES, np.int32)
        own = marks[block] if marks.shape[0] > 0 else nothing
        empty = find_holes(values[block], own, wall, h, gap, first, last, cells)
        for y in range(count):  # this also brings into the cache what is then written here and there
            line = out[y + PAD, x : x + LANES]
            for lane in range(LANES):
                line[lane] = HOLE
        if empty:
            continue
        for n in range(2):
            side = sides[n]
            if side[4] >= side[5]:
                continue
            for lane in range(LANES):
                buf[KEPT + lane] = out[side[4] + PAD - 1, x + lane]
                buf[KEPT + LANES + lane] = out[side[4] + PAD - 2, x + lane]
            pass_columns(values[block], own, lines, wall, h, gap, x, side, buf, cells, out)
            for lane in range(LANES):
                out[side[4] + PAD - 1, x + lane] = buf[KEPT + lane]
                out[side[4] + PAD - 2, x + lane] = buf[KEPT + LANES + lane]
                out[side[5] + PAD, x + lane] = HOLE
                out[side[5] + PAD + 1, x + lane] = HOLE


@kernel
def scale_rows(height, codes, table, breaks, eye, axis, shifts, window, out):
    # first pass of a wall: as warp_rows, with shifts (H,) f32 of the rows and table (256,) f32 of depths; window i64:
    # first row, last row + 1, first texel, last texel, count -> out (blocks, >= H, LANES) f32: depth at pixel centres
    first, last, count = window[2], window[3], window[4]
    coded, broken = table.shape[0] > 0, breaks.shape[0] > 0
    low, high = np.float32(np.int32(first)), np.float32(np.int32(last))
    for job in prange(window[1] - window[0]):
        k = window[0] + np.int64(job)
        wide = 1.0 / (axis[0] * (1.0 + shifts[k]))
        step, start = np.float32(wide), np.float32(eye - (axis[1] + axis[0] * eye) * wide - 0.5)
        for x in range(out.shape[0] * LANES):
            u = start + np.float32(np.int32(x)) * step
            inside = u >= low and u <= high
            i = min(np.int64(u), last - 1) if inside else first
            t = u - np.float32(np.int32(i))
            if coded:
                a, b = table[codes[k, i]], table[codes[k, i + 1]]
            else:
                a, b = height[k, i], height[k, i + 1]
            value = a + t * (b - a)
            if broken and breaks[k, i] & 1:
                value = HOLE
            value = value if inside else HOLE
            out[x // LANES, k, x % LANES] = value if x < count else ZERO
