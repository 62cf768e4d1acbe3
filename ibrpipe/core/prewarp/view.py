"""The second step of relief texture mapping: a pre-warped plane as the camera sees it. Source: oliveira2000, 3, 4.2.

A pixel's ray meets the plane where a homography says; the shift g, read there bilinearly, eye the surface on that
very ray: camera depth is the plane's over ``1 + g``, and the texture's own coordinates follow, where the colour is read
bilinearly, once. Near a jump of depth or a hole the nearest g is taken, so that nothing lies between two surfaces.

Symbols: numbers (3, 3) f64: rows give x, y and the weight, linear in (pixel x, pixel y, 1); X = P . pixel.
"""

from __future__ import annotations

import numpy as np
from numba import prange

from ibrpipe.core.jit import helper, kernel

#: owner of what is no surface
NOBODY = 255
#: pixels that are worked on together; constant eye in the working memory
CHUNK = 256
ONE, ZERO, HALF, MISS = (np.float32(x) for x in (1.0, 0.0, 0.5, np.inf))


@helper
def keep_side(a, b, low, high):
    # part of [low, high] where a + b * x >= 0
    if b > 0.0:
        return max(low, -a / b), high
    if b < 0.0:
        return low, min(high, -a / b)
    return (low, high) if a >= 0.0 else (low, low - 1.0)


@helper
def row_span(homography, bounds, y, width):
    # pixels first, end of row y whose rays meet the rectangle (x0, x1, y0, y1)
    py, low, high = y + 0.5, 0.5 - 1e-6, width - 0.5 + 1e-6
    base, slope = homography[2, 1] * py + homography[2, 2], homography[2, 0]
    low, high = keep_side(base, slope, low, high)
    for axis in range(2):
        a, b = homography[axis, 1] * py + homography[axis, 2], homography[axis, 0]
        low, high = keep_side(a - bounds[2 * axis] * base, b - bounds[2 * axis] * slope, low, high)
        low, high = keep_side(bounds[2 * axis + 1] * base - a, bounds[2 * axis + 1] * slope - b, low, high)
    if not low <= high:
        return 0, 0
    return int(np.ceil(low - 0.5 - 1e-6)), int(np.floor(high - 0.5 + 1e-6)) + 1


@kernel
def view_depth(shifts, stride, homography, bounds, jump, fresh, out):
    # shifts flat f32, rows of `stride`; homography (4, 3) f64: x, y, weight of plane pixels, weight of depth: a pixel's
    # plane depth is homography[3, 2] / weight; bounds f64: x0, x1, y0, y1 of the rectangle in plane pixels, columns,
    # rows (two at least); jump: greatest difference of neighbouring shifts over (1 + g)^2 on one surface
    # out (h, w) f32 is lowered, or where `fresh` written
    right, bottom = np.float32(int(bounds[4]) - 2), np.float32(int(bounds[5]) - 2)
    line, below, limit = np.uint32(stride), np.uint64(stride), np.float32(jump)
    xb, yb, wb = np.float32(homography[0, 0]), np.float32(homography[1, 0]), np.float32(homography[2, 0])
    far = np.float32(homography[3, 2])
    for y in prange(out.shape[0]):
        first, end = row_span(homography, bounds, y, out.shape[1])
        py, row = y + 0.5, out[y]
        xa = np.float32(homography[0, 1] * py + homography[0, 2])
        ya = np.float32(homography[1, 1] * py + homography[1, 2])
        wa = np.float32(homography[2, 1] * py + homography[2, 2])
        buf = np.empty(7 * CHUNK, np.float32)
        corner = np.empty(CHUNK, np.uint32)
        if fresh:
            for x in range(first):
                row[x] = MISS
            for x in range(row.shape[0] - end):
                row[np.uint64(end) + np.uint64(x)] = MISS
        for start in range(first, end, CHUNK):
            count, here = min(CHUNK, end - start), np.float32(start) + HALF
            for n in range(count):
                px = np.float32(np.int32(n)) + here
                w = ONE / (wa + wb * px)
                x = min(max((xa + xb * px) * w - HALF, ZERO), right + ONE)
                v = min(max((ya + yb * px) * w - HALF, ZERO), bottom + ONE)
                i, j = min(np.floor(x), right), min(np.floor(v), bottom)
                buf[n] = x - i
                buf[CHUNK + n] = v - j
                buf[2 * CHUNK + n] = far * w
                corner[n] = np.uint32(np.int32(j)) * line + np.uint32(np.int32(i))
            for n in range(count):
                c = np.uint64(corner[n])
                buf[3 * CHUNK + n] = shifts[c]
                buf[4 * CHUNK + n] = shifts[c + np.uint64(1)]
                buf[5 * CHUNK + n] = shifts[c + below]
                buf[6 * CHUNK + n] = shifts[c + below + np.uint64(1)]
            for n in range(count):
                p, q = buf[n], buf[CHUNK + n]
                a, b, d, e = buf[3 * CHUNK + n], buf[4 * CHUNK + n], buf[5 * CHUNK + n], buf[6 * CHUNK + n]
                low, high = min(min(a, b), min(d, e)), max(max(a, b), max(d, e))
                upper, lower = a + p * (b - a), d + p * (e - d)
                smooth = upper + q * (lower - upper)
                near = (a if p < HALF else b) if q < HALF else (d if p < HALF else e)
                whole = high - low <= limit * (ONE + near) * (ONE + near) and smooth == smooth
                more = ONE + (smooth if whole else near)
                z = buf[2 * CHUNK + n] / (more if more > ZERO else ONE)
                buf[n] = z if more > ZERO else MISS
            to = np.uint64(start)
            if fresh:
                for n in range(count):
                    row[to + np.uint64(n)] = buf[n]
            else:
                for n in range(count):
                    before = row[to + np.uint64(n)]
                    row[to + np.uint64(n)] = buf[n] if buf[n] < before else before


@kernel
def view_owner(owners, homography, bounds, out):
    # owners (rows, columns) u8 of plane pixels, 255 = none; homography, bounds as view_depth -> out (h, w) u8, written
    # where the plane's pixel nearest to a ray has an owner
    right, bottom = bounds[4] - 1.0, bounds[5] - 1.0
    for y in prange(out.shape[0]):
        first, end = row_span(homography, bounds, y, out.shape[1])
        py = y + 0.5
        for px in range(first, end):
            x = px + 0.5
            w = 1.0 / (homography[2, 0] * x + homography[2, 1] * py + homography[2, 2])
            i = min(max((homography[0, 0] * x + homography[0, 1] * py + homography[0, 2]) * w, 0.0), right)
            j = min(max((homography[1, 0] * x + homography[1, 1] * py + homography[1, 2]) * w, 0.0), bottom)
            owner = owners[int(j), int(i)]
            out[y, px] = owner if owner != NOBODY else out[y, px]


@kernel
def view_color(depth, before, owner, number, homography, eye, color, size, out, alpha):
    # depth (h, w) f32, before the same or empty = inf: where depth < before, this texture is seen; owner (h, w) u8,
    # empty, or it is seen where it says `number`; homography (2, 3)
    # f64 gives the directions, eye (2,) f64 the eye's u, v: a ray's u, v at camera depth t are eye + t * direction
    # color (H W, 4) f32, size (H, W); out (h, w, 3), alpha (h, w) f32; all pixels are written where `before` is empty
    rows, columns = float(size[0] - 1), float(size[1] - 1)
    line, fresh = np.uint32(size[1]), before.shape[0] == 0 and owner.shape[0] == 0
    owned = owner.shape[0] > 0
    right, bottom = max(columns - 1.0, 0.0), max(rows - 1.0, 0.0)
    beside, below = np.uint64(1 if columns > 0 else 0), np.uint64(size[1] if rows > 0 else 0)
    e_u, e_v = eye[0] - 0.5, eye[1] - 0.5
    for y in prange(depth.shape[0]):
        buf = np.empty(2 * CHUNK, np.float32)
        corner = np.empty(CHUNK, np.uint32)
        mine = np.empty(CHUNK, np.uint8)
        py = y + 0.5
        ua, va = homography[0, 1] * py + homography[0, 2], homography[1, 1] * py + homography[1, 2]
        for start in range(0, depth.shape[1], CHUNK):
            count, to = min(CHUNK, depth.shape[1] - start), np.uint64(start)
            seen = np.int32(0)
            for n in range(count):
                x = to + np.uint64(n)
                here = owner[y, x] == number if owned else depth[y, x] < (MISS if fresh else before[y, x])
                here = here and depth[y, x] < MISS
                mine[n] = np.uint8(1) if here else np.uint8(0)
                seen += np.int32(1) if here else np.int32(0)
            if seen == 0 and not fresh:
                continue
            for n in range(count):
                t = float(depth[y, to + np.uint64(n)])
                t = t if t < np.inf else 0.0
                px = float(np.int32(start) + np.int32(n)) + 0.5
                u = min(max(e_u + t * (ua + homography[0, 0] * px), 0.0), columns)
                v = min(max(e_v + t * (va + homography[1, 0] * px), 0.0), rows)
                i, j = min(np.floor(u), right), min(np.floor(v), bottom)
                buf[n] = np.float32(u - i)
                buf[CHUNK + n] = np.float32(v - j)
                corner[n] = np.uint32(np.int32(j)) * line + np.uint32(np.int32(i))
            for n in range(count):
                x = to + np.uint64(n)
                if mine[n] == 0:
                    if fresh:
                        out[y, x, 0], out[y, x, 1], out[y, x, 2], alpha[y, x] = ZERO, ZERO, ZERO, ZERO
                    continue
                p, q = buf[n], buf[CHUNK + n]
                c = np.uint64(corner[n])
                d = c + below
                wb, wc, wd = p * (ONE - q), (ONE - p) * q, p * q
                wa = ONE - wb - wc - wd
                for k in range(3):
                    value = wa * color[c, k] + wb * color[c + beside, k]
                    out[y, x, k] = value + wc * color[d, k] + wd * color[d + beside, k]
                alpha[y, x] = ONE
