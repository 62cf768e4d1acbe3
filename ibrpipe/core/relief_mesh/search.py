"""A ray in texture space against the depth layers of a relief map: exactly, or by the published steps.

Source: policarpo2005, sec. 3 and 4. A ray is ``(x, y, z) + s * (dx, dy, dz)``: x, y in cells (unbounded where the map
wraps), z depth in [0, 1]. A point is inside when ``front <= z``, with two layers when ``front <= z <= back``; both are
bilinear between texel centres. `plan`, `lows`, `highs`: see :mod:`ibrpipe.core.relief_mesh.map`; a map of one layer has
empty `back` and `highs`.
"""

from __future__ import annotations

import math

import numpy as np

from ibrpipe.core.jit import helper, ordered
from ibrpipe.core.relief_mesh.map import HEAD

#: level of the pyramid on which a ray sets out
START = 3
#: depth by which a ray that enters from within may already be inside, and still counts as just arriving
ARRIVING = 1e-7


@helper
def layer_at(grid, plan, x, y):
    # bilinear depth at cell coordinates
    rows, columns = plan[0], plan[1]
    i, j = np.int64(math.floor(x)), np.int64(math.floor(y))
    if plan[3] == 0:
        i, j = min(max(i, 0), columns - 1), min(max(j, 0), rows - 1)
    p, q = x - i, y - j
    if plan[3] != 0 and (i < 0 or i >= columns):
        i %= columns
    if plan[3] != 0 and (j < 0 or j >= rows):
        j %= rows
    a, b, c, e = grid[j, i], grid[j, i + 1], grid[j + 1, i], grid[j + 1, i + 1]
    return (a * (1.0 - p) + b * p) * (1.0 - q) + (c * (1.0 - p) + e * p) * q


@helper
def is_inside(front, back, plan, x, y, z):
    if not z >= layer_at(front, plan, x, y):
        return False
    return back.shape[0] == 0 or z <= layer_at(back, plan, x, y)


@helper
def step_along(front, back, plan, ray, begin, end, steps, bisection_steps):
    # first of `steps` equal steps that is inside, then halved toward the last outside one -> s, inf = none
    x, y, z, dx, dy, dz = ray
    size = (end - begin) / steps
    for k in range(1, steps + 1):
        s = begin + size * k
        if is_inside(front, back, plan, x + s * dx, y + s * dy, z + s * dz):
            low, part = s - size, size
            for _ in range(bisection_steps):
                part *= 0.5
                m = low + part
                if not is_inside(front, back, plan, x + m * dx, y + m * dy, z + m * dz):
                    low = m
            return low + part
    return np.inf


@ordered
def patch_along(a, b, c, e, p, q, z, dx, dy, dz):
    # z minus the bilinear patch along the ray -> (A, B, C) of A w^2 + B w + C; p, q: position in the cell at w = 0
    along_x, along_y, twist = b - a, c - a, (a - b) + (e - c)
    return (
        -twist * dx * dy,
        dz - (along_x * dx + along_y * dy + twist * (p * dy + q * dx)),
        (z - a) - (along_x * p + along_y * q + twist * p * q),
    )


@ordered
def rising_root(A, B, C):
    # where A w^2 + B w + C rises through 0; inf = nowhere
    square = B * B - 4.0 * A * C
    if not square >= 0.0:
        return np.inf
    w = -0.5 * (B + math.copysign(math.sqrt(square), B))
    if B >= 0.0:
        return C / w if w != 0.0 else np.inf
    return w / A if A != 0.0 else np.inf


@helper
def corners_of(grid, i, j):
    return float(grid[j, i]), float(grid[j, i + 1]), float(grid[j + 1, i]), float(grid[j + 1, i + 1])


@helper
def first_in_cell(front, back, i, j, p, q, z, dx, dy, dz, length, was_out):
    # i, j: cell in the grid; p, q, z at w = 0 -> (first w in [0, length] that is inside after having been outside, or
    # inf; is it outside at the end?)
    a, b, c, e = corners_of(front, i, j)
    A, B, C = patch_along(a, b, c, e, p, q, z, dx, dy, dz)
    end = C + length * (B + length * A)
    if back.shape[0] == 0:
        if C >= 0.0 and (was_out or (C <= ARRIVING and B >= 0.0)):
            return 0.0, False
        w = rising_root(A, B, C)
        return (w if 0.0 <= w <= length else np.inf), end < 0.0
    a, b, c, e = corners_of(back, i, j)
    D, E, F = patch_along(a, b, c, e, p, q, z, dx, dy, dz)
    D, E, F = -D, -E, -F  # back minus z
    far = F + length * (E + length * D)
    if C >= 0.0 and F >= 0.0 and (was_out or (C <= ARRIVING and B >= 0.0) or (F <= ARRIVING and E >= 0.0)):
        return 0.0, False
    w = rising_root(A, B, C)
    w = w if 0.0 <= w <= length and F + w * (E + w * D) >= 0.0 else np.inf
    v = rising_root(D, E, F)
    v = v if 0.0 <= v <= length and C + v * (B + v * A) >= 0.0 else np.inf
    return min(w, v), end < 0.0 or far < 0.0


@helper
def search_along(front, back, lows, highs, plan, ray, begin, end, solid):
    # first s in [begin, end] that is inside, no feature missed -> s, inf = none; solid: being inside at `begin` counts
    x, y, z, dx, dy, dz = ray
    rows, columns, top, wraps = plan[0], plan[1], plan[2], plan[3] != 0
    two = back.shape[0] > 0
    over_x, over_y = (1.0 / dx if dx != 0.0 else 0.0), (1.0 / dy if dy != 0.0 else 0.0)
    s, was_out = begin, solid
    i, j = np.int64(math.floor(x + s * dx)), np.int64(math.floor(y + s * dy))
    if not wraps:
        i, j = min(max(i, 0), columns - 1), min(max(j, 0), rows - 1)
    ci, cj = i, j  # the same cell in the grid
    if wraps:
        ci, cj = i % columns, j % rows
    level = min(top, START)
    while True:
        size = np.int64(1) << level
        left, up = ci & ~(size - 1), cj & ~(size - 1)  # of the block, in the grid
        right, down = min(left + size, columns), min(up + size, rows)
        to, axis = end, 0
        if dx != 0.0:
            t = ((i - ci) + (right if dx > 0.0 else left) - x) * over_x
            if t < to:
                to, axis = t, 1
        if dy != 0.0:
            t = ((j - cj) + (down if dy > 0.0 else up) - y) * over_y
            if t < to:
                to, axis = t, 2
        to = max(to, s)
        za, zb = z + s * dz, z + to * dz
        node = plan[HEAD + 2 * level] + (cj >> level) * plan[HEAD + 2 * level + 1] + (ci >> level)
        free = max(za, zb) < lows[node]
        if two:
            free = free or min(za, zb) > highs[node]
        if not free:
            if level > 0:
                level -= 1
                continue
            w, was_out = first_in_cell(
                front, back, ci, cj, x + s * dx - i, y + s * dy - j, za, dx, dy, dz, to - s, was_out
            )
            if w < np.inf:
                return s + w
        else:
            was_out = True
        if axis == 0:
            return np.inf
        s = to
        if axis == 1:
            across = right if dx > 0.0 else left - 1
            along = min(max(np.int64(math.floor(y + s * dy)) - (j - cj), up), down - 1)
            climbs = (across & size) == 0 if dx > 0.0 else (across & size) != 0
            i, j, ci, cj = i + across - ci, j + along - cj, across, along
        else:
            across = down if dy > 0.0 else up - 1
            along = min(max(np.int64(math.floor(x + s * dx)) - (i - ci), left), right - 1)
            climbs = (across & size) == 0 if dy > 0.0 else (across & size) != 0
            i, j, ci, cj = i + along - ci, j + across - cj, along, across
        if ci < 0 or cj < 0 or ci >= columns or cj >= rows:
            if not wraps:
                return np.inf
            ci = ci + columns if ci < 0 else (ci - columns if ci >= columns else ci)
            cj = cj + rows if cj < 0 else (cj - rows if cj >= rows else cj)
        if climbs and level < top:
            level += 1


@helper
def clip_unit(at, direction, begin, end):
    # keep the part of [begin, end] where 0 <= at + s * direction <= 1
    if direction != 0.0:
        one, other = -at / direction, (1.0 - at) / direction
        return max(begin, min(one, other)), min(end, max(one, other))
    return (begin, end) if 0.0 <= at <= 1.0 else (begin, -np.inf)
