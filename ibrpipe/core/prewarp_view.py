"""The second step of relief texture mapping: a pre-warped plane as the camera sees it. Source: oliveira2000, 3, 4.2.

A pixel's ray meets the plane where a homography says; the shift g, read there bilinearly, places the surface on that
very ray: camera depth is the plane's over ``1 + g``, and the texture's own coordinates follow, where the colour is read
bilinearly, once. Near a jump of depth or a hole the nearest g is taken, so that nothing lies between two surfaces.

Symbols: numbers (3, 3) f64: rows give x, y and the weight, linear in (pixel x, pixel y, 1); X = P . pixel.
"""

from __future__ import annotations

import numpy as np
from numba import prange

from ibrpipe.core.jit import helper, kernel

#: pixels that are worked on together; constant places in the working memory
CHUNK = 256
ONE, ZERO, HALF, HOLE = (np.float32(x) for x in (1.0, 0.0, 0.5, np.nan))


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
def view_depth(shifts, stride, homography, bounds, jump, out):
    # shifts flat f32, rows of `stride`; homography (4, 3) f64: x, y, weight of plane pixels, weight of depth: a pixel's
    # plane depth is homography[3, 2] / weight; bounds f64: x0, x1, y0, y1 of the rectangle in plane pixels, columns,
    # rows jump: greatest difference of neighbouring shifts over (1 + g)^2 on one surface; out (h, w) f32 is lowered
    columns, rows = int(bounds[4]), int(bounds[5])
    line = np.uint32(stride)
    right, bottom = np.float32(columns - 1), np.float32(rows - 1)
    limit = np.float32(jump)
    for y in prange(out.shape[0]):
        first, end = row_span(homography, bounds, y, out.shape[1])
        py = y + 0.5
        begin = (homography[0, 1] * py + homography[0, 2], homography[1, 1] * py + homography[1, 2],
                 homography[2, 1] * py + homography[2, 2])  # fmt: skip
        xa, ya, wa = np.float32(begin[0]), np.float32(begin[1]), np.float32(begin[2])
        xb, yb, wb = np.float32(homography[0, 0]), np.float32(homography[1, 0]), np.float32(homography[2, 0])
        far = np.float32(homography[3, 2])
        buf = np.empty(4 * CHUNK, np.float32)
        for start in range(first, end, CHUNK):
            count = min(CHUNK, end - start)
            for n in range(count):
                px = np.float32(start + n) + HALF
                w = ONE / (wa + wb * px)
                buf[n] = min(max((xa + xb * px) * w - HALF, ZERO), right)
                buf[CHUNK + n] = min(max((ya + yb * px) * w - HALF, ZERO), bottom)
                buf[2 * CHUNK + n] = far * w
            for n in range(count):
                x, v = buf[n], buf[CHUNK + n]
                i, j = np.float32(np.uint32(x)), np.float32(np.uint32(v))
                p, q = x - i, v - j
                c = np.uint32(j) * line + np.uint32(i)
                c10, c01 = c + np.uint32(ONE if i < right else ZERO), c + (line if j < bottom else np.uint32(0))
                a, b, d = shifts[c], shifts[c10], shifts[c01]
                e = shifts[c01 + (c10 - c)]
                low, high = min(min(a, b), min(d, e)), max(max(a, b), max(d, e))
                upper, lower = a + p * (b - a), d + p * (e - d)
                smooth = upper + q * (lower - upper)
                near = (a if p < HALF else b) if q < HALF else (d if p < HALF else e)
                whole = high - low <= limit * (ONE + near) * (ONE + near) and smooth == smooth
                buf[3 * CHUNK + n] = ONE + (smooth if whole else near)
            for n in range(count):
                more, before = buf[3 * CHUNK + n], out[y, start + n]
                z = buf[2 * CHUNK + n] / more if more > ZERO else np.float32(np.inf)
                out[y, start + n] = z if z < before else before


@kernel
def view_color(depth, before, homography, places, color, size, out, alpha):
    # depth, before (h, w) f32: where depth < before, this texture is seen; places (2, 3) f64: u, v of a ray at camera
    # depth t are e + t * (pixel's way): `homography` (2, 3) f64 gives the ways, places (2,) the eye's u, v
    # color flat f32 (H, W, 3), size (H, W); out (h, w, 3), alpha (h, w) f32
    rows, columns = np.float32(size[0] - 1), np.float32(size[1] - 1)
    line, step = np.uint32(3 * size[1]), np.uint32(3)
    e_u, e_v = places[0], places[1]
    for y in prange(depth.shape[0]):
        buf = np.empty(2 * CHUNK, np.float32)
        py = y + 0.5
        ua, va = homography[0, 1] * py + homography[0, 2], homography[1, 1] * py + homography[1, 2]
        for start in range(0, depth.shape[1], CHUNK):
            count = min(CHUNK, depth.shape[1] - start)
            seen = np.int32(0)
            for n in range(count):
                seen += np.int32(1) if depth[y, start + n] < before[y, start + n] else np.int32(0)
            if seen == 0:
                continue
            for n in range(count):
                t = float(depth[y, start + n])
                px = start + n + 0.5
                u = e_u + t * (ua + homography[0, 0] * px) - 0.5
                v = e_v + t * (va + homography[1, 0] * px) - 0.5
                buf[n] = min(max(np.float32(u), ZERO), columns) if t < np.inf else ZERO
                buf[CHUNK + n] = min(max(np.float32(v), ZERO), rows) if t < np.inf else ZERO
            for n in range(count):
                u, v = buf[n], buf[CHUNK + n]
                i, j = np.float32(np.uint32(u)), np.float32(np.uint32(v))
                p, q = u - i, v - j
                a = np.uint32(j) * line + np.uint32(i) * step
                b = a + (step if i < columns else np.uint32(0))
                c = a + (line if j < rows else np.uint32(0))
                d = c + (b - a)
                mine = depth[y, start + n] < before[y, start + n]
                for k in range(3):
                    m = np.uint32(k)
                    upper = color[a + m] + p * (color[b + m] - color[a + m])
                    lower = color[c + m] + p * (color[d + m] - color[c + m])
                    value = upper + q * (lower - upper)
                    out[y, start + n, k] = value if mine else out[y, start + n, k]
                alpha[y, start + n] = ONE if mine else alpha[y, start + n]
