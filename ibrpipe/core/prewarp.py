"""The 1-D pre-warp of a relief texture: rows, then columns. Source: oliveira2000, sec. 3.1 and 3.2.

In the texture's own coordinates (columns u, rows v, depth d along f) the eye is E = (e_u, e_v, h), depths counted from
the plane that is warped into. A texel (u, v, d) is seen through the plane's point ``u_i = u + (u - e_u) g`` and
``v_i = v + (v - e_v) g`` with the *shift* ``g = d / (h - d)``; eq. 4 of the paper is the same with
``k1 = -e_u / h, k2 = -e_v / h, k3 = -1 / h``. All follows from g: the texel lies at ``E + (P - E) / (1 + g)`` where P
is the plane's point, so its camera depth is that of P over ``1 + g``, and its own u and v are known. g is linear along
the picture of a straight edge. The passes carry g, one number a texel, in place of row, depth and colour.

Through a side face ("wall", sec. 4.1) displacement and row change places: there g belongs to a whole row, the columns
are scaled by it, the first pass carries d, and the second coordinate is ``d + (d - h) g``.

Order: texels toward the eye's foot (epipole) on either side; a later texel wins. In a line without holes the winner
at x is the segment after which all texels lie on one side of x: two running maxima find it without branches. Lines
with holes are painted segment by segment.

Symbols: c cell of a position: the first pixel whose centre is not left of it; o place in the order.
"""

from __future__ import annotations

import math

import numpy as np
from numba import prange

from ibrpipe.core.jit import fused, helper, kernel

#: columns that are warped together
LANES = 32
#: greatest number of texels or pixels in a line; constant places in the working memory let loops be vectorised
SPAN = 8192
#: where the cells of texels and the marks of pixels begin in the working memory of a row
CELLS, MARKS = SPAN, 2 * SPAN
#: where the winners of columns begin in the working memory of a block of columns
BELOW = (SPAN + 1) * LANES
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
def scan_row(buf, first, last, step, begin, end, count):
    # texels first, first + step, ... last in order, buf[CELLS:] their cells -> buf[MARKS + x], begin <= x < end: place
    # in the order of the winning segment's earlier texel, -1 = none
    for x in range(count + 1):
        buf[MARKS + x] = NONE
    total = (last - first) * step + 1
    if total < 2:
        return
    for o in range(total):
        buf[MARKS + np.int64(np.uint32(buf[CELLS + first + o * step]))] = np.float32(o)
    stop = int(buf[CELLS + last])
    most = NONE
    for x in range(count, stop, -1):
        value = buf[MARKS + x]
        most = value if value > most else most
        buf[MARKS + x] = most
    for x in range(stop, count):
        buf[MARKS + x] = buf[MARKS + x + 1]
    most = NONE
    for x in range(min(stop, end)):
        value = buf[MARKS + x]
        most = value if value > most else most
        buf[MARKS + x] = most


@fused
def paint_row(buf, breaks, k, first, last, step, begin, end):
    # as scan_row, segment by segment: none touches a hole (NaN) or a texel that `breaks` parts from its neighbour
    for x in range(begin, end):
        buf[MARKS + x] = NONE
    broken = breaks.shape[0] > 0
    for o in range((last - first) * step):
        i = first + o * step
        if buf[i] != buf[i] or buf[i + step] != buf[i + step]:
            continue
        if broken and breaks[k, i if step > 0 else i - 1] & LONE:
            continue
        p, q = int(buf[CELLS + i]), int(buf[CELLS + i + step])
        for x in range(max(min(p, q), begin), min(max(p, q), end)):
            buf[MARKS + x] = np.float32(o)


@kernel
def warp_rows(height, codes, table, breaks, eye, shifts, window, out):
    # height (H, W) f32, NaN = hole, or codes (H, W) u8 with table (256,) f32 of shifts (wall: depths); breaks (H, W)
    # u8, empty = all texels are joined; eye f64: e_u, h from the plane, depth of the plane; shifts (H,) f32: shifts of
    # the rows (wall), empty for the plane itself
    # window i64: first row, last row + 1, first texel, last texel, left border of out's first pixel, count, and whether
    # texels may reach the eye's plane
    # out (H, >= count) f32: shift (wall: depth) at pixel centres, NaN = nothing, 0 from `count` on; only the window's
    # rows are written
    first, last, left, count, careful = window[2], window[3], window[4], window[5], window[6] != 0
    wall, coded, broken = shifts.shape[0] > 0, table.shape[0] > 0, breaks.shape[0] > 0
    e, h, ground = np.float32(eye[0]), np.float32(eye[1]), np.float32(eye[2])
    top, origin, tiny = np.float32(count), np.float32(left + 0.5), np.float32(1e-6) * abs(np.float32(eye[1]))
    foot = last_before(eye[0], height.shape[1])
    split = count if wall else first_pixel(eye[0], left, count)
    ends = (last, last) if wall else (min(foot + 1, last), max(foot, first))
    for job in prange(window[1] - window[0]):
        k = window[0] + np.int64(job)
        buf = np.empty(3 * SPAN, np.float32)
        shift = shifts[k] if wall else ZERO
        for x in range(count, out.shape[1]):
            out[k, x] = ZERO
        if coded:
            for i in range(first, last + 1):
                buf[i] = table[codes[k, i]]
        elif wall:
            for i in range(first, last + 1):
                buf[i] = height[k, i]
        else:
            for i in range(first, last + 1):
                d = height[k, i] - ground
                away = h - d
                away = away if abs(away) > tiny else -tiny
                buf[i] = d / away
        holes, moved = np.int32(0), np.int32(0)
        for i in range(first, last + 1):
            g = shift if wall else buf[i]
            u = np.float32(i) + HALF
            p = u + (u - e) * g
            p = p if g > NONE else (-BEYOND if u < e else BEYOND)
            buf[CELLS + i] = np.ceil(min(max(p - origin, ZERO), top))
            holes += np.int32(0) if buf[i] == buf[i] else np.int32(1)
            moved += np.int32(0) if g == ZERO else np.int32(1)
        if broken:
            for i in range(first, last + 1):
                holes += np.int32(breaks[k, i] & LONE)
        if moved == 0 and holes == 0 and not wall:
            for x in range(count):
                out[k, x] = ZERO if x + left >= first and x + left < last + 1 else HOLE
            continue
        for side in range(2):
            a, b, begin, step = (0, split, first, 1) if side == 0 else (split, count, last, -1)
            if a >= b:
                continue
            if holes > 0:
                paint_row(buf, breaks, k, begin, ends[side], step, a, b)
            else:
                scan_row(buf, begin, ends[side], step, a, b, count)
            lowest, sign = np.float32(begin if side == 0 else begin - 1), np.float32(step)
            for x in range(a, b):
                o = buf[MARKS + x]
                i = lowest + sign * max(o, ZERO)
                c = np.uint32(i)
                va, vb = buf[c], buf[c + np.uint32(1)]
                ga, gb = (shift, shift) if wall else (va, vb)
                u = i + HALF
                pa, pb = u + (u - e) * ga, u + ONE + (u + ONE - e) * gb
                swap = careful and abs(gb) < abs(ga)  # from the end that is farther from the eye's plane
                t = (np.float32(np.int32(x)) + origin - (pb if swap else pa)) / (pb - pa)
                value = (vb if swap else va) + t * (vb - va)
                out[k, x] = value if o >= ZERO else HOLE


@fused
def paint_column(values, lines, wall, h, gap, x, begin, end, step, origin, ya, yb, count, buf, lane):
    # buf[y * LANES + lane] for ya <= y < yb: place in the order of the last segment's earlier row, -1 = none
    before, depth_before = np.int64(-1), ZERO
    for y in range(ya, yb):
        buf[y * LANES + lane] = NONE
    for o in range((end - begin) * step + 1):
        k = begin + o * step
        value = values[k, x]
        if value != value:
            before = -1
            continue
        place = lines[0, k] - origin + lines[1, k] * value
        cell = np.int64(np.ceil(min(max(place, ZERO), np.float32(count))))
        depth = value if wall else h * value / (ONE + value)
        if before >= 0 and abs(depth - depth_before) <= gap:
            for y in range(max(min(before, cell), ya), min(max(before, cell), yb)):
                buf[y * LANES + lane] = np.float32(o - 1)
        before, depth_before = cell, depth


@fused
def scan_column(values, lines, x, begin, end, step, origin, yb, count, buf):
    # as scan_row for the columns x to x + LANES: buf[y * LANES + lane] for y < yb
    for y in range((count + 1) * LANES):
        buf[y] = NONE
    total = (end - begin) * step + 1
    if total < 2:
        return
    top = np.float32(count)
    for o in range(total):
        k = begin + o * step
        place, gain = lines[0, k] - origin, lines[1, k]
        for lane in range(LANES):
            cell = np.ceil(min(max(place + gain * values[k, x + lane], ZERO), top))
            buf[BELOW + lane] = cell
        for lane in range(LANES):
            buf[np.int64(np.uint32(buf[BELOW + lane])) * LANES + lane] = np.float32(o)
    stop = count
    for lane in range(LANES):
        stop = min(stop, int(buf[BELOW + lane]))
    for lane in range(LANES):
        buf[BELOW + count * LANES + lane] = buf[count * LANES + lane]
    for back in range(count - stop):
        y = count - 1 - back
        for lane in range(LANES):
            value = buf[y * LANES + lane]
            most = buf[BELOW + (y + 1) * LANES + lane]
            buf[BELOW + y * LANES + lane] = value if value > most else most
    for y in range(1, yb):
        for lane in range(LANES):
            value, most = buf[y * LANES + lane], buf[(y - 1) * LANES + lane]
            buf[y * LANES + lane] = value if value > most else most
    for y in range(stop, yb):
        for lane in range(LANES):
            ahead, behind = buf[BELOW + (y + 1) * LANES + lane], buf[y * LANES + lane]
            buf[y * LANES + lane] = ahead if ahead < behind else behind


@kernel
def warp_columns(values, flat, lines, wall, eye, gap, window, out):
    # values (H, stride) f32 from warp_rows and the same flat, stride a multiple of LANES; lines (3, H) f32: a row's
    # second coordinate is lines[0] + lines[1] * value, its shift lines[2] (wall) or the value itself; eye f64: h from
    # the plane; gap: greatest step of depth between joined samples
    # window i64: first row, last row, columns, split: pixels before it see rows first, ... window[4] in order, the
    # others last, ... window[5]; top border of out's first pixel
    # out (count, stride) f32: shift at pixel centres, NaN = nothing
    first, last, columns, split = window[0], window[1], window[2], window[3]
    origin, h = np.float32(window[6] + 0.5), np.float32(eye)
    count, stride = out.shape[0], np.uint32(values.shape[1])
    for block in prange((columns + LANES - 1) // LANES):
        begin = np.int64(block) * LANES
        buf = np.empty(2 * BELOW, np.float32)
        bad = np.int32(0)
        for k in range(first, last + 1):
            for lane in range(LANES):
                value = values[k, begin + lane]
                bad += np.int32(0) if value == value else np.int32(1)
        if bad == 0 and gap < np.inf:
            for k in range(first, last):
                for lane in range(LANES):
                    p, q = values[k, begin + lane], values[k + 1, begin + lane]
                    p, q = (p, q) if wall else (h * p / (ONE + p), h * q / (ONE + q))
                    bad += np.int32(1) if abs(p - q) > gap else np.int32(0)
        for side in range(2):
            ya, yb, start, step = (0, split, first, 1) if side == 0 else (split, count, last, -1)
            if ya >= yb:
                continue
            if bad > 0:
                for lane in range(LANES):
                    paint_column(values, lines, wall, h, gap, begin + lane, start, window[4 + side], step, origin, ya,
                                 yb, count, buf, lane)  # fmt: skip
            else:
                scan_column(values, lines, begin, start, window[4 + side], step, origin, yb, count, buf)
            lowest, sign = np.float32(start if side == 0 else start - 1), np.float32(step)
            for y in range(ya, yb):
                place = np.float32(np.int32(y)) + origin
                for lane in range(LANES):
                    o = buf[y * LANES + lane]
                    k = np.uint32(lowest + sign * max(o, ZERO))
                    c = k * stride + np.uint32(begin + lane)
                    va, vb = flat[c], flat[c + stride]
                    qa, qb = lines[0, k] + lines[1, k] * va, lines[0, k + 1] + lines[1, k + 1] * vb
                    t = (place - qa) / (qb - qa)
                    ga, gb = (lines[2, k], lines[2, k + 1]) if wall else (va, vb)
                    value = ga + t * (gb - ga)
                    out[y, begin + lane] = value if o >= ZERO else HOLE
