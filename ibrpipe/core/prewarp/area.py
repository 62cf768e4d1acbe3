"""Pre-warp with area filtering: what is reduced is averaged. Source: oliveira2000, sec. 3.2.1, after fant1986.

A pixel is the interval (pipelined: the square) round its centre. Every segment of a line gives to each pixel that it
covers the mean of what it carries there, weighted by how much it covers: exactly the area under the linear pieces.
Colours are carried here, with the shift. A pixel holds two layers: the surface that is being painted and what was there
before; the nearer hides as much of the farther as it covers. Colours of the two are blended, shifts never: the layer
that covers more than half of the pixel gives the shift.

Symbols: a pixel's memory: R, G, B and carried number, weighted, of the front layer, its weight; the same, not weighted,
of the back layer, its weight; which surface the front is.
"""

from __future__ import annotations

import numpy as np
from numba import prange

from ibrpipe.core.jit import fused, kernel
from ibrpipe.core.prewarp.pipelined import meet_edge
from ibrpipe.core.prewarp.rows import HALF, HOLE, NONE, ONE, PAD, ZERO

#: numbers that a pixel holds, and where the weights and the surface stand
HELD, FRONT, BACK, SURFACE = 12, 4, 9, 10
#: columns of pixels that one thread owns
STRIPE = 32
TINY = np.float32(1e-6)


@fused
def settle(cell):
    # put the front layer over the back one; the front is empty then
    weight, under = min(cell[FRONT], ONE), cell[BACK] * (ONE - min(cell[FRONT], ONE))
    if weight > TINY:
        scale, total = weight / cell[FRONT], weight + under
        for c in range(3):
            cell[5 + c] = (cell[c] * scale + cell[5 + c] * under) / total
        if weight >= HALF or cell[BACK] <= TINY:
            cell[8] = cell[3] / cell[FRONT]
        cell[BACK] = total
    for c in range(5):
        cell[c] = ZERO


@fused
def deposit(cell, surface, weight, red, green, blue, carried):
    if cell[SURFACE] != surface:
        settle(cell)
        cell[SURFACE] = surface
    cell[0] += weight * red
    cell[1] += weight * green
    cell[2] += weight * blue
    cell[3] += weight * carried
    cell[FRONT] += weight


@fused
def empty(cells, count):
    for x in range(count):
        for c in range(HELD):
            cells[x, c] = ZERO
        cells[x, SURFACE] = NONE


@fused
def filter_line(positions, carried, joined, first, last, step, sign, low, high, cells, surface):
    # segments first .. last of a line in order, their positions rising (sign 1) or falling (-1) where they are seen;
    # low, high: positions, between which pixels are covered -> the number of the last surface
    stop = positions[last]
    for o in range((last - first) * step):
        i = first + o * step
        n = i + step
        a, b = positions[i], positions[n]
        if not (a == a and b == b) or joined[i if step > 0 else n] == 0:
            surface += ONE
            continue
        lower, upper = max(min(a, b), low), min(max(a, b), high)
        if (b - a) * sign <= ZERO:  # runs back: hidden, but beyond the last texel
            surface += ONE
            lower, upper = (max(lower, stop), upper) if sign > ZERO else (lower, min(upper, stop))
        if lower >= upper:
            continue
        x = int(np.floor(lower + HALF))
        while np.float32(x) - HALF < upper:
            left, right = max(lower, np.float32(x) - HALF), min(upper, np.float32(x) + HALF)
            if right > left and x >= 0 and x < cells.shape[0]:
                t = (HALF * (left + right) - a) / (b - a)
                deposit(
                    cells[x],
                    surface,
                    right - left,
                    carried[i, 0] + t * (carried[n, 0] - carried[i, 0]),
                    carried[i, 1] + t * (carried[n, 1] - carried[i, 1]),
                    carried[i, 2] + t * (carried[n, 2] - carried[i, 2]),
                    carried[i, 3] + t * (carried[n, 3] - carried[i, 3]),
                )
            x += 1
    return surface + ONE


@kernel
def area_rows(positions, color, breaks, sides, foot, window, out):
    # positions (2, H, W) f32: position of every texel, counted from the first pixel's centre, and what is carried; NaN
    # = hole; color (H, W, 3) f32; breaks as in core.prewarp; sides (2, 5) i64: first texel, last in order, step, sign,
    # 1 = used; foot f64: where the first side ends and the second begins; window i64: first row, last row + 1
    # out (H, count, 4) f32: colour and carried number, NaN = nothing
    count, broken = out.shape[1], breaks.shape[0] > 0
    edge = np.float32(foot)
    for job in prange(window[1] - window[0]):
        k = window[0] + np.int64(job)
        cells = np.empty((count, HELD), np.float32)
        carried = np.empty((positions.shape[2], 4), np.float32)
        joined = np.ones(positions.shape[2], np.uint8)
        for i in range(positions.shape[2]):
            carried[i, 3] = positions[1, k, i]
            for c in range(3):
                carried[i, c] = color[k, i, c]
            if broken and breaks[k, i] & 1:
                joined[i] = 0
        empty(cells, count)
        surface = ZERO
        for n in range(2):
            side = sides[n]
            if side[4] == 0:
                continue
            low, high = (-HALF, edge) if n == 0 else (edge, np.float32(count) - HALF)
            surface = filter_line(positions[0, k], carried, joined, side[0], side[1], side[2], np.float32(side[3]),
                                  low, high, cells, surface)  # fmt: skip
        finish(cells, count, out[k])


@fused
def finish(cells, count, out):
    # out (count, 4): what is seen; NaN where less than half of a pixel is covered
    for x in range(count):
        cell = cells[x]
        settle(cell)
        for c in range(4):
            out[x, c] = cell[5 + c] if cell[BACK] >= HALF else HOLE


@kernel
def area_columns(values, lines, wall, eye, gap, sides, foot, out):
    # values (H, count, 4) f32 from area_rows; lines (3, H) f32 as in prewarp_columns; sides, foot as area_rows, of rows
    # out (PAD + rows + PAD, stride, 4) f32: colour and shift at pixels, NaN = nothing
    h, edge, rows = np.float32(eye), np.float32(foot), out.shape[0] - 2 * PAD
    first = min(min(sides[0, 0], sides[0, 1]), min(sides[1, 0], sides[1, 1]))
    last = max(max(sides[0, 0], sides[0, 1]), max(sides[1, 0], sides[1, 1]))
    for job in prange(values.shape[1]):
        x = np.int64(job)
        cells = np.empty((rows, HELD), np.float32)
        carried = np.empty((values.shape[0], 4), np.float32)
        positions = np.empty(values.shape[0], np.float32)
        joined = np.ones(values.shape[0], np.uint8)
        before = HOLE
        for k in range(first, last + 1):
            value = values[k, x, 3]
            for c in range(3):
                carried[k, c] = values[k, x, c]
            carried[k, 3] = lines[2, k] if wall else value
            positions[k] = lines[0, k] + lines[1, k] * value
            deep = value if wall else h * value / (ONE + value)
            if k > first and abs(deep - before) > gap:
                joined[k - 1] = 0
            before = deep
        empty(cells, rows)
        surface = ZERO
        for n in range(2):
            side = sides[n]
            if side[4] == 0:
                continue
            low, high = (-HALF, edge) if n == 0 else (edge, np.float32(rows) - HALF)
            surface = filter_line(positions, carried, joined, side[0], side[1], side[2], np.float32(side[3]), low, high,
                                  cells, surface)  # fmt: skip
        finish(cells, rows, out[PAD : PAD + rows, x])


@fused
def blend(color, k, i, channel, wa, wb, wc, wd):
    above = wa * color[k, i, channel] + wb * color[k, i + 1, channel]
    return above + wc * color[k + 1, i, channel] + wd * color[k + 1, i + 1, channel]


@fused
def cover_cell(positions, color, k, i, left, top, begin, same, cells):
    # one cell of the pipelined method: what it covers of the columns that `cells` holds from `begin` on
    a, b, c, d = positions[0, k, i], positions[0, k, i + 1], positions[0, k + 1, i], positions[0, k + 1, i + 1]
    if not (a == a and b == b and c == c and d == d):
        return
    low = max(min(min(a, b), min(c, d)) - np.float32(left), np.float32(begin))
    high = min(max(max(a, b), max(c, d)) - np.float32(left), np.float32(begin + cells.shape[0]))
    if low >= high:
        return
    right, below = positions[1, k, i + 1] - positions[1, k, i], positions[1, k + 1, i] - positions[1, k, i]
    orientation = (b - a) * below - (c - a) * right
    x0, y0 = HALF * (a + c), HALF * (positions[1, k, i] + positions[1, k, i + 1])
    across, down = HALF * (b + d) - x0, HALF * (positions[1, k + 1, i] + positions[1, k + 1, i + 1]) - y0
    column = int(np.floor(low))
    while np.float32(column) < high:
        first, end = max(low, np.float32(column)), min(high, np.float32(column + 1))
        x = HALF * (first + end) + np.float32(left)
        span = (np.float32(np.inf), ONE, np.float32(-np.inf), ONE)
        span = meet_edge(positions, k, i, k, i + 1, x, span)
        span = meet_edge(positions, k + 1, i, k + 1, i + 1, x, span)
        span = meet_edge(positions, k, i, k + 1, i, x, span)
        span = meet_edge(positions, k, i + 1, k + 1, i + 1, x, span)
        lower, g, upper, g_upper = span
        bottom, ceiling = max(lower - np.float32(top), ZERO), min(upper - np.float32(top), np.float32(cells.shape[1]))
        if lower < upper and bottom < ceiling and end > first:
            slope, row = (g_upper - g) / (upper - lower), int(np.floor(bottom))
            while np.float32(row) < ceiling:
                start, stop = max(bottom, np.float32(row)), min(ceiling, np.float32(row + 1))
                if stop > start:
                    cell = cells[column - begin, row]
                    here = g + (HALF * (start + stop) + np.float32(top) - lower) * slope
                    sign = ONE if orientation >= ZERO else NONE
                    mean = cell[3] / max(cell[FRONT], TINY)
                    near = abs(here - mean) <= same * (ONE + here) * (ONE + here)
                    surface = cell[SURFACE]
                    if cell[FRONT] > TINY and not (near and cell[11] == sign):
                        surface += ONE
                    cell[11] = sign
                    s = (x - x0) / across if abs(across) > TINY else HALF
                    t = (HALF * (start + stop) + np.float32(top) - y0) / down if abs(down) > TINY else HALF
                    s, t = min(max(s, ZERO), ONE), min(max(t, ZERO), ONE)
                    wa, wb, wc, wd = (ONE - s) * (ONE - t), s * (ONE - t), (ONE - s) * t, s * t
                    deposit(
                        cell,
                        surface,
                        (end - first) * (stop - start),
                        blend(color, k, i, 0, wa, wb, wc, wd),
                        blend(color, k, i, 1, wa, wb, wc, wd),
                        blend(color, k, i, 2, wa, wb, wc, wd),
                        here,
                    )
                row += 1
        column += 1


@kernel
def area_cells(positions, color, breaks, ranges, feet, window, same, out):
    # as prewarp_pipelined.pipeline, ranges for stripes of STRIPE here; color (H, W, 3) f32; same: greatest difference
    # of shifts over (1 + g)^2 on one surface; out (PAD + rows + PAD, stride, 4) f32: colour and shift
    first, last, count, left, top, order = window[0], window[1], window[2], window[3], window[4], window[5]
    middle = last if order > 0 else first if order < 0 else min(max(feet[1], first), last)
    rows, broken, limit = out.shape[0] - 2 * PAD, breaks.shape[0] > 0, np.float32(same)
    for stripe in prange(ranges.shape[0]):
        begin = np.int64(stripe) * STRIPE
        width = min(begin + STRIPE, count) - begin
        cells = np.empty((width, rows, HELD), np.float32)
        for x in range(width):
            empty(cells[x], rows)
        low, high = ranges[stripe, 0], ranges[stripe, 1]
        centre = min(max(feet[0], low), high)
        for o in range(last - first):
            k = first + o if o < middle - first else last - 1 - (o - (middle - first))
            for n in range(high - low):
                i = low + n if n < centre - low else high - 1 - (n - (centre - low))
                if broken and (breaks[k, i] | (breaks[k + 1, i] & 1) | (breaks[k, i + 1] & 2)) > 0:
                    continue
                cover_cell(positions, color, k, i, left, top, begin, limit, cells)
        for x in range(width):
            finish(cells[x], rows, out[PAD : PAD + rows, begin + x])


@kernel
def view_area(picture, homography, bounds, jump, depth, color, alpha):
    # picture (rows, stride, 4) f32: colour and shift; homography, bounds, jump as view_depth; depth (h, w) f32 is
    # lowered, color (h, w, 3) and alpha (h, w) f32 written where it is
    right, bottom = np.float32(int(bounds[4]) - 2), np.float32(int(bounds[5]) - 2)
    for y in prange(depth.shape[0]):
        for x in range(depth.shape[1]):
            px, py = x + 0.5, y + 0.5
            w = homography[2, 0] * px + homography[2, 1] * py + homography[2, 2]
            if not w > 0.0:
                continue
            u = (homography[0, 0] * px + homography[0, 1] * py + homography[0, 2]) / w
            v = (homography[1, 0] * px + homography[1, 1] * py + homography[1, 2]) / w
            if u < bounds[0] or u > bounds[1] or v < bounds[2] or v > bounds[3]:
                continue
            s, t = min(max(np.float32(u) - HALF, ZERO), right + ONE), min(max(np.float32(v) - HALF, ZERO), bottom + ONE)
            i, j = min(np.floor(s), right), min(np.floor(t), bottom)
            p, q = s - i, t - j
            m, n = int(i), int(j)
            a, b, c, d = picture[n, m], picture[n, m + 1], picture[n + 1, m], picture[n + 1, m + 1]
            low, high = min(min(a[3], b[3]), min(c[3], d[3])), max(max(a[3], b[3]), max(c[3], d[3]))
            near = (a if p < HALF else b) if q < HALF else (c if p < HALF else d)
            wa, wb, wc, wd = (ONE - p) * (ONE - q), p * (ONE - q), (ONE - p) * q, p * q
            smooth = wa * a[3] + wb * b[3] + wc * c[3] + wd * d[3]
            whole = smooth == smooth and high - low <= np.float32(jump) * (ONE + near[3]) * (ONE + near[3])
            more = ONE + (smooth if whole else near[3])
            if not more > ZERO:
                continue
            z = np.float32(homography[3, 2] / w) / more
            if z < depth[y, x]:
                depth[y, x] = z
                if alpha.shape[0] > 0:
                    alpha[y, x] = ONE
                    for k in range(3):
                        mixed = wa * a[k] + wb * b[k] + wc * c[k] + wd * d[k]
                        color[y, x, k] = mixed if smooth == smooth else near[k]
