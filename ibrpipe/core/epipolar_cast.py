"""Exact hits of a height field, every ray walked on from where the sweep of its epipolar line lets it start.

Cells are bilinear patches of the heights at their corners. Along a ray the height above a patch is a quadratic, of
which the walk needs its two ends and its bend. Ends are shared by neighbouring cells, so that no ray slips between two.
Rays of a tile of pixels are walked together, a cell at a time, in loops without branches; those that are still on
their way after some cells are walked on one by one, over blocks of cells that they pass.

Symbols: t camera depth; (u, v, d) = P + t Q; F = d - height at the ends of a cell's way; A coefficient of the square
when the way is counted from 0 to 1.
"""

from __future__ import annotations

import math

import numpy as np
from numba import prange

from ibrpipe.core import epipolar_lines as el
from ibrpipe.core.jit import fused, kernel

#: pixels of a tile along x and y, and together
TILE_X, TILE_Y = 32, 8
LANES = TILE_X * TILE_Y
#: cells that rays are taken through before those that are done are left behind, and cells before they go one by one
STRIDE, PATIENCE = 3, 24
#: how far beyond an edge a ray is taken to be in the next cell, in cells
NUDGE = 1e-9
#: rows of the working memory, LANES numbers each: ray, its place, the cell it is in, what came of it
Q0, Q1, Q2, I0, I1, FAR, T, F, CI, CJ, T1, F1, BEND, STATE = (LANES * n for n in range(14))
#: corners of its cell, next cell, which lane of the tile it is
A, B, C, E, NEXT_I, NEXT_J, LANE = (LANES * n for n in range(14, 21))
WORK = LANES * 21
#: states of a ray
GOES_ON, HIT, ENDS = 0.0, 1.0, 2.0


@fused
def sector_at(wx, wy):
    # number of the sector of a ray that crosses the reference along (wx, wy)
    if abs(wx) >= abs(wy):
        return 0 if wx > 0.0 else 1
    return 2 if wy > 0.0 else 3


@fused
def set_out(x0, y0, x1, y1, P0, P1, P2, turn, box, eye, work):
    # rays of the pixels of a tile and where they pass the box -> number of pixels
    q00, q01, q02, q10, q11, q12 = turn[0, 0], turn[0, 1], turn[0, 2], turn[1, 0], turn[1, 1], turn[1, 2]
    q20, q21, q22, columns, rows, low, high = turn[2, 0], turn[2, 1], turn[2, 2], box[0], box[1], box[2], box[3]
    wide = x1 - x0
    for y in range(y0, y1):
        py, first = y + 0.5, (y - y0) * wide
        a0, a1, a2 = q01 * py + q02, q11 * py + q12, q21 * py + q22
        for k in range(wide):
            px = x0 + k + 0.5
            r0, r1, r2 = q00 * px + a0, q10 * px + a1, q20 * px + a2
            r0 = r0 if abs(r0) > 1e-290 else 1e-290
            r1 = r1 if abs(r1) > 1e-290 else 1e-290
            r2 = r2 if abs(r2) > 1e-290 else 1e-290
            i0, i1, i2 = 1.0 / r0, 1.0 / r1, 1.0 / r2
            n0, f0, n1, f1 = -P0 * i0, (columns - P0) * i0, -P1 * i1, (rows - P1) * i1
            n2, f2 = (low - P2) * i2, (high - P2) * i2
            m0, g0 = (n0, f0) if n0 < f0 else (f0, n0)
            m1, g1 = (n1, f1) if n1 < f1 else (f1, n1)
            m2, g2 = (n2, f2) if n2 < f2 else (f2, n2)
            near = m0 if m0 > m1 else m1
            near = near if near > m2 else m2
            near = near if near > eye else eye
            far = g0 if g0 < g1 else g1
            far = far if far < g2 else g2
            n = first + k
            work[Q0 + n], work[Q1 + n], work[Q2 + n], work[I0 + n], work[I1 + n] = r0, r1, r2, i0, i1
            work[T + n], work[FAR + n] = near, far
    return wide * (y1 - y0)


@fused
def look_up(number, sectors, along, x0, y0, wide, high, table, work):
    # let the rays of one sector start where its table says; along: place of the eye along the sector's rays
    l0, l1, l2, lines = sectors[number, 0], sectors[number, 1], sectors[number, 2], sectors[number, el.LINES]
    b0, b1, b2, bins = sectors[number, 6], sectors[number, 7], sectors[number, 8], sectors[number, el.BINS]
    first, line_step, bin_step = sectors[number, el.FIRST], sectors[number, el.LINE_STEP], sectors[number, el.BIN_STEP]
    inverse = I0 if number < 2 else I1
    for row in range(high):
        py, start = y0 + row + 0.5, row * wide
        line_y, bin_y = l1 * py + l2, b1 * py + b2
        for k in range(wide):
            px, n = x0 + k + 0.5, start + k
            line = np.floor((l0 * px + line_y) * abs(work[inverse + n]))
            place = np.floor(b0 * px + bin_y)
            known = (line >= 0.0) & (line < lines) & (place >= 0.0) & (place < bins)
            known &= sector_at(work[Q0 + n], work[Q1 + n]) == number
            work[A + n] = first + line * line_step + place * bin_step if known else 0.0
    for n in range(wide * high):
        work[B + n] = table[np.uint32(np.int64(work[A + n]))]
    for n in range(wide * high):
        t = (work[B + n] - along) * abs(work[inverse + n])
        work[T + n] = t if t > work[T + n] else work[T + n]


@fused
def enter_cells(count, P0, P1, columns, rows, work):
    # find the first cell of every ray -> how many have a way before them
    going = 0.0
    for n in range(count):
        t = work[T + n]
        i = np.floor(P0 + t * work[Q0 + n] + (NUDGE if work[Q0 + n] > 0.0 else -NUDGE))
        j = np.floor(P1 + t * work[Q1 + n] + (NUDGE if work[Q1 + n] > 0.0 else -NUDGE))
        i = i if i > 0.0 else 0.0
        j = j if j > 0.0 else 0.0
        work[CI + n] = i if i < columns - 1.0 else columns - 1.0
        work[CJ + n] = j if j < rows - 1.0 else rows - 1.0
        state = GOES_ON if t <= work[FAR + n] else ENDS
        work[STATE + n], work[F + n] = state, np.nan
        going += 1.0 if state == GOES_ON else 0.0
    return going


@fused
def gather_heights(count, flat, stride, work):
    # heights at the corners of every ray's cell
    for n in range(count):
        cell = np.uint32(np.int64(work[CJ + n] * stride + work[CI + n]))
        work[A + n], work[B + n] = flat[cell], flat[cell + np.uint32(1)]
    for n in range(count):
        cell = np.uint32(np.int64((work[CJ + n] + 1.0) * stride + work[CI + n]))
        work[C + n], work[E + n] = flat[cell], flat[cell + np.uint32(1)]


@fused
def cross_cells(count, P0, P1, P2, columns, rows, work):
    # see whether rays are hit in their cells, from (T, F) to (T1, F1); where they start is no hit
    for n in range(count):
        q0, q1, q2, i, j = work[Q0 + n], work[Q1 + n], work[Q2 + n], work[CI + n], work[CJ + n]
        a, b, c, e = work[A + n], work[B + n], work[C + n], work[E + n]
        tx = (i + (1.0 if q0 > 0.0 else 0.0) - P0) * work[I0 + n]
        ty = (j + (1.0 if q1 > 0.0 else 0.0) - P1) * work[I1 + n]
        t0, far, f0 = work[T + n], work[FAR + n], work[F + n]
        t1 = tx if tx < ty else ty
        t1 = t1 if t1 < far else far
        across, down, twist = b - a, c - a, (a - b) - (c - e)
        p, q = P0 + t0 * q0 - i, P1 + t0 * q1 - j
        f0 = f0 if f0 == f0 else P2 + t0 * q2 - (a + p * across + q * (down + p * twist))
        p, q = P0 + t1 * q0 - i, P1 + t1 * q1 - j
        f1 = P2 + t1 * q2 - (a + p * across + q * (down + p * twist))
        way = t1 - t0
        bend = -twist * (q0 * way) * (q1 * way)
        slope = f1 - f0 - bend
        dips = (bend * f0 > 0.0) & (slope * f0 < 0.0) & (abs(slope) < 2.0 * abs(bend))
        dips &= slope * slope >= 4.0 * bend * f0
        i += (1.0 if q0 > 0.0 else -1.0) if tx < ty else 0.0
        j += 0.0 if tx < ty else (1.0 if q1 > 0.0 else -1.0)
        ends = (t1 >= far) | (i < 0.0) | (j < 0.0) | (i >= columns) | (j >= rows)
        state = HIT if ((f0 * f1 <= 0.0) & (f0 != 0.0)) | dips else (ENDS if ends else GOES_ON)
        going = work[STATE + n] == GOES_ON
        work[STATE + n] = state if going else work[STATE + n]
        work[F + n] = f0 if going else work[F + n]
        work[T1 + n] = t1 if going else work[T1 + n]
        work[F1 + n] = f1 if going else work[F1 + n]
        work[BEND + n] = bend if going else work[BEND + n]
        work[NEXT_I + n], work[NEXT_J + n] = i, j


@fused
def step_on(count, work):
    # rays that go on enter their next cells
    for n in range(count):
        going = work[STATE + n] == GOES_ON
        work[T + n] = work[T1 + n] if going else work[T + n]
        work[F + n] = work[F1 + n] if going else work[F + n]
        work[CI + n] = work[NEXT_I + n] if going else work[CI + n]
        work[CJ + n] = work[NEXT_J + n] if going else work[CJ + n]


@fused
def leave_behind(count, work, late):
    # copy the rays of a tile that go on to the late ones -> how many they are
    kept = 0
    for n in range(count):
        late[LANE + kept] = n
        kept += 1 if work[STATE + n] == GOES_ON else 0
    for k in range(kept):
        n = np.uint32(late[LANE + k])
        late[Q0 + k], late[Q1 + k], late[Q2 + k] = work[Q0 + n], work[Q1 + n], work[Q2 + n]
        late[I0 + k], late[I1 + k], late[FAR + k] = work[I0 + n], work[I1 + n], work[FAR + n]
        late[T + k], late[F + k], late[CI + k], late[CJ + k] = work[T + n], work[F + n], work[CI + n], work[CJ + n]
        late[STATE + k] = GOES_ON
    return kept


@fused
def bring_back(count, late, work):
    # tell the tile what came of its late rays that are done; the others move up -> how many they are
    kept = 0
    for n in range(count):
        state, lane = late[STATE + n], np.uint32(late[LANE + n])
        if state == HIT:
            work[STATE + lane], work[T + lane], work[T1 + lane] = HIT, late[T + n], late[T1 + n]
            work[F + lane], work[F1 + lane], work[BEND + lane] = late[F + n], late[F1 + n], late[BEND + n]
            work[CI + lane], work[CJ + lane] = late[CI + n], late[CJ + n]
        late[Q0 + kept], late[Q1 + kept], late[Q2 + kept] = late[Q0 + n], late[Q1 + n], late[Q2 + n]
        late[I0 + kept], late[I1 + kept], late[FAR + kept] = late[I0 + n], late[I1 + n], late[FAR + n]
        late[T + kept], late[F + kept], late[CI + kept] = late[T + n], late[F + n], late[CI + n]
        late[CJ + kept], late[LANE + kept], late[STATE + kept] = late[CJ + n], lane, state
        kept += 1 if state == GOES_ON else 0
    return kept


@fused
def advance(count, flat, stride, P0, P1, P2, columns, rows, work):
    # take rays through some cells
    for _ in range(STRIDE):
        gather_heights(count, flat, stride, work)
        cross_cells(count, P0, P1, P2, columns, rows, work)
        step_on(count, work)


@fused
def meet(count, work):
    # camera depth at which every ray of a tile is hit, inf for none, in place of T
    for n in range(count):
        f0, bend = work[F + n], work[BEND + n]
        slope = work[F1 + n] - f0 - bend
        turn = 1.0 if f0 >= 0.0 else -1.0
        f, a, b = f0 * turn, bend * turn, slope * turn
        square = b * b - 4.0 * a * f
        wide = math.sqrt(square if square > 0.0 else 0.0)
        over, under = b + wide if b > 0.0 else 2.0 * f, -2.0 * a if b > 0.0 else wide - b
        s = over / under if f > 0.0 else 0.0
        s = s if s < 1.0 else 1.0
        t = work[T + n] + (s if s > 0.0 else 0.0) * (work[T1 + n] - work[T + n])
        work[T + n] = t if work[STATE + n] == HIT else np.inf


@kernel
def cast_heights(flat, stride, nodes, meta, grid, start, turn, box, eye, sectors, table, base, parts, depth, ids):
    # flat (H * stride,) f32 heights, NaN = hole; nodes, meta: see quadtree; grid (2,): lowest depth, depth per step;
    # start (4,), turn (4, 3): parallel rays; box: columns, rows, least d,
    # greatest d; eye: camera depth that still belongs to the eye; sectors, table: see epipolar_sweep;
    # depth (h, w) f32 and ids (h, w) u32 are lowered in place; a hit's id is base + its cell
    picture_rows, picture_columns = depth.shape
    tiles_x, tiles_y = -(-picture_columns // TILE_X), -(-picture_rows // TILE_Y)
    for part in prange(parts):
        work, late = np.empty(WORK), np.empty(WORK)
        P0, P1, P2 = start[0], start[1], start[2]
        columns, rows = box[0], box[1]
        for tile in range(np.int64(part), tiles_x * tiles_y, parts):
            y0, x0 = (tile // tiles_x) * TILE_Y, (tile % tiles_x) * TILE_X
            y1, x1 = min(y0 + TILE_Y, picture_rows), min(x0 + TILE_X, picture_columns)
            count = set_out(x0, y0, x1, y1, P0, P1, P2, turn, box, eye, work)
            for number in range(4):
                if sectors[number, el.USED] > 0.0 and crosses(number, x0, y0, x1, y1, turn):
                    along = P0 if number < 2 else P1
                    if number & 1:
                        along = (columns if number < 2 else rows) - along
                    look_up(number, sectors, along, x0, y0, x1 - x0, y1 - y0, table, work)
            if enter_cells(count, P0, P1, columns, rows, work) == 0.0:
                continue
            advance(count, flat, stride, P0, P1, P2, columns, rows, work)
            going, passed = leave_behind(count, work, late), STRIDE
            while going > 0 and passed < PATIENCE:
                advance(going, flat, stride, P0, P1, P2, columns, rows, late)
                going, passed = bring_back(going, late, work), passed + STRIDE
            for n in range(going):
                t0, t1, f0, f1, bend, i, j = walk(
                    flat, stride, nodes, meta, grid, P0, P1, P2, late[Q0 + n], late[Q1 + n], late[Q2 + n],
                    late[I0 + n], late[I1 + n], late[T + n], late[FAR + n], late[F + n], int(late[CI + n]),
                    int(late[CJ + n]), columns, rows,
                )  # fmt: skip
                lane = int(late[LANE + n])
                work[STATE + lane] = HIT if i >= 0 else ENDS
                work[T + lane], work[T1 + lane], work[F + lane], work[F1 + lane] = t0, t1, f0, f1
                work[BEND + lane], work[CI + lane], work[CJ + lane] = bend, i, j
            meet(count, work)
            enter_hits(x0, y0, x1 - x0, y1 - y0, columns, base, work, depth, ids)


@fused
def enter_hits(x0, y0, wide, high, columns, base, work, depth, ids):
    # a hit replaces another when it is nearer, or as near with a lesser number
    for row in range(high):
        y, start = y0 + row, row * wide
        for k in range(wide):
            t, x = np.float32(work[T + start + k]), x0 + k
            number = np.uint32(base + np.int64(work[CJ + start + k] * columns + work[CI + start + k]))
            if t < depth[y, x] or (t == depth[y, x] and t < np.inf and number < ids[y, x]):
                depth[y, x], ids[y, x] = t, number


@fused
def crosses(number, x0, y0, x1, y1, turn):
    # may a ray of the tile belong to the sector?
    for corner in range(4):
        x, y = x0 if corner & 1 else x1, y0 if corner & 2 else y1
        wx, wy = turn[0, 0] * x + turn[0, 1] * y + turn[0, 2], turn[1, 0] * x + turn[1, 1] * y + turn[1, 2]
        along = wx if number < 2 else wy
        if (-along if number & 1 else along) > 0.0:
            return True
    return False


@fused
def walk(
    flat, stride, nodes, meta, grid, P0, P1, P2, q0, q1, q2, i0, i1, t0, far, F0, i, j, columns, rows
):  # fmt: skip
    # one ray from (t0, F0) in cell (i, j) on, over blocks of cells that it passes above or below
    # -> (t0, t1, F0, F1, A, i, j) of the cell where it is hit, i = -1 for none
    ai, aj = 1 if q0 > 0.0 else 0, 1 if q1 > 0.0 else 0
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
                way = t1 - t0
                A = -twist * (q0 * way) * (q1 * way)
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
