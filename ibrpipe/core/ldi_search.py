"""Nearest hit of every pixel's ray with one field through its pyramid. Source: gong-yang, sec. 5.1.

The ray walks the blocks of the pyramid in ray order: it steps over a block whose depth range it misses, descends into
one that it may hit, and meets the patches of a cell exactly. See :mod:`ibrpipe.core.rays` for the coordinates.

Symbols: p, q in [0, 1] place in a cell; ``g(s) = d(s) - bilinear(p(s), q(s))``, a hit is a root of g; a *front* hit is
a root where g rises (the ray passes to greater depth).
"""

from __future__ import annotations

import math

import numpy as np
from numba import prange

from ibrpipe.core.jit import helper, kernel
from ibrpipe.core.rays import clip_box, depth_at


@helper
def accept_root(s, low, high, slope, front, mask, p, q):
    # p, q: place in the cell at the root
    if not low <= s <= high or (front and slope <= 0.0):
        return False
    if mask == 15:
        return True
    left = mask & (1 if q <= 0.5 else 4) if p <= 0.5 else mask & (2 if q <= 0.5 else 8)
    return left != 0


@helper
def meet_patch(a, b, c, e, mask, p, q, d, dp, dq, dd, low, high, front):
    # patch corner depths a (0, 0), b (1, 0), c (0, 1), e (1, 1); ray (p, q, d) + s (dp, dq, dd) -> nearest s or inf
    twist = a - b - c + e
    A = -twist * dp * dq
    B = dd - ((b - a) * dp + (c - a) * dq + twist * (p * dq + q * dp))
    C = d - (a + (b - a) * p + (c - a) * q + twist * p * q)
    square = B * B - 4.0 * A * C
    if square < 0.0:
        return np.inf
    w = -0.5 * (B + math.copysign(math.sqrt(square), B))
    first = C / w if w != 0.0 else (0.0 if C == 0.0 else np.inf)
    second = w / A if A != 0.0 else np.inf
    if second < first:
        first, second = second, first
    if accept_root(first, low, high, 2.0 * A * first + B, front, mask, p + first * dp, q + first * dq):
        return first
    if accept_root(second, low, high, 2.0 * A * second + B, front, mask, p + second * dp, q + second * dq):
        return second
    return np.inf


@helper
def meet_cell(leaves, column, row, columns, u, v, d, du, dv, dd, low, high, front):
    # nearest (s, patch) of the cell's patches, (inf, -1) if none; leaves = (height, starts, corners, masks)
    height, starts, corners, masks = leaves
    p, q = u - column, v - row
    cell = row * columns + column
    if starts.shape[0] == 0:
        a, b = float(height[row, column]), float(height[row, column + 1])
        c, e = float(height[row + 1, column]), float(height[row + 1, column + 1])
        return meet_patch(a, b, c, e, 15, p, q, d, du, dv, dd, low, high, front), cell
    best, found = np.inf, -1
    for k in range(starts[cell], starts[cell + 1]):
        a, b, c, e = float(corners[k, 0]), float(corners[k, 1]), float(corners[k, 2]), float(corners[k, 3])
        s = meet_patch(a, b, c, e, masks[k], p, q, d, du, dv, dd, low, high, front)
        if s < best:
            best, found = s, k
    return best, found


@helper
def walk_ray(nodes, meta, leaves, columns, rows, grid, u, v, d, du, dv, dd, front):
    # grid = (lowest depth, steps per depth); ray from s = 0 to 1 -> (s, patch, column, row); s = inf for a miss
    low, scale = grid
    fastest = max(abs(du), abs(dv))
    nudge = 1e-9 / max(fastest, 1e-9)
    level, s = len(meta) - 1, 0.0
    while True:
        ahead = s + nudge
        i = min(max(int(math.floor(u + ahead * du)), 0), columns - 1)
        j = min(max(int(math.floor(v + ahead * dv)), 0), rows - 1)
        bi, bj = i >> level, j >> level
        su = (((bi + (du > 0.0)) << level) - u) / du if du != 0.0 else np.inf
        sv = (((bj + (dv > 0.0)) << level) - v) / dv if dv != 0.0 else np.inf
        leave = max(min(min(su, sv), 1.0), s)
        node = nodes[meta[level, 0] + bj * meta[level, 1] + bi]
        da, db = (d + s * dd - low) * scale, (d + leave * dd - low) * scale
        near, far = min(da, db) - 0.25, max(da, db) + 0.25
        least, greatest = float(node & np.uint32(0xFFFF)), float(node >> np.uint32(16))
        if least <= greatest and near <= greatest and far >= least:
            if level > 0:
                level -= 1
                continue
            hit, patch = meet_cell(
                leaves, i, j, columns, u, v, d, du, dv, dd, s - 4.0 * nudge, leave + 4.0 * nudge, front
            )
            if hit < np.inf:
                return hit, patch, i, j
        if leave >= 1.0:
            return np.inf, -1, 0, 0
        s = leave + nudge
        level = min(level + 1, len(meta) - 1)


@kernel
def search_field(start, turn, box, grid, front, nodes, meta, leaves, window, best, index, number, patches, places):
    # start (4,), turn (4, 3): see rays; window (x0, x1, y0, y1) pixels; best (H, W) f32 camera depth so far, lowered in
    # place; index (H, W) i16 becomes `number`, patches (H, W) i32, places (H, W, 2) f32 where it was lowered
    columns, rows = int(box[0]), int(box[1])
    for y in prange(window[2], window[3]):
        for x in range(window[0], window[1]):
            px, py = x + 0.5, y + 0.5
            r0 = turn[0, 0] * px + turn[0, 1] * py + turn[0, 2]
            r1 = turn[1, 0] * px + turn[1, 1] * py + turn[1, 2]
            r2 = turn[2, 0] * px + turn[2, 1] * py + turn[2, 2]
            r3 = turn[3, 0] * px + turn[3, 1] * py + turn[3, 2]
            near, far = clip_box(start, r0, r1, r2, r3, box, float(best[y, x]))
            if not near <= far:
                continue
            qa, qb = start[3] + near * r3, start[3] + far * r3
            if not (qa > 0.0 and qb > 0.0):
                continue
            u, v, d = (start[0] + near * r0) / qa, (start[1] + near * r1) / qa, (start[2] + near * r2) / qa
            du = (start[0] + far * r0) / qb - u
            dv = (start[1] + far * r1) / qb - v
            dd = (start[2] + far * r2) / qb - d
            s, patch, i, j = walk_ray(nodes, meta, leaves, columns, rows, grid, u, v, d, du, dv, dd, front)
            if s < np.inf:
                t = depth_at(min(max(s, 0.0), 1.0), near, far, qa, qb)
                if np.float32(t) < best[y, x]:
                    best[y, x] = t
                    if index.shape[0] > 0:
                        index[y, x] = number
                    if patches.shape[0] > 0:
                        patches[y, x] = patch
                        places[y, x, 0] = min(max(u + s * du - i, 0.0), 1.0)
                        places[y, x, 1] = min(max(v + s * dv - j, 0.0), 1.0)
