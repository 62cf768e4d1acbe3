"""The 1-D pre-warp of a relief texture, first pass: rows. Source: oliveira2000, sec. 3.1 and 3.2.

In the texture's own coordinates (columns u, rows v, depth d along f) the eye is E = (e_u, e_v, h), depths counted from
the plane that is warped into. A texel (u, v, d) is seen through the plane's point ``u_i = u + (u - e_u) g`` and
``v_i = v + (v - e_v) g`` with the *shift* ``g = d / (h - d)``; eq. 4 of the paper is the same with
``k1 = -e_u / h, k2 = -e_v / h, k3 = -1 / h``. All follows from g: the texel lies at ``E + (P - E) / (1 + g)`` where P
is the plane's point, so its camera depth is that of P over ``1 + g``, and its own u and v are known. g is linear along
the picture of a straight edge. The passes carry g, one number a texel, in place of row, depth and colour.

Through a side face ("wall", sec. 4.1) displacement and row change places: there g belongs to a whole row, which is
scaled by it, the first pass carries d, and the second coordinate is ``d + (d - h) g``.

Order: texels toward the eye's foot (epipole) on either side; a later texel wins. In a line without holes the segment
that is seen at a pixel before the last texel is the last one that passes it *forward*. So every texel writes the two
pixels that it passes first, without a branch and without a look at what is there: what it writes too much, or of a
segment that runs back, is written over by those that follow, up to the last texel. Spans of over two pixels are filled
on. Lines with holes, and lines that are seen beyond their last texel, are painted segment by segment.

Flat: texels in the plane itself have no displacement, g = 0, and do not move (sec. 5). Where a chunk of `LANES` texels
and the next one are all flat, neither shifts nor slopes are computed: only where its ends fall. Blocks of pixels that
hold nothing but 0 are told to the second pass by a mark and not written.

Symbols: c cell of a position: the first pixel whose centre is not left of it; x position counted from the centre of
the first pixel.
"""

from __future__ import annotations

import math

import numpy as np
from numba import prange

from ibrpipe.core.jit import fused, helper, kernel

#: greatest number of texels or pixels in a line; constant positions in the working memory let loops be vectorised
SPAN = 8192
#: where positions, slopes, first and second values begin in the working memory of a row
POSITIONS, SLOPES, FIRSTS, SECONDS = SPAN, 2 * SPAN, 3 * SPAN, 4 * SPAN
#: pixels on both sides of a line that texels may scribble on, and where the line begins
PAD = 2
LINE = 5 * SPAN + PAD
#: columns that the second pass warps together
LANES = 32
#: rows that one job warps
ROWS = 64
#: position of what is not before the eye's plane
BEYOND = np.float32(1e9)
#: bit of `breaks`: the texel is not joined to its right neighbour
LONE = 1
HALF, ONE, ZERO, NONE, HOLE = (np.float32(x) for x in (0.5, 1.0, 0.0, -1.0, np.nan))


@helper
def last_before(e, count):
    # last texel whose centre is not right of e -> index in [-1, count - 1]
    return min(max(int(math.floor(min(max(e, -2.0), count + 2.0) - 0.5)), -1), count - 1)


@helper
def first_pixel(e, start, count):
    # first pixel of [0, count) whose centre, at start + 0.5, is not left of e
    return int(math.ceil(min(max(e - 0.5 - start, 0.0), float(count))))


@fused
def clear(buf, first, end):
    for x in range(end - first):
        buf[np.uint64(LINE + first) + np.uint64(x)] = HOLE


@fused
def store(buf, out, marks, k, count):
    # the line of pixels -> row k of the blocks of columns; blocks of nothing but 0 are marked instead
    for x in range(out.shape[0] * LANES - count):
        buf[np.uint64(LINE + count) + np.uint64(x)] = ZERO
    for block in range(out.shape[0]):
        other = np.int32(0)
        for lane in range(LANES):
            other += np.int32(0) if buf[LINE + block * LANES + lane] == ZERO else np.int32(1)
        marks[block, k] = np.uint8(1) if other == 0 else np.uint8(0)
        if other > 0:
            for lane in range(LANES):
                out[block, k, lane] = buf[LINE + block * LANES + lane]


@fused
def shift_texels(buf, cells, start, count, begin, eye, zoom, shift, edge, top):
    # shifts in buf -> positions and cells of `count` texels from `start` on, the first of all at `begin`; `edge`: first
    # pixel beyond the foot; returns the number of holes
    holes, base = np.int32(0), np.uint64(start)
    for m in range(count):
        j = base + np.uint64(m)
        g, u = buf[j], np.float32(np.int32(start) + np.int32(m)) + begin
        x = zoom * (u + (u - eye) * g) + shift
        x = x if g > NONE else (-BEYOND if u < eye else BEYOND)
        buf[j + np.uint64(POSITIONS)] = x
        x = max(x, ZERO if u <= eye else edge)
        buf[j + np.uint64(FIRSTS)] = np.ceil(min(x, edge if u <= eye else top))
        holes += np.int32(0) if g == g else np.int32(1)
    for m in range(count):
        j = base + np.uint64(m)
        cells[j] = np.int32(buf[j + np.uint64(FIRSTS)])
    return holes


@fused
def rise(buf, cells, start, last, split):
    # texels start .. last, positions rising toward the foot -> pixels below `split`
    base = np.uint64(start)
    for m in range(last - start):
        j = base + np.uint64(m)
        x, g = buf[j + np.uint64(POSITIONS)], buf[j]
        run = buf[j + np.uint64(POSITIONS + 1)] - x
        slope = (buf[j + np.uint64(1)] - g) / (run if run != ZERO else ONE)
        value = g + (np.float32(cells[j]) - x) * slope
        buf[j + np.uint64(SLOPES)] = slope
        buf[j + np.uint64(FIRSTS)] = value
        buf[j + np.uint64(SECONDS)] = value + slope
    for m in range(last - start):
        j = base + np.uint64(m)
        c, n = np.int64(cells[j]), np.int64(cells[j + np.uint64(1)])
        to = np.uint64(LINE + c)
        buf[to] = buf[j + np.uint64(FIRSTS)]
        buf[to + np.uint64(1)] = buf[j + np.uint64(SECONDS)]
        if n - c > 2:
            for x in range(c + 2, min(n, split)):
                buf[LINE + x] = buf[j + np.uint64(FIRSTS)] + np.float32(x - c) * buf[j + np.uint64(SLOPES)]


@fused
def fall(buf, cells, last, first, split):
    # texels last .. first, positions falling toward the foot -> pixels from `split` on
    base = np.uint64(first)
    for m in range(last - first):
        j = base + np.uint64(m)
        x, g = buf[j + np.uint64(POSITIONS + 1)], buf[j + np.uint64(1)]
        run = buf[j + np.uint64(POSITIONS)] - x
        slope = (buf[j] - g) / (run if run != ZERO else ONE)
        value = g + (np.float32(cells[j + np.uint64(1)]) - ONE - x) * slope
        buf[j + np.uint64(SLOPES)] = slope
        buf[j + np.uint64(FIRSTS)] = value
        buf[j + np.uint64(SECONDS)] = value - slope
    for back in range(last - first):
        j = np.uint64(last - 1 - back)
        c, n = np.int64(cells[j + np.uint64(1)]), np.int64(cells[j])
        to = np.uint64(LINE - 2 + c)
        buf[to + np.uint64(1)] = buf[j + np.uint64(FIRSTS)]
        buf[to] = buf[j + np.uint64(SECONDS)]
        if c - n > 2:
            for x in range(max(n, split), c - 2):
                step = np.float32(x - c + 1)
                buf[LINE + x] = buf[j + np.uint64(FIRSTS)] + step * buf[j + np.uint64(SLOPES)]


@fused
def find_runs(level, first, last, begins, kinds):
    # level (chunks,) u8: which chunks are flat, empty = none -> number of runs of texels that are alike: run r of kind
    # kinds[r] (1 = flat) from begins[r] to begins[r + 1] - 1, counted from `first`
    begins[0], kinds[0] = 0, level[first // LANES] if level.shape[0] > 0 else 0
    count = 1
    for c in range(first // LANES + 1, (first + last) // LANES + 1 if level.shape[0] > 0 else 0):
        if level[c] != kinds[count - 1]:
            begins[count], kinds[count] = c * LANES - first, level[c]
            count += 1
    begins[count] = last + 1
    return count


@fused
def place_line(buf, cells, runs, source, ends, scale):
    # positions and cells of a line's texels; of flat runs only those that are asked for; source: height, codes, table,
    # row, first texel; ends: `to`, `off`; scale: begin, eye, h, ground, zoom, shift, edge, top -> number of holes
    begins, kinds, count = runs
    begin, eye, h, ground, zoom, shift, edge, top = scale
    to, off = ends
    holes = np.int32(0)
    for r in range(count):
        start, end = begins[r], begins[r + 1]
        if kinds[r] == 0:
            take_shifts(buf, source, start, end, h, ground)
            holes += shift_texels(buf, cells, start, end - start, begin, eye, zoom, shift, edge, top)
            continue
        for j in (start, end - 1, to - 1, to, off, off + 1):
            if start <= j and j < end:
                buf[j] = ZERO
                shift_texels(buf, cells, j, 1, begin, eye, zoom, shift, edge, top)
    return holes


@fused
def fill_flat(buf, cells, runs, scale):
    # what `place_line` has left out
    begins, kinds, count = runs
    begin, eye, _, _, zoom, shift, edge, top = scale
    for r in range(count):
        if kinds[r] != 0:
            for j in range(begins[r], begins[r + 1]):
                buf[j] = ZERO
            shift_texels(buf, cells, begins[r], begins[r + 1] - begins[r], begin, eye, zoom, shift, edge, top)


@fused
def extremes(cells, runs, to, off, highest, lowest):
    # greatest cell of the texels before `to`, and least of those after `off`
    begins, kinds, count = runs
    for r in range(count):
        start, end = begins[r], begins[r + 1]
        low, high = max(start, off + 1), min(end, to)
        if kinds[r] != 0:
            highest = max(highest, cells[high - 1]) if start < high else highest
            lowest = min(lowest, cells[low]) if low < end else lowest
            continue
        for m in range(high - start):
            highest = max(highest, cells[np.uint64(start) + np.uint64(m)])
        for m in range(end - low):
            lowest = min(lowest, cells[np.uint64(low) + np.uint64(m)])
    return highest, lowest


@fused
def pass_left(buf, cells, runs, to, split):
    # texels 0 .. to toward a foot on the right
    begins, kinds, count = runs
    for r in range(count):
        start, end = begins[r], min(begins[r + 1], to)
        if start >= end:
            break
        if kinds[r] == 0:
            rise(buf, cells, start, end, split)
            continue
        for x in range(np.int64(cells[start]), min(np.int64(cells[end]), split)):
            buf[LINE + x] = ZERO
    clear(buf, min(np.int64(cells[to]), split), split + PAD)


@fused
def pass_right(buf, cells, runs, last, off, split):
    # texels last .. off toward a foot on the left; pixels before `split` stay
    begins, kinds, count = runs
    before, earlier = buf[LINE + split - 1], buf[LINE + split - 2]
    for back in range(count):
        r = count - 1 - back
        start, end = max(begins[r], off), min(begins[r + 1], last)
        if start >= end:
            continue
        if kinds[r] == 0:
            fall(buf, cells, end, start, split)
            continue
        for x in range(max(np.int64(cells[start]), split), np.int64(cells[end])):
            buf[LINE + x] = ZERO
    clear(buf, split, max(np.int64(cells[off]), split))
    buf[LINE + split - 1], buf[LINE + split - 2] = before, earlier


@fused
def paint(buf, cells, breaks, k, base, first, last, step, begin, end):
    # segment by segment in order: none touches a hole (NaN) or a texel that `breaks` parts from its neighbour; `base`:
    # the texel that buf begins with
    broken = breaks.shape[0] > 0
    for o in range((last - first) * step):
        j = first + o * step
        if buf[j] != buf[j] or buf[j + step] != buf[j + step]:
            continue
        if broken and breaks[k, base + (j if step > 0 else j - 1)] & LONE:
            continue
        c, n = np.int64(cells[j]), np.int64(cells[j + step])
        if c == n:
            continue
        far = j if abs(buf[j]) <= abs(buf[j + step]) else j + step  # the end that is farther from the eye's plane
        slope = (buf[j + step] - buf[j]) / (buf[POSITIONS + j + step] - buf[POSITIONS + j])
        for x in range(max(min(c, n), begin), min(max(c, n), end)):
            buf[LINE + x] = buf[far] + (np.float32(x) - buf[POSITIONS + far]) * slope


@fused
def take_shifts(buf, source, start, end, h, ground):
    # shifts of texels start .. end - 1 of a row, counted from its first texel
    height, codes, table, k, first = source
    if table.shape[0] > 0:
        row = codes[k, first + start : first + end]
        for m in range(end - start):
            buf[np.uint64(start) + np.uint64(m)] = table[row[m]]
        return
    line, tiny = height[k, first + start : first + end], np.float32(1e-6) * abs(h)
    for m in range(end - start):
        d = line[m] - ground
        away = h - d
        buf[np.uint64(start) + np.uint64(m)] = d / (away if abs(away) > tiny else -tiny)


@fused
def copy_row(out, marks, k, other):
    # row `other` of the blocks of columns -> row k
    for block in range(out.shape[0]):
        marks[block, k] = marks[block, other]
        if marks[block, other] == 0:
            for lane in range(LANES):
                out[block, k, lane] = out[block, other, lane]


@kernel
def warp_rows(height, codes, table, breaks, flat, eye, axis, window, out, marks):
    # height (H, W) f32, NaN = hole, or codes (H, W) u8 with table (256,) f32 of shifts; breaks (H, W) u8, empty = all
    # texels are joined; flat (H, chunks) u8: where all texels of a chunk of LANES and the one after it are in the
    # plane, empty = nowhere; eye f64: e_u, h from the plane, depth of the plane; axis f64: pixels per texel, and where
    # u = 0 falls, counted from the first pixel's centre
    # window i64: first row, last row + 1, first texel, last texel, count of pixels, whether texels may reach the eye's
    # plane
    # out (blocks, >= H, LANES) f32: shift at pixel centres, NaN = nothing, 0 from `count` on: pixel x of row k stands
    # at [x // LANES, k, x % LANES]; only the window's rows are written; marks (blocks, >= H) u8: 1 where all LANES
    # pixels are 0 and were not written
    first, count, careful = window[2], window[4], window[5] != 0
    last = window[3] - first
    foot = last_before(eye[0], height.shape[1]) - first
    split = first_pixel(eye[0] * axis[0] + axis[1] + 0.5, 0, count)
    to, off = min(foot + 1, last), max(foot, 0)
    scale = (
        np.float32(first) + HALF, np.float32(eye[0]), np.float32(eye[1]), np.float32(eye[2]), np.float32(axis[0]),
        np.float32(axis[1]), np.float32(split), np.float32(count),
    )  # fmt: skip
    for job in prange((window[1] - window[0] + ROWS - 1) // ROWS):
        buf = np.empty(LINE + SPAN + LANES, np.float32)
        cells, begins = np.empty(SPAN, np.int32), np.empty(SPAN // LANES + 2, np.int64)
        kinds, still = np.empty(SPAN // LANES + 2, np.uint8), np.int64(-1)  # still: a row of this job that is flat
        for k in range(window[0] + np.int64(job) * ROWS, min(window[0] + np.int64(job + 1) * ROWS, window[1])):
            runs = (begins, kinds, find_runs(flat[k] if flat.shape[0] > 0 else kinds[:0], first, last, begins, kinds))
            if runs[2] == 1 and kinds[0] != 0:
                if still >= 0:
                    copy_row(out, marks, k, still)
                    continue
                still = k
            holes = place_line(buf, cells, runs, (height, codes, table, k, first), (to, off), scale)
            if breaks.shape[0] > 0:
                for i in range(first, window[3]):
                    holes += np.int32(breaks[k, i] & LONE)
            highest, lowest = extremes(cells, runs, to, off, np.int32(0), np.int32(count))
            smooth = holes == 0 and not careful
            left, right = smooth and highest <= cells[to], smooth and lowest >= cells[off]
            if not (left and right):
                fill_flat(buf, cells, runs, scale)
            clear(buf, -PAD, count + PAD)
            if split > 0 and to > 0:
                if left:
                    pass_left(buf, cells, runs, to, split)
                else:
                    paint(buf, cells, breaks, k, first, 0, to, 1, 0, split)
            if split < count and off < last:
                if right:
                    pass_right(buf, cells, runs, last, off, split)
                else:
                    paint(buf, cells, breaks, k, first, last, off, -1, split, count)
            store(buf, out, marks, k, count)
