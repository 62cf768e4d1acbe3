"""Loops of the float64 oracle: rays against patches one by one, without any bound that could be wrong.

Nothing of the renderers' kernels is used. Symbols: ray (x, y, n, q)(t) in homogeneous cell coordinates (u = x/q,
v = y/q, d = n/q), t the depth along camera z; a hit is a root of ``d - bilinear(u, v)``, multiplied out by q twice; the
quadratic is written around the ray's point nearest to the cell, so that far eyes cost no digits.

Packed arguments: ``position`` and ``direction`` (x, y, n, q) of a ray at t = 0 and per t, in one cell's coordinates;
``corners`` (a, b, c, e) depths at (0, 0), (1, 0), (0, 1), (1, 1); ``rule`` (front, split, near, grain, perspective,
slack): from which side hits count (0 = both), are cells two triangles, least t, depth of one texel (a share of the
depth in perspective frames), is the frame perspective, by how much borders are moved outward; ``surface`` (starts,
ranges, corners, masks): first patch of every cell, least and greatest depth, corners (P, 4) and masks of every patch.
"""

from __future__ import annotations

import math

import numpy as np
from numba import prange

from ibrpipe.core.jit import kernel, ordered


@ordered
def counts_at(p, q, mask, slack):
    # does position (p, q) of a cell lie in a quadrant that counts, borders moved outward by `slack`
    for corner in range(4):
        if mask & (1 << corner):
            left, top = 0.5 * (corner & 1), 0.5 * (corner >> 1)
            if abs(p - left - 0.25) <= 0.25 + slack and abs(q - top - 0.25) <= 0.25 + slack:
                return True
    return False


@ordered
def nearest_point(position, direction, d, grain):
    # parameter of the ray's point nearest to the cell's middle (0.5, 0.5, d); grain: depth of one texel
    x, y, n, w = position
    dx, dy, dn, dw = direction
    bx, by, bn = x - 0.5 * w, y - 0.5 * w, (n - d * w) / grain
    ax, ay, an = dx - 0.5 * dw, dy - 0.5 * dw, (dn - d * dw) / grain
    square = ax * ax + ay * ay + an * an
    return -(bx * ax + by * ay + bn * an) / square if square > 0.0 else 0.0


@ordered
def triangle_root(position, direction, corners, lower, near, slack):
    # root over one half of a cell split along the diagonal (0, 0)-(1, 1): upper p >= q, lower p <= q
    x, y, n, w = position
    dx, dy, dn, dw = direction
    a, b, c, e = corners
    gu, gv = (e - c, c - a) if lower else (b - a, e - b)
    slope = dn - a * dw - gu * dx - gv * dy
    if slope == 0.0:
        return np.inf
    s = -(n - a * w - gu * x - gv * y) / slope
    weight = w + s * dw
    p, q = (x + s * dx) / weight, (y + s * dy) / weight
    inside = min(p, q) >= -slack and max(p, q) <= 1.0 + slack and (q - p if lower else p - q) >= -slack
    return s if s > near and weight > 0.0 and inside else np.inf


@ordered
def patch_root(position, direction, corners, mask, front, near, slack):
    # nearest root over a bilinear patch, or inf
    x, y, n, w = position
    dx, dy, dn, dw = direction
    a, b, c, e = corners
    k = a - b - c + e
    A = dn * dw - a * dw * dw + (a - b) * dx * dw + (a - c) * dy * dw - k * dx * dy
    B = (
        n * dw + dn * w - 2.0 * a * w * dw + (a - b) * (x * dw + dx * w) + (a - c) * (y * dw + dy * w)
        - k * (x * dy + dx * y)
    )  # fmt: skip
    C = n * w - a * w * w + (a - b) * x * w + (a - c) * y * w - k * x * y
    square = B * B - 4.0 * A * C
    if square < 0.0:
        return np.inf
    root = -0.5 * (B + math.copysign(math.sqrt(square), B))
    best = np.inf
    for which in range(2):
        below = root if which == 0 else A
        if below == 0.0:
            continue
        s = C / below if which == 0 else root / below
        weight = w + s * dw
        beyond = s > near and weight > 0.0 and s < best and (front == 0 or front * (2.0 * A * s + B) > 0.0)
        if beyond and counts_at((x + s * dx) / weight, (y + s * dy) / weight, mask, slack):
            best = s
    return best


@ordered
def meet(start, ray, column, row, depths, mask, rule):
    # start (4,), ray (4,) in cell coordinates; depths (4,) of the corners -> t of the nearest hit of one patch, or inf
    front, split, near, grain, perspective, slack = rule
    a, b, c, e = depths[0], depths[1], depths[2], depths[3]
    d, corners = 0.25 * (a + b + c + e), (a, b, c, e)
    x, y = start[0] - column * start[3], start[1] - row * start[3]
    dx, dy = ray[0] - column * ray[3], ray[1] - row * ray[3]
    scale = grain * abs(d) if perspective else grain
    direction = (dx, dy, ray[2], ray[3])
    t = nearest_point((x, y, start[2], start[3]), direction, d, scale)
    position = (x + t * dx, y + t * dy, start[2] + t * ray[2], start[3] + t * ray[3])
    if split:
        upper = triangle_root(position, direction, corners, False, near - t, slack)
        lower = triangle_root(position, direction, corners, True, near - t, slack)
        return t + min(upper, lower)
    return t + patch_root(position, direction, corners, mask, front, near - t, slack)


@kernel
def cast_all(start, Q_of, pixels, cells, corners, masks, rule, out_t, out_patch):
    # brute force: every patch for every ray; pixels (N, 2) f64 -> out_t (N,) f64, inf = none; out_patch (N,) i64
    for i in prange(len(pixels)):
        ray = np.empty(4)
        for k in range(4):
            ray[k] = Q_of[k, 0] * pixels[i, 0] + Q_of[k, 1] * pixels[i, 1] + Q_of[k, 2]
        best, which = np.inf, -1
        for patch in range(len(corners)):
            t = meet(start, ray, cells[patch, 0], cells[patch, 1], corners[patch], masks[patch], rule)
            if t < best:
                best, which = t, patch
        out_t[i], out_patch[i] = best, which


@ordered
def clip(alpha, beta, near, far):
    # keep the part of [near, far] where alpha + t * beta >= 0
    if beta > 0.0:
        return max(near, -alpha / beta), far
    if beta < 0.0:
        return near, min(far, -alpha / beta)
    return near, far if alpha >= 0.0 else -np.inf


@ordered
def clip_ray(start, ray, box, near):
    # box (columns, rows, least d, greatest d), one thousandth of a cell wider -> t where the ray enters and leaves
    far = np.inf
    for k in range(2):
        near, far = clip(start[k] + 1e-3 * start[3], ray[k] + 1e-3 * ray[3], near, far)
        near, far = clip((box[k] + 1e-3) * start[3] - start[k], (box[k] + 1e-3) * ray[3] - ray[k], near, far)
    near, far = clip(start[2] - box[2] * start[3], ray[2] - box[2] * ray[3], near, far)
    return clip(box[3] * start[3] - start[2], box[3] * ray[3] - ray[2], near, far)


@ordered
def walk(start, ray, box, surface, rule):
    # as cast_all for one ray, visiting only patches of the cells that the ray's line crosses, a little wider
    starts, ranges, corners, masks = surface
    _, _, near, grain, perspective, _ = rule
    ta, tb = clip_ray(start, ray, box, near)
    if not ta <= tb:
        return np.inf, -1
    qa, qb = start[3] + ta * ray[3], start[3] + tb * ray[3]
    ends = np.empty((2, 3))
    for k in range(3):
        ends[0, k], ends[1, k] = (start[k] + ta * ray[k]) / qa, (start[k] + tb * ray[k]) / qb
    main = 0 if abs(ends[1, 0] - ends[0, 0]) >= abs(ends[1, 1] - ends[0, 1]) else 1
    span = ends[1, main] - ends[0, main]
    sign = 1 if span >= 0.0 else -1
    last = int(box[main]) - 1
    i = min(max(int(math.floor(ends[0, main])), 0), last)
    stop = min(max(int(math.floor(ends[1, main])), 0), last)
    best, which, spare = np.inf, -1, 1
    while True:
        lo, hi = 0.0, 1.0
        if abs(span) > 1e-9:
            one, two = (i - 1e-3 - ends[0, main]) / span, (i + 1.0 + 1e-3 - ends[0, main]) / span
            lo, hi = max(min(one, two), 0.0), min(max(one, two), 1.0)
        side0 = ends[0, 1 - main] + lo * (ends[1, 1 - main] - ends[0, 1 - main])
        side1 = ends[0, 1 - main] + hi * (ends[1, 1 - main] - ends[0, 1 - main])
        d0 = ends[0, 2] + lo * (ends[1, 2] - ends[0, 2])
        d1 = ends[0, 2] + hi * (ends[1, 2] - ends[0, 2])
        pad = 1e-3 * (abs(d1 - d0) + (grain * abs(d0) if perspective else grain))
        first = max(int(math.floor(min(side0, side1) - 1e-3)), 0)
        for j in range(first, min(int(math.floor(max(side0, side1) + 1e-3)), int(box[1 - main]) - 1) + 1):
            column, row = (i, j) if main == 0 else (j, i)
            cell = row * int(box[0]) + column
            for patch in range(starts[cell], starts[cell + 1]):
                if ranges[patch, 0] > max(d0, d1) + pad or ranges[patch, 1] < min(d0, d1) - pad:
                    continue
                t = meet(start, ray, column, row, corners[patch], masks[patch], rule)
                if t < best:
                    best, which = t, patch
        spare -= 1 if best < np.inf else 0
        if i == stop or spare < 0:
            return best, which
        i += sign


@kernel
def cast_walks(start, Q_of, pixels, box, surface, rule, out_t, out_patch):
    # as cast_all, for surfaces that are too large to try every patch for every ray
    for i in prange(len(pixels)):
        ray = np.empty(4)
        for k in range(4):
            ray[k] = Q_of[k, 0] * pixels[i, 0] + Q_of[k, 1] * pixels[i, 1] + Q_of[k, 2]
        out_t[i], out_patch[i] = walk(start, ray, box, surface, rule)


@kernel
def values_at(u, v, d, starts, columns, rows, corners, masks, out):
    # field depth (N,) of the patch nearest in depth to d at cell coordinates u, v (N,); NaN where there is none
    for i in prange(len(u)):
        out[i] = np.nan
        if not (-1e-3 <= u[i] <= columns + 1e-3 and -1e-3 <= v[i] <= rows + 1e-3):
            continue
        column, row = min(max(int(u[i]), 0), columns - 1), min(max(int(v[i]), 0), rows - 1)
        p, q = u[i] - column, v[i] - row
        for patch in range(starts[row * columns + column], starts[row * columns + column + 1]):
            if counts_at(p, q, masks[patch], 1e-3):
                upper = corners[patch, 0] * (1.0 - p) + corners[patch, 1] * p
                value = upper * (1.0 - q) + (corners[patch, 2] * (1.0 - p) + corners[patch, 3] * p) * q
                if not abs(out[i] - d[i]) <= abs(value - d[i]):
                    out[i] = value
