"""Nearest hit of every pixel's ray with one field through its pyramid. Source: gong-yang, sec. 5.1.

The ray walks the blocks of the pyramid in ray order: it steps over a block whose depth range it misses, descends into
one that it may hit, and meets the patches of a cell exactly. See :mod:`ibrpipe.core.rays` for the coordinates.

Symbols: p, q in [0, 1] position in a cell; ``g(s) = d(s) - bilinear(p(s), q(s))``, a hit is a root of g; a *front* hit
is a root where g rises (the ray passes to greater depth).

Packed arguments: ``position`` (u, v, d) of a ray at s = 0 and ``direction`` (du, dv, dd) to s = 1; ``corners`` (a, b,
c, e) depths at (0, 0), (1, 0), (0, 1), (1, 1); ``pyramid`` (nodes, meta, grid), grid = (lowest depth, steps per depth);
``leaves`` (height, cells, corners, masks): see renderers.search.quadtree.Sheet; ``view`` (start (4,), Q_of (4, 3)).
"""

from __future__ import annotations

import math

import numpy as np
from numba import prange

from ibrpipe.core.jit import fused, helper, kernel
from ibrpipe.core.ldi.project_heights import improve
from ibrpipe.core.rays import clip_box, depth_at

#: how far, in cells or ray lengths, a root may lie outside its cell
OVERLAP = 1e-9


@fused
def accept_root(s, least, slope, front, mask, p, q, slack):
    # least: least s that counts; p, q: position in the cell at the root, which may lie `slack` outside
    if not (least <= s <= 1.0 + OVERLAP) or (front and slope <= 0.0):
        return False
    if not (-slack <= p <= 1.0 + slack and -slack <= q <= 1.0 + slack):
        return False
    if mask == 15:
        return True
    corner = mask & (1 if q <= 0.5 else 4) if p <= 0.5 else mask & (2 if q <= 0.5 else 8)
    return corner != 0


@fused
def meet_patch(corners, mask, position, direction, least, front, slack):
    # position, direction: in the coordinates of the cell -> nearest s or inf
    a, b, c, e = corners
    p, q, d = position
    dp, dq, dd = direction
    twist = a - b - c + e
    A = -twist * dp * dq
    B = dd - ((b - a) * dp + (c - a) * dq + twist * (p * dq + q * dp))
    C = d - (a + (b - a) * p + (c - a) * q + twist * p * q)
    square = B * B - 4.0 * A * C
    if square < 0.0:
        return np.inf
    w = -0.5 * (B + math.copysign(math.sqrt(square), B))
    first = C / w if w != 0.0 else np.inf  # a ray inside the surface never crosses it
    second = w / A if A != 0.0 else np.inf
    if second < first:
        first, second = second, first
    if accept_root(first, least, 2.0 * A * first + B, front, mask, p + first * dp, q + first * dq, slack):
        return first
    if accept_root(second, least, 2.0 * A * second + B, front, mask, p + second * dp, q + second * dq, slack):
        return second
    return np.inf


@fused
def meet_cell(leaves, column, row, columns, position, direction, near, front, slack):
    # nearest (s, patch) in the cell, s = inf if none; near: camera depth at s = 0, where the eye itself is no hit
    height, cells, corners, masks = leaves
    here = (position[0] - column, position[1] - row, position[2])
    least = -OVERLAP if near > 0.0 else OVERLAP
    patch = row * columns + column
    if cells.shape[0] == 0:
        a, b = float(height[row, column]), float(height[row, column + 1])
        c, e = float(height[row + 1, column]), float(height[row + 1, column + 1])
        return meet_patch((a, b, c, e), 15, here, direction, least, front, slack), patch
    patch = np.int64(cells[patch])
    if patch < 0:
        return np.inf, patch
    a, b = float(corners[patch, 0]), float(corners[patch, 1])
    c, e = float(corners[patch, 2]), float(corners[patch, 3])
    return meet_patch((a, b, c, e), masks[patch], here, direction, least, front, slack), patch


@helper
def walk_ray(pyramid, leaves, columns, rows, position, direction, near_t, front):
    # ray from s = 0 to 1 -> (s, patch, column, row); s = inf for a miss; near_t: as near in meet_cell
    nodes, meta, grid = pyramid
    low, scale = grid
    u, v, d = position
    du, dv, dd = direction
    right, below = (1 if du > 0.0 else 0), (1 if dv > 0.0 else 0)
    i, j = min(max(int(u), 0), columns - 1), min(max(int(v), 0), rows - 1)
    level, top, s = len(meta) - 1, len(meta) - 1, 0.0
    while True:
        bi, bj = i >> level, j >> level
        plane_u, plane_v = (bi + right) << level, (bj + below) << level
        su = (plane_u - u) / du if du != 0.0 else np.inf
        sv = (plane_v - v) / dv if dv != 0.0 else np.inf
        leave = max(min(min(su, sv), 1.0), s)
        node = nodes[meta[level, 0] + bj * meta[level, 1] + bi]
        da, db = (d + s * dd - low) * scale, (d + leave * dd - low) * scale
        near, far = min(da, db) - 0.25, max(da, db) + 0.25
        least, greatest = float(node & np.uint32(0xFFFF)), float(node >> np.uint32(16))
        if least <= greatest and near <= greatest and far >= least:
            if level > 0:
                level -= 1
                continue
            hit, patch = meet_cell(leaves, i, j, columns, position, direction, near_t, front, OVERLAP)
            if hit < np.inf:
                return hit, patch, i, j
        if leave >= 1.0:
            return np.inf, np.int64(-1), 0, 0
        size = 1 << level
        if su < sv:
            i, j = plane_u + right - 1, min(max(int(v + leave * dv), bj * size), bj * size + size - 1)
        else:
            i, j = min(max(int(u + leave * du), bi * size), bi * size + size - 1), plane_v + below - 1
        if i < 0 or j < 0 or i >= columns or j >= rows:
            return np.inf, np.int64(-1), 0, 0
        s = leave
        level = min(level + 1, top)


@kernel
def search_field(view, box, pyramid, leaves, front, window, base, depth, ids):
    # box (4,): see rays; window (x0, x1, y0, y1) pixels; depth (h, w) f32 and ids (h, w) u32 are lowered in place:
    # nearest hit, at equal depth the least id; a hit's id is base + its patch (or cell) number
    start, Q_of = view
    columns, rows = int(box[0]), int(box[1])
    for y in prange(window[2], window[3]):
        for x in range(window[0], window[1]):
            px, py = x + 0.5, y + 0.5
            dx = Q_of[0, 0] * px + Q_of[0, 1] * py + Q_of[0, 2]
            dy = Q_of[1, 0] * px + Q_of[1, 1] * py + Q_of[1, 2]
            dn = Q_of[2, 0] * px + Q_of[2, 1] * py + Q_of[2, 2]
            dq = Q_of[3, 0] * px + Q_of[3, 1] * py + Q_of[3, 2]
            near, far = clip_box(start, dx, dy, dn, dq, box, float(depth[y, x]) * (1.0 + 1e-6))
            if not near <= far:
                continue
            qa, qb = start[3] + near * dq, start[3] + far * dq
            u, v, d = (start[0] + near * dx) / qa, (start[1] + near * dy) / qa, (start[2] + near * dn) / qa
            du, dv = (start[0] + far * dx) / qb - u, (start[1] + far * dy) / qb - v
            dd = (start[2] + far * dn) / qb - d
            s, patch, _, _ = walk_ray(pyramid, leaves, columns, rows, (u, v, d), (du, dv, dd), near, front)
            if s < np.inf:
                improve(depth, ids, y, x, depth_at(s, near, far, qa, qb), np.uint32(base + patch))
