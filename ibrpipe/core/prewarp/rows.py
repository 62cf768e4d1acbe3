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
def store(buf, out, k, count):
    # the line of pixels -> row k of the blocks of columns
    for x in range(out.shape[0] * LANES - count):
        buf[np.uint64(LINE + count) + np.uint64(x)] = ZERO
    for block in range(out.shape[0]):
        for lane in range(LANES):
            out[block, k, lane] = buf[LINE + block * LANES + lane]


@fused
def shift_texels(buf, cells, count, begin, eye, zoom, shift, edge, top):
    # shifts in buf -> positions and cells of texels begin .. begin + count - 1; `edge`: first pixel beyond the foot
    # returns the number of holes, and of texels that move
    holes, moved = np.int32(0), np.int32(0)
    for j in range(count):
        g, u = buf[j], np.float32(np.int32(j)) + begin
        x = zoom * (u + (u - eye) * g) + shift
        x = x if g > NONE else (-BEYOND if u < eye else BEYOND)
        buf[POSITIONS + j] = x
        x = max(x, ZERO if u <= eye else edge)
        buf[FIRSTS + j] = np.ceil(min(x, edge if u <= eye else top))
        holes += np.int32(0) if g == g else np.int32(1)
        moved += np.int32(0) if g == ZERO else np.int32(1)
    for j in range(count):
        cells[j] = np.int32(buf[FIRSTS + j])
    return holes, moved


@fused
def rise(buf, cells, last, split):
    # texels 0 .. last, positions rising toward the foot -> pixels below `split`
    for j in range(last):
        x, g = buf[POSITIONS + j], buf[j]
        run = buf[POSITIONS + 1 + j] - x
        slope = (buf[1 + j] - g) / (run if run != ZERO else ONE)
        value = g + (np.float32(cells[j]) - x) * slope
        buf[SLOPES + j] = slope
        buf[FIRSTS + j] = value
        buf[SECONDS + j] = value + slope
    for j in range(last):
        c, n = np.int64(cells[j]), np.int64(cells[1 + j])
        to = np.uint64(LINE + c)
        buf[to] = buf[FIRSTS + j]
        buf[to + np.uint64(1)] = buf[SECONDS + j]
        if n - c > 2:
            for x in range(c + 2, min(n, split)):
                buf[LINE + x] = buf[FIRSTS + j] + np.float32(x - c) * buf[SLOPES + j]
    clear(buf, min(np.int64(cells[last]), split), split + PAD)


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
    before, earlier = buf[LINE + split - 1], buf[LINE + split - 2]
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
    clear(buf, split, max(np.int64(cells[first]), split))
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


@kernel
def warp_rows(height, codes, table, breaks, eye, axis, window, out):
    # height (H, W) f32, NaN = hole, or codes (H, W) u8 with table (256,) f32 of shifts; breaks (H, W) u8, empty = all
    # texels are joined; eye f64: e_u, h from the plane, depth of the plane; axis f64: pixels per texel, and where
    # u = 0 falls, counted from the first pixel's centre
    # window i64: first row, last row + 1, first texel, last texel, count of pixels, whether texels may reach the eye's
    # plane
    # out (blocks, >= H, LANES) f32: shift at pixel centres, NaN = nothing, 0 from `count` on: pixel x of row k stands
    # at [x // LANES, k, x % LANES]; only the window's rows are written
    first, count, careful = window[2], window[4], window[5] != 0
    last = window[3] - first
    coded, broken = table.shape[0] > 0, breaks.shape[0] > 0
    e, h, ground = np.float32(eye[0]), np.float32(eye[1]), np.float32(eye[2])
    zoom, shift, begin = np.float32(axis[0]), np.float32(axis[1]), np.float32(first) + HALF
    tiny = np.float32(1e-6) * abs(h)
    foot = last_before(eye[0], height.shape[1]) - first
    split = first_pixel(eye[0] * axis[0] + axis[1] + 0.5, 0, count)
    to, off = min(foot + 1, last), max(foot, 0)
    aligned = zoom == ONE and shift - HALF == np.round(shift - HALF)
    for job in prange((window[1] - window[0] + ROWS - 1) // ROWS):
        buf = np.empty(LINE + SPAN + LANES, np.float32)
        cells = np.empty(SPAN, np.int32)
        for k in range(window[0] + np.int64(job) * ROWS, min(window[0] + np.int64(job + 1) * ROWS, window[1])):
            if coded:
                row = codes[k, first : window[3] + 1]
                for j in range(last + 1):
                    buf[j] = table[row[j]]
            else:
                line = height[k, first : window[3] + 1]
                for j in range(last + 1):
                    d = line[j] - ground
                    away = h - d
                    buf[j] = d / (away if abs(away) > tiny else -tiny)
            holes, moved = shift_texels(
                buf, cells, last + 1, begin, e, zoom, shift, np.float32(split), np.float32(count)
            )
            if broken:
                for i in range(first, window[3]):
                    holes += np.int32(breaks[k, i] & LONE)
            if moved == 0 and holes == 0 and aligned:
                for x in range(count):
                    j = np.int64(np.round(np.float32(x) - shift - HALF)) - first
                    buf[LINE + x] = ZERO if j >= 0 and j <= last else HOLE
                store(buf, out, k, count)
                continue
            clear(buf, -PAD, count + PAD)
            if split > 0 and to > 0:
                highest = np.int32(0)
                for j in range(to):
                    highest = max(highest, cells[j])
                if holes == 0 and not careful and highest <= cells[to]:
                    rise(buf, cells, to, split)
                else:
                    paint(buf, cells, breaks, k, first, 0, to, 1, 0, split)
            if split < count and off < last:
                lowest = np.int32(count)
                for m in range(last - off):
                    lowest = min(lowest, cells[np.uint64(off + 1) + np.uint64(m)])
                if holes == 0 and not careful and lowest >= cells[off]:
                    fall(buf, cells, last, off, split)
                else:
                    paint(buf, cells, breaks, k, first, last, off, -1, split, count)
            store(buf, out, k, count)
