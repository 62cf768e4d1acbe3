"""Exact hits of the patches of a layered image, every ray walked on from its start on its epipolar line.

Rays walk the cells in order, over blocks that they pass above or below, and meet every patch of a cell. Frames may be
parallel or perspective: a column ``u = i`` is crossed at ``t = (i P_q - P_x) / (Q_x - i Q_q)``.

Symbols: :mod:`ibrpipe.core.rays`.

Packed arguments: ``patches`` (starts (cells + 1,) i64 first patch of every cell, corners (P, 4) f32, masks (P,) u8);
``pyramid`` (nodes, meta, grid), grid = (lowest depth, depth per step); ``view`` (rays (16,): start (4,), then Q_of
(4, 3) row by row, eye: camera depth that still belongs to the eye); ``pixel`` (px, py) the middle of a pixel;
``depths`` (least, greatest).
"""

from __future__ import annotations

import math

import numpy as np
from numba import prange

from ibrpipe.core.epipolar import lines as el
from ibrpipe.core.jit import helper, kernel, ordered
from ibrpipe.core.ldi.project_heights import OVERLAP, improve
from ibrpipe.core.rays import clip_box, patch_quadratic

#: room about the depths of a patch, and about those of a ray in a cell, as a share of their range
CLOSE = 1e-6


@ordered
def meet_ray(px, py, i, j, corners, mask, near, view):
    # nearest hit from the front of one ray with a patch of which some quadrants count -> camera depth, inf for none;
    # near: camera depth from which the ray is counted
    rays, eye = view
    start = (rays[0], rays[1], rays[2], rays[3])
    direction = (
        rays[4] * px + rays[5] * py + rays[6],
        rays[7] * px + rays[8] * py + rays[9],
        rays[10] * px + rays[11] * py + rays[12],
        rays[13] * px + rays[14] * py + rays[15],
    )
    A, B, C, u, v, q, du, dv, dq = patch_quadratic(start, direction, i, j, corners, near)
    square = B * B - 4.0 * A * C
    if not square >= 0.0:
        return np.inf
    w = -0.5 * (B + math.copysign(math.sqrt(square), B))
    best = np.inf
    for root in (C / w, w / A):
        if root < best and near + root > eye and not 2.0 * A * root + B <= 0.0:
            wide = q + root * dq
            p, r, slack = u + root * du, v + root * dv, OVERLAP * wide
            if wide > 0.0 and -slack <= p <= wide + slack and -slack <= r <= wide + slack:
                low = p <= 0.5 * wide
                quadrant = (1 if low else 2) if r <= 0.5 * wide else (4 if low else 8)
                if mask & quadrant:
                    best = root
    return near + best


@helper
def start_of(px, py, P, Q, sectors, table):
    # camera depth before which the ray of a pixel meets nothing: -inf where it has no line, inf for none
    wx, wy = P[3] * Q[0] - Q[3] * P[0], P[3] * Q[1] - Q[3] * P[1]
    number = (0 if wx > 0.0 else 1) if abs(wx) >= abs(wy) else (2 if wy > 0.0 else 3)
    own = sectors[number]
    if own[el.USED] == 0.0:
        return -np.inf
    line = (own[0] * px + own[1] * py + own[2]) / (own[3] * px + own[4] * py + own[5])
    bin_position = own[6] * px + own[7] * py + own[8]
    if not (0.0 <= line < own[el.LINES] and 0.0 <= bin_position < own[el.BINS]):
        return -np.inf
    entry = own[el.FIRST] + math.floor(line) * own[el.LINE_STEP] + math.floor(bin_position) * own[el.BIN_STEP]
    along = float(table[int(entry)])
    if along == np.inf:
        return np.inf
    axis = int(own[el.AXIS])
    edge = along if own[el.SIGN] > 0.0 else own[el.ALONG] - along
    return (edge * P[3] - P[axis]) / (Q[axis] - edge * Q[3])


@helper
def edge_ahead(edge, P, Q, axis, now, last, forward):
    # camera depth from `now` on at which the ray crosses a column or row, inf if it ends (at `last`) before
    if (last <= edge) if forward else (last >= edge):
        return np.inf
    under = Q[axis] - edge * Q[3]
    return max((edge * P[3] - P[axis]) / under, now) if under != 0.0 else np.inf


@helper
def meet_cell(pixel, i, j, cell, near, depths, patches, view):
    # nearest hit with the patches of one cell that lie between two depths -> (t, patch)
    starts, corners, masks = patches
    least, greatest = depths
    best, number = np.inf, -1
    for patch in range(starts[cell], starts[cell + 1]):
        a, b = float(corners[patch, 0]), float(corners[patch, 1])
        c, e = float(corners[patch, 2]), float(corners[patch, 3])
        low, high = min(min(a, b), min(c, e)), max(max(a, b), max(c, e))
        room = CLOSE * (high - low)
        if low - room > greatest or high + room < least:
            continue
        t = meet_ray(pixel[0], pixel[1], float(i), float(j), (a, b, c, e), masks[patch], near, view)
        if t < best:
            best, number = t, patch
    return best, number


@helper
def border_side(first, last, cell):
    # does a ray run along a border of its cells? -> -1 or 1 where the cell beyond it lies, else 0
    if abs(first - last) > 1e-8:
        return 0
    return -1 if abs(first - cell) < 1e-8 else (1 if abs(first - cell - 1.0) < 1e-8 else 0)


@helper
def meet_cells(pixel, i, j, sides, size, near, depths, patches, view):
    # as meet_cell, with the cells beyond the borders that the ray runs along; size: columns and rows of cells
    side_i, side_j = sides
    columns, rows = size
    best, number = np.inf, -1
    for k in range(4):
        di, dj = side_i * (k & 1), side_j * (k >> 1)
        if (k & 1 and di == 0) or (k >> 1 and dj == 0) or not (0 <= i + di < columns and 0 <= j + dj < rows):
            continue
        cell = (j + dj) * columns + i + di
        t, patch = meet_cell(pixel, i + di, j + dj, cell, near, depths, patches, view)
        if t < best:
            best, number = t, patch
    return best, number


@helper
def walk_cells(pixel, P, Q, near, far, patches, pyramid, view):
    # -> (t, patch) of the first hit between camera depths near and far, (inf, -1) for none
    nodes, meta, grid = pyramid
    wx, wy = P[3] * Q[0] - Q[3] * P[0], P[3] * Q[1] - Q[3] * P[1]
    ahead_i, ahead_j = 1 if wx > 0.0 else 0, 1 if wy > 0.0 else 0
    columns, rows, top, level, t = meta[0, 1], meta[0, 2], len(meta) - 1, 0, near
    q = P[3] + far * Q[3]
    last_u, last_v = (P[0] + far * Q[0]) / q, (P[1] + far * Q[1]) / q
    q = P[3] + t * Q[3]
    i = min(max(int(math.floor((P[0] + t * Q[0]) / q + (1e-9 if wx > 0.0 else -1e-9))), 0), columns - 1)
    j = min(max(int(math.floor((P[1] + t * Q[1]) / q + (1e-9 if wy > 0.0 else -1e-9))), 0), rows - 1)
    side_i, side_j = border_side((P[0] + t * Q[0]) / q, last_u, i), border_side((P[1] + t * Q[1]) / q, last_v, j)
    alone = side_i == 0 and side_j == 0
    while True:
        edge_i, edge_j = ((i >> level) + ahead_i) << level, ((j >> level) + ahead_j) << level
        tx = edge_ahead(float(edge_i), P, Q, 0, t, last_u, wx > 0.0)
        ty = edge_ahead(float(edge_j), P, Q, 1, t, last_v, wy > 0.0)
        t1 = min(min(tx, ty), far)
        node = nodes[meta[level, 0] + (j >> level) * meta[level, 1] + (i >> level)]
        least = grid[0] + float(node & np.uint32(65535)) * grid[1]
        greatest = grid[0] + float(node >> np.uint32(16)) * grid[1]
        d0, d1 = (P[2] + t * Q[2]) / (P[3] + t * Q[3]), (P[2] + t1 * Q[2]) / (P[3] + t1 * Q[3])
        slack = 1e-9 * grid[1] * 65535.0
        nearest, farthest = min(d0, d1), max(d0, d1)
        passes = (nearest > greatest + slack) | (farthest < least - slack) | (least > greatest)
        passes &= alone
        if not passes and level > 0:
            level -= 1
            continue
        if not passes:
            slack += CLOSE * (farthest - nearest)
            depths = (nearest - slack, farthest + slack)
            hit, patch = meet_cells(pixel, i, j, (side_i, side_j), (columns, rows), t, depths, patches, view)
            if patch >= 0:
                return hit, patch
        if t1 >= far:
            return np.inf, -1
        q = P[3] + t1 * Q[3]
        if tx < ty:
            low, i = (j >> level) << level, edge_i + ahead_i - 1
            j = min(max(int(math.floor((P[1] + t1 * Q[1]) / q)), low), low + (1 << level) - 1)
        else:
            low, j = (i >> level) << level, edge_j + ahead_j - 1
            i = min(max(int(math.floor((P[0] + t1 * Q[0]) / q)), low), low + (1 << level) - 1)
        if i < 0 or j < 0 or i >= columns or j >= rows:
            return np.inf, -1
        t, level = t1, min(level + 1, top) if passes else level


@kernel
def cast_patches(patches, pyramid, view, box, eye, lines, base, parts, depth, ids):
    # view: (start (4,), Q_of (4, 3)); box: columns, rows, least d, greatest d; lines: (sectors, table) of
    # epipolar.sweep; depth (h, w) f32 and ids (h, w) u32 are lowered in place; a hit's id is base + its patch
    start, Q_of = view
    sectors, table = lines
    rows, columns = depth.shape
    for part in prange(parts):
        rays, Q = np.empty(16), np.empty(4)
        rays[:4] = start
        for k in range(4):
            for m in range(3):
                rays[4 + 3 * k + m] = Q_of[k, m]
        for y in range(np.int64(part), rows, parts):
            for x in range(columns):
                px, py = x + 0.5, y + 0.5
                for k in range(4):
                    Q[k] = Q_of[k, 0] * px + Q_of[k, 1] * py + Q_of[k, 2]
                seen = float(depth[y, x])  # what is behind another map's hit is not searched
                near, far = clip_box(start, Q[0], Q[1], Q[2], Q[3], box, seen + CLOSE * seen)
                near = max(near, start_of(px, py, start, Q, sectors, table))
                if not near <= far:
                    continue
                t, patch = walk_cells((px, py), start, Q, near, far, patches, pyramid, (rays, eye))
                if patch >= 0:
                    improve(depth, ids, y, x, t, np.uint32(base + patch))
