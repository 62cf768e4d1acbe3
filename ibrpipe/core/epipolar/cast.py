"""Exact hits of a height field, every ray walked on from where the sweep of its epipolar line lets it start.

Rays of a tile of pixels are walked together in float32 up to the cells where they may be hit
(:mod:`ibrpipe.core.epipolar.cells`), and are met there in float64: along a ray the height above a bilinear patch is a
quadratic. Rays that are not hit there after all, and those still under way after some cells, are walked on one by
one in float64, over blocks of cells that they pass; there the ends of a cell's stretch are shared with the next cell,
so that no ray slips between two.

Symbols: t camera depth; (u, v, d) = P + t Q; F = d - height at the ends of a cell's stretch; A coefficient of the
square when the stretch is counted from 0 to 1.

Packed arguments: ``field`` (flat (H * stride,) f32 heights, NaN = hole, stride); ``pyramid`` (nodes, meta, grid), see
quadtree, grid = (lowest depth, depth per step); ``size`` (columns, rows) of cells; P (P0, P1, P2), Q (q0, q1, q2) and
``inverse`` (1 / q0, 1 / q1) of one ray.
"""

from __future__ import annotations

import math

import numpy as np
from numba import prange

from ibrpipe.core.epipolar import cells as ec
from ibrpipe.core.epipolar import lines as el
from ibrpipe.core.epipolar.entries import (
    FAR,
    INV0,
    INV1,
    NEAR,
    RAYS,
    STEEP,
    clear_entries,
    enter_cells,
    find_entries,
    look_up,
    set_out,
)
from ibrpipe.core.jit import fused, kernel

#: row of hits, in float32, where the distance along walked rays was
HIT = ec.S
#: state of a ray that is not hit in the cell where it stopped
PASSES = 3.0
#: level of the blocks of cells that are passed at once; blocks before the first cells (where lines were swept over
#: blocks of COARSE or above), and before the cells of every later round
BLOCK_LEVEL, FIRST_BLOCKS, LATE_BLOCKS, COARSE = 2, 2, 1, 2.0
#: rounding of float32
EPSILON = 2.0**-23


@fused
def hit_between(t0, t1, f0, f1, bend):
    # camera depth of the first zero of a quadratic between t0 and t1, f0 and f1 at its ends
    slope = f1 - f0 - bend
    sign = 1.0 if f0 >= 0.0 else -1.0
    f, a, b = f0 * sign, bend * sign, slope * sign
    square = b * b - 4.0 * a * f
    wide = math.sqrt(square if square > 0.0 else 0.0)
    over, under = b + wide if b > 0.0 else 2.0 * f, -2.0 * a if b > 0.0 else wide - b
    s = over / under if f > 0.0 else 0.0
    s = s if s < 1.0 else 1.0
    return t0 + (s if s > 0.0 else 0.0) * (t1 - t0)


@fused
def is_hit(f0, f1, bend):
    # has the quadratic a zero between its ends? where it starts is none
    slope = f1 - f0 - bend
    dips = (bend * f0 > 0.0) & (slope * f0 < 0.0) & (abs(slope) < 2.0 * abs(bend))
    dips &= slope * slope >= 4.0 * bend * f0
    return ((f0 * f1 <= 0.0) & (f0 != 0.0)) | dips


@fused
def meet(x0, y0, P0, P1, P2, Q_of, rays, work):
    # HIT: camera depth at which every ray that stopped is hit in its cell, inf for none
    q00, q01, q02, q10, q11, q12 = Q_of[0, 0], Q_of[0, 1], Q_of[0, 2], Q_of[1, 0], Q_of[1, 1], Q_of[1, 2]
    q20, q21, q22 = Q_of[2, 0], Q_of[2, 1], Q_of[2, 2]
    for row in range(ec.TILE_Y):
        py, start = y0 + row + 0.5, row * ec.TILE_X
        a0, a1, a2 = q01 * py + q02, q11 * py + q12, q21 * py + q22
        for k in range(ec.TILE_X):
            px, n = x0 + k + 0.5, start + k
            q0, q1, q2, i0, i1 = q00 * px + a0, q10 * px + a1, q20 * px + a2, rays[INV0 + n], rays[INV1 + n]
            i, j, t0, t1 = np.float64(work[ec.CI + n]), np.float64(work[ec.CJ + n]), rays[NEAR + n], rays[FAR + n]
            a, b = np.float64(work[ec.A + n]), np.float64(work[ec.B + n])
            c, e = np.float64(work[ec.C + n]), np.float64(work[ec.E + n])
            near0, far0 = (i - P0) * i0, (i + 1.0 - P0) * i0
            near1, far1 = (j - P1) * i1, (j + 1.0 - P1) * i1
            near0, far0 = (near0, far0) if i0 > 0.0 else (far0, near0)
            near1, far1 = (near1, far1) if i1 > 0.0 else (far1, near1)
            near0 = near0 if work[ec.CI + n] != work[ec.BI + n] else t0
            near1 = near1 if work[ec.CJ + n] != work[ec.BJ + n] else t0
            t0 = t0 if t0 > near0 else near0
            t0 = t0 if t0 > near1 else near1
            t1 = t1 if t1 < far0 else far0
            t1 = t1 if t1 < far1 else far1
            t0 = t0 if t0 < t1 else t1
            across, down, twist = b - a, c - a, (a - b) - (c - e)
            p, q = P0 + t0 * q0 - i, P1 + t0 * q1 - j
            f0 = P2 + t0 * q2 - (a + p * across + q * (down + p * twist))
            p, q = P0 + t1 * q0 - i, P1 + t1 * q1 - j
            f1 = P2 + t1 * q2 - (a + p * across + q * (down + p * twist))
            length = t1 - t0
            bend = -twist * (q0 * length) * (q1 * length)
            state = work[ec.STATE + n]
            stops, hits = state == ec.STOPS, is_hit(f0, f1, bend)
            t = hit_between(t0, t1, f0, f1, bend)
            work[HIT + n] = np.float32(t if stops & hits else np.inf)
            work[ec.STATE + n] = PASSES if stops & (not hits) else state


@fused
def find_late(work):
    # list the rays that are not done -> how many they are
    kept = 0
    if ec.count_rays(ec.LANES, np.float32(ec.GOES_ON), work) + ec.count_rays(ec.LANES, np.float32(PASSES), work) == 0:
        return kept
    for n in range(ec.LANES):
        work[ec.LANE + kept] = n
        kept += 1 if (work[ec.STATE + n] == ec.GOES_ON) | (work[ec.STATE + n] == PASSES) else 0
    return kept


@fused
def walk_on(x, y, lane, field, pyramid, P, Q_of, size, rays, work):
    # walk the ray of one pixel on from its cell
    P0, P1, _ = P
    px, py, i0, i1, near, far = (
        x + 0.5,
        y + 0.5,
        rays[INV0 + lane],
        rays[INV1 + lane],
        rays[NEAR + lane],
        rays[FAR + lane],
    )
    q0, q1 = Q_of[0, 0] * px + Q_of[0, 1] * py + Q_of[0, 2], Q_of[1, 0] * px + Q_of[1, 1] * py + Q_of[1, 2]
    q2, i, j = Q_of[2, 0] * px + Q_of[2, 1] * py + Q_of[2, 2], int(work[ec.CI + lane]), int(work[ec.CJ + lane])
    t0, t1 = near, min(far, max((i - P0) * i0, (i + 1 - P0) * i0), max((j - P1) * i1, (j + 1 - P1) * i1))
    if work[ec.CI + lane] != work[ec.BI + lane]:
        t0 = max(t0, min((i - P0) * i0, (i + 1 - P0) * i0))
    if work[ec.CJ + lane] != work[ec.BJ + lane]:
        t0 = max(t0, min((j - P1) * i1, (j + 1 - P1) * i1))
    t0, t1, f0, f1, bend, i, j = walk(
        field, pyramid, P, (q0, q1, q2), (i0, i1), min(t0, t1), far, np.nan, i, j, size
    )  # fmt: skip
    if i >= 0:
        work[HIT + lane], work[ec.CI + lane], work[ec.CJ + lane] = hit_between(t0, t1, f0, f1, bend), i, j


@fused
def max_level(sectors):
    # greatest level of blocks that lines were swept over
    most = 0.0
    for number in range(4):
        most = max(most, sectors[number, el.LEVEL])
    return most


@kernel
def cast_heights(field, pyramid, view, box, eye, lines, base, parts, depth, ids):
    # view: (start (4,), Q_of (4, 3)) of parallel rays; box: columns, rows, least d, greatest d; eye: camera depth that
    # still belongs to the eye; lines: (sectors, table) of epipolar.sweep; depth (h, w) f32 and ids (h, w) u32 are
    # lowered in place; a hit's id is base + its cell
    flat, stride = field
    nodes, meta, grid = pyramid
    start, Q_of = view
    sectors, table = lines
    picture_rows, picture_columns = depth.shape
    tiles_x, tiles_y = -(-picture_columns // ec.TILE_X), -(-picture_rows // ec.TILE_Y)
    room, room_32 = np.empty((parts, RAYS)), np.empty((2, parts, ec.WORK), np.float32)
    room_i = np.empty((parts, ec.LANES), np.int32)
    for part in prange(parts):
        rays, work, late, indices = room[part], room_32[0, part], room_32[1, part], room_i[part]
        P0, P1, P2 = start[0], start[1], start[2]
        columns, rows = box[0], box[1]
        columns_32, rows_32 = np.float32(columns), np.float32(rows)
        range_, most = box[3] - box[2], max(abs(box[2]), abs(box[3]))
        tolerance, steepest = np.float32(EPSILON * (8.0 * most + 512.0 * range_)), STEEP * range_
        level = min(BLOCK_LEVEL, len(meta) - 1)
        first, block_stride, size = meta[level, 0], meta[level, 1], np.float32(2**level)
        low, step = np.float32(grid[0]), np.float32(grid[1])
        first_blocks = FIRST_BLOCKS if max_level(sectors) >= COARSE else 0
        for tile in range(np.int64(part), tiles_x * tiles_y, parts):
            y0, x0 = (tile // tiles_x) * ec.TILE_Y, (tile % tiles_x) * ec.TILE_X
            y1, x1 = min(y0 + ec.TILE_Y, picture_rows), min(x0 + ec.TILE_X, picture_columns)
            set_out(x0, y0, P0, P1, P2, Q_of, box, eye, rays)
            clear_entries(rays, indices)
            for number in range(4):
                if sectors[number, el.USED] > 0.0 and crosses(number, x0, y0, x1, y1, Q_of):
                    along = P0 if number < 2 else P1
                    if number & 1:
                        along = (columns if number < 2 else rows) - along
                    find_entries(number, sectors, along, x0, y0, rays, indices)
            look_up(table, rays, indices)
            if enter_cells(x0, y0, P0, P1, P2, Q_of, columns, rows, steepest, rays, work) == 0:
                continue
            going, passed, blocks, batch = ec.LANES, 0, first_blocks, work
            while going > 0 and passed < ec.PATIENCE:
                count = ec.whole_vectors(going)
                for _ in range(blocks):
                    ec.cross_blocks(
                        count, nodes, first, block_stride, size, low, step, columns_32, rows_32, tolerance, batch,
                        indices,
                    )  # fmt: skip
                left = ec.advance(
                    count, flat, stride, columns_32, rows_32, tolerance, batch, indices
                )  # fmt: skip
                passed, blocks = passed + ec.STRIDE, LATE_BLOCKS
                if passed == ec.STRIDE:
                    going, batch = ec.leave_behind(left, work, late), late
                elif left < ec.CROWDED * going or passed >= ec.PATIENCE:
                    going = ec.bring_back(going, late, work)
            meet(x0, y0, P0, P1, P2, Q_of, rays, work)
            for n in range(find_late(work)):
                lane = int(work[ec.LANE + n])
                x, y = x0 + lane % ec.TILE_X, y0 + lane // ec.TILE_X
                walk_on(x, y, lane, field, pyramid, (P0, P1, P2), Q_of, (columns, rows), rays, work)
            enter_hits(x0, y0, x1 - x0, y1 - y0, stride, base, work, indices, depth, ids)


@fused
def enter_hits(x0, y0, wide, high, stride, base, work, indices, depth, ids):
    # a hit replaces another when it is nearer, or as near with a lesser number
    for n in range(ec.LANES):
        indices[n] = np.int32(work[ec.CJ + n]) * np.int32(stride - 1) + np.int32(work[ec.CI + n]) + np.int32(base)
    for row in range(high):
        y, start = np.uint64(y0 + row), row * ec.TILE_X
        for k in range(wide):
            t, number, x = work[HIT + start + k], np.uint32(indices[start + k]), np.uint64(x0) + np.uint64(k)
            before, other = depth[y, x], ids[y, x]
            nearer = (t < before) | ((t == before) & (t < np.float32(np.inf)) & (number < other))
            depth[y, x] = t if nearer else before
            ids[y, x] = number if nearer else other


@fused
def crosses(number, x0, y0, x1, y1, Q_of):
    # may a ray of the tile belong to the sector?
    for corner in range(4):
        x, y = x0 if corner & 1 else x1, y0 if corner & 2 else y1
        wx, wy = Q_of[0, 0] * x + Q_of[0, 1] * y + Q_of[0, 2], Q_of[1, 0] * x + Q_of[1, 1] * y + Q_of[1, 2]
        along = wx if number < 2 else wy
        if (-along if number & 1 else along) > 0.0:
            return True
    return False


@fused
def walk(field, pyramid, P, Q, inverse, t0, far, F0, i, j, size):
    # one ray from (t0, F0) in cell (i, j) on, over blocks of cells that it passes above or below
    # -> (t0, t1, F0, F1, A, i, j) of the cell where it is hit, i = -1 for none
    flat, stride = field
    nodes, meta, grid = pyramid
    P0, P1, P2 = P
    q0, q1, q2 = Q
    i0, i1 = inverse
    columns, rows = size
    ai, aj = 1 if i0 > 0.0 else 0, 1 if i1 > 0.0 else 0
    last_i, last_j, top, level = int(columns) - 1, int(rows) - 1, len(meta) - 1, 1
    start, rate = (P2 - grid[0]) / grid[1], q2 / grid[1]
    while True:
        bi, bj = i >> level, j >> level
        edge_i, edge_j = (bi + ai) << level, (bj + aj) << level
        tx, ty = (edge_i - P0) * i0, (edge_j - P1) * i1
        t1 = min(min(tx, ty), far)
        node = nodes[meta[level, 0] + bj * meta[level, 1] + bi]
        least, greatest = float(node & np.uint32(65535)), float(node >> np.uint32(16))
        d0, d1 = start + t0 * rate, start + t1 * rate
        passes = (min(d0, d1) > greatest) | (max(d0, d1) < least)
        if passes | (level == 0):
            F1 = np.nan
            if not passes:
                cell = j * stride + i
                a, b = float(flat[cell]), float(flat[cell + 1])
                c, e = float(flat[cell + stride]), float(flat[cell + stride + 1])
                twist = (a - b) - (c - e)
                if F0 != F0:
                    p, q = P0 + t0 * q0 - i, P1 + t0 * q1 - j
                    F0 = P2 + t0 * q2 - (a + p * (b - a) + q * (c - a) + p * q * twist)
                p, q = P0 + t1 * q0 - i, P1 + t1 * q1 - j
                F1 = P2 + t1 * q2 - (a + p * (b - a) + q * (c - a) + p * q * twist)
                length = t1 - t0
                A = -twist * (q0 * length) * (q1 * length)
                slope = F1 - F0 - A
                dips = (A * F0 > 0.0) & (slope * F0 < 0.0) & (abs(slope) < 2.0 * abs(A))
                if ((F0 * F1 <= 0.0) & (F0 != 0.0)) | (dips & (slope * slope >= 4.0 * A * F0)):
                    return t0, t1, F0, F1, A, i, j
            if tx < ty:
                i = edge_i + ai - 1
                j = min(max(int(np.floor(P1 + t1 * q1)), bj << level), ((bj + 1) << level) - 1)
            else:
                i = min(max(int(np.floor(P0 + t1 * q0)), bi << level), ((bi + 1) << level) - 1)
                j = edge_j + aj - 1
            if (t1 >= far) | (i < 0) | (i > last_i) | (j < 0) | (j > last_j):
                return t0, t1, F0, F1, 0.0, -1, -1
            t0, F0 = t1, F1
            level = min(level + 1, top) if passes else level
        else:
            level -= 1
