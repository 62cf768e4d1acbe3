"""Exact nearest hit of every ray with a height field, 32 rays at a time: no feature is stepped over.

A tile of pixels first runs through the pyramid together (:mod:`ibrpipe.core.relief.beam`). Then 8 x 4 rays march
through it in loops without branches: a block whose bounds the ray misses is left at its far edge, one that it may hit
is entered, and when the rays stand before cells that they may hit, the bilinear patches are met (a quadratic,
:mod:`ibrpipe.core.ldi.search`). All this is float32, counted from the group's own corner of the field; on which side of
the surface a ray is, is carried from cell to cell, so that a hit lost between two cells by rounding is found in the
second. Found hits are met once more in float64.

Symbols: A + s B position on the ray, s in [0, 1], (u, v) in cells, d in steps of the pyramid; g(s) = d(s) - surface;
side: sign of g where it is known, 0 = unknown; slots of the lanes' state `buf` at ``slot * PITCH + lane`` are named
below.
"""

from __future__ import annotations

import math

import numpy as np
from numba import prange

from ibrpipe.core.jit import fused, inlined, kernel, ordered
from ibrpipe.core.relief.beam import beam_start, clip_ray, corner_directions
from ibrpipe.core.relief.pyramid import THIRDS

#: rays that march together, and pixels of a tile
ACROSS, DOWN, WIDTH, HEIGHT = 8, 4, 8, 8
LANES, TILE = ACROSS * DOWN, WIDTH * HEIGHT
#: floats between the slots of the lanes' state
PITCH = 64
AU, AV, AD, BU, BV, BD, RU, RV, S, SIZE, SIDE, STATE = range(0, 12 * PITCH, PITCH)
LEAST, GREATEST, NEAR, LENGTH, COLUMN, ROW, TINY, C0, C1, C2, C3, REST, NU, NV = range(12 * PITCH, 26 * PITCH, PITCH)
SLOTS = 26
#: states of a lane
MARCHING, WAITING, HIT, DONE = np.float32(0.0), np.float32(1.0), np.float32(2.0), np.float32(3.0)
#: how far beyond an edge, in cells, the next cell is looked for, at least
NUDGE = np.float32(1e-5)
#: distance from the eye, in cells, that still belongs to the eye where it touches the surface
EYE_CELLS = 1e-5
#: level of the pyramid on which rays set out
FIRST_LEVEL = 2
ZERO, ONE, HALF = np.float32(0.0), np.float32(1.0), np.float32(0.5)


@fused
def set_out(Q_of, start, x0, y0, t, grid, columns, rows, size, buf):
    # clip the rays of a group of pixels to the field's box, from camera depth t on -> first column and row of the group
    low, scale, bottom, top = grid[0], grid[1], grid[2], grid[3]
    first_i, first_j = 0.0, 0.0
    for axis in range(2):
        at = start[axis] + t * (
            Q_of[3 * axis] * (x0 + 0.5 * ACROSS) + Q_of[3 * axis + 1] * (y0 + 0.5 * DOWN) + Q_of[3 * axis + 2]
        )
        if axis == 0:
            first_i = math.floor(min(max(at, 0.0), columns))
        else:
            first_j = math.floor(min(max(at, 0.0), rows))
    for k in range(LANES):
        px, py = x0 + float(k & (ACROSS - 1)) + 0.5, y0 + float(k // ACROSS) + 0.5
        x, y, z, near, length, met = clip_ray(Q_of, start, px, py, t, columns, rows, bottom, top)
        buf[AU + k] = start[0] + near * x - first_i if met else 0.0
        buf[AV + k] = start[1] + near * y - first_j if met else 0.0
        buf[AD + k] = (start[2] + near * z - low) * scale if met else 0.0
        buf[BU + k] = length * x
        buf[BV + k] = length * y
        buf[BD + k] = length * z * scale
        buf[NEAR + k] = near
        buf[REST + k] = near - float(np.float32(near))
        buf[LENGTH + k] = length
        buf[STATE + k] = 0.0 if length >= 0.0 else 3.0
    for k in range(LANES):
        du, dv = buf[BU + k], buf[BV + k]
        buf[RU + k] = ONE / (du if abs(du) > np.float32(1e-20) else np.float32(1e-20))
        buf[RV + k] = ONE / (dv if abs(dv) > np.float32(1e-20) else np.float32(1e-20))
        most = max(abs(du), abs(dv))
        nudge = max(NUDGE, np.float32(3e-7) * most)
        buf[NU + k], buf[NV + k] = nudge if du >= ZERO else -nudge, nudge if dv >= ZERO else -nudge
        buf[TINY + k] = HALF * nudge / max(most, np.float32(1e-20))
    for k in range(LANES):
        buf[S + k] = ZERO
        buf[SIDE + k] = ZERO
        buf[SIZE + k] = size
        buf[COLUMN + k], buf[ROW + k] = ZERO, ZERO
    return np.float32(first_i), np.float32(first_j)


@inlined
def inverse_power(size):
    # 1 / size of a power of two, exactly
    return np.uint32(np.uint32(0x7F000000) - np.float32(size).view(np.uint32)).view(np.float32)


@fused
def march(nodes, top, top_size, trusted, stride, last_i, last_j, first_i, first_j, buf):
    # one step of every marching lane -> how many march on. last_i, last_j: last column and row; first_i, first_j:
    # where the group's positions are counted from; top_size: cells along a block of the coarsest level;
    # trusted: cells along the largest blocks that surely hold no hole; all f32
    for k in range(LANES):
        s, size = buf[S + k], buf[SIZE + k]
        u, v = buf[AU + k] + s * buf[BU + k], buf[AV + k] + s * buf[BV + k]
        i = np.floor(u + buf[NU + k]) + first_i
        j = np.floor(v + buf[NV + k]) + first_j
        part = inverse_power(size)
        bi, bj = np.floor(min(max(i, ZERO), last_i) * part), np.floor(min(max(j, ZERO), last_j) * part)
        before = (top_size * part) * (top_size * part) - ONE  # three times the nodes of coarser levels per top node
        first = np.uint32(top * np.uint32(np.int32(before) & np.int32(THIRDS)))
        row = np.uint32(np.uint32(np.int32(bj)) * np.uint32(np.int32(stride * part)))
        node = nodes[np.uint32(first + row + np.uint32(np.int32(bi))) & np.uint32(0x7FFFFFFF)]
        buf[LEAST + k] = np.float32(np.int32(node & np.uint32(0xFFFF)))
        buf[GREATEST + k] = np.float32(np.int32(node >> np.uint32(16)))
        buf[C0 + k], buf[C1 + k] = bi, bj
    marching = ZERO
    for k in range(LANES):
        s, size, du, dv = buf[S + k], buf[SIZE + k], buf[BU + k], buf[BV + k]
        right, down = ONE if du >= ZERO else ZERO, ONE if dv >= ZERO else ZERO
        bi, bj = buf[C0 + k], buf[C1 + k]
        to_u = ((bi + right) * size - first_i - buf[AU + k]) * buf[RU + k]
        to_v = ((bj + down) * size - first_j - buf[AV + k]) * buf[RV + k]
        to_u = to_u if abs(du) > np.float32(1e-12) else np.float32(2.0)
        to_v = to_v if abs(dv) > np.float32(1e-12) else np.float32(2.0)
        to = min(max(min(to_u, to_v), s + buf[TINY + k]), ONE)
        da, db = buf[AD + k] + s * buf[BD + k], buf[AD + k] + to * buf[BD + k]
        least, greatest = buf[LEAST + k], buf[GREATEST + k]
        hole = ONE if least > greatest else ZERO
        over = ONE if min(da, db) - HALF > greatest else ZERO
        past = max(max(over, hole), ONE if max(da, db) + HALF < least else ZERO)
        # leave the block, or enter it, or wait before its cell
        across, forward = bi if to_u < to_v else bj, right if to_u < to_v else down
        odd = across - np.float32(2.0) * np.floor(across * HALF)
        larger = min(size * (np.float32(2.0) if odd == forward else ONE), top_size)
        new_size = larger if past > ZERO else max(size * HALF, ONE)
        new_side = (ONE if over > ZERO else -ONE) * (ONE - hole) * (ONE if size <= trusted else ZERO)
        new_side = new_side if past > ZERO else buf[SIDE + k]
        left = DONE if to >= ONE else MARCHING
        new_state = left if past > ZERO else (WAITING if size == ONE else MARCHING)
        state = buf[STATE + k]
        live = state == MARCHING
        new_state = new_state if live else state
        buf[S + k] = (to if past > ZERO else s) if live else s
        buf[SIZE + k] = new_size if live else size
        buf[SIDE + k] = new_side if live else buf[SIDE + k]
        buf[STATE + k] = new_state
        marching += ONE if new_state == MARCHING else ZERO
    return marching


@fused
def meet_cells(pairs, pitch, low, scale, front, last_i, last_j, first_i, first_j, eye, buf):
    # meet the patch before which each waiting lane stands; eye: least s that counts -> how many lanes march on
    for k in range(LANES):
        s, du, dv = buf[S + k], buf[BU + k], buf[BV + k]
        u, v = buf[AU + k] + s * du, buf[AV + k] + s * dv
        i = np.floor(u + buf[NU + k]) + first_i
        j = np.floor(v + buf[NV + k]) + first_j
        i, j = min(max(i, ZERO), last_i), min(max(j, ZERO), last_j)
        row = np.uint32(np.uint32(np.int32(j)) * pitch)
        index = np.uint32(row + np.uint32(np.int32(i))) & np.uint32(0x3FFFFFFF)
        up, below = pairs[index], pairs[np.uint32(index + pitch) & np.uint32(0x3FFFFFFF)]
        buf[C0 + k], buf[C1 + k] = np.int32(up).view(np.float32), np.int32(up >> np.int64(32)).view(np.float32)
        buf[C2 + k], buf[C3 + k] = np.int32(below).view(np.float32), np.int32(below >> np.int64(32)).view(np.float32)
    going = ZERO
    for k in range(LANES):
        s, du, dv, dd = buf[S + k], buf[BU + k], buf[BV + k], buf[BD + k]
        u, v, d = buf[AU + k] + s * du, buf[AV + k] + s * dv, buf[AD + k] + s * dd
        i = np.floor(u + buf[NU + k]) + first_i
        j = np.floor(v + buf[NV + k]) + first_j
        i, j = min(max(i, ZERO), last_i), min(max(j, ZERO), last_j)
        right, down = ONE if du >= ZERO else ZERO, ONE if dv >= ZERO else ZERO
        to_u = (i + right - first_i - buf[AU + k]) * buf[RU + k]
        to_v = (j + down - first_j - buf[AV + k]) * buf[RV + k]
        to_u = to_u if abs(du) > np.float32(1e-12) else np.float32(2.0)
        to_v = to_v if abs(dv) > np.float32(1e-12) else np.float32(2.0)
        to = min(max(min(to_u, to_v), s + buf[TINY + k]), ONE)
        a, b = (buf[C0 + k] - low) * scale, (buf[C1 + k] - low) * scale
        c, e = (buf[C2 + k] - low) * scale, (buf[C3 + k] - low) * scale
        p, q, length = u - (i - first_i), v - (j - first_j), to - s
        along_u, along_v, twist = b - a, c - a, (a - b) + (e - c)
        A = -twist * du * dv
        B = dd - (along_u * du + along_v * dv + twist * (p * dv + q * du))
        C = (d - a) - (along_u * p + along_v * q + twist * p * q)
        square = B * B - np.float32(4.0) * A * C
        root = np.float32(math.sqrt(max(square, ZERO)))
        w = -HALF * (B + (root if B >= ZERO else -root))
        one, two = C / w, w / A
        least = (eye / max(buf[LENGTH + k], np.float32(1e-30))) if buf[NEAR + k] + s == ZERO else ZERO
        good_one = (ONE if one >= least else ZERO) * (ONE if one <= length else ZERO)
        good_two = (ONE if two >= least else ZERO) * (ONE if two <= length else ZERO)
        good_one *= ONE if front * (np.float32(2.0) * A * one + B) >= ZERO else ZERO
        good_two *= ONE if front * (np.float32(2.0) * A * two + B) >= ZERO else ZERO
        one = one if good_one > ZERO else np.float32(4.0)
        two = two if good_two > ZERO else np.float32(4.0)
        found = min(one, two) if square >= ZERO else np.float32(4.0)
        side = buf[SIDE + k]
        changed = (ONE if side * C < ZERO else ZERO) * (ONE if side * front <= ZERO else ZERO)
        found = ZERO if changed > ZERO else found
        end = C + length * (B + length * A)
        hit = found < np.float32(3.0)
        across, forward = i if to_u < to_v else j, right if to_u < to_v else down
        odd = across - np.float32(2.0) * np.floor(across * HALF)
        waiting = buf[STATE + k] == WAITING
        new_state = HIT if hit else (MARCHING if to < ONE else DONE)
        new_state = new_state if waiting else buf[STATE + k]
        buf[S + k] = (s + found if hit else to) if waiting else s
        buf[STATE + k] = new_state
        buf[SIDE + k] = (ONE if end >= ZERO else -ONE) if waiting else side
        buf[SIZE + k] = (np.float32(2.0) if odd == forward else ONE) if waiting else buf[SIZE + k]
        buf[COLUMN + k] = i if waiting else buf[COLUMN + k]
        buf[ROW + k] = j if waiting else buf[ROW + k]
        going += ONE if new_state == MARCHING else ZERO
    return going


@fused
def take_corners(pairs, pitch, buf):
    # corners of the cells in which lanes were hit -> C0 .. C3
    for k in range(LANES):
        row = np.uint32(np.uint32(np.int32(buf[ROW + k])) * pitch)
        index = np.uint32(row + np.uint32(np.int32(buf[COLUMN + k]))) & np.uint32(0x3FFFFFFF)
        up, below = pairs[index], pairs[np.uint32(index + pitch) & np.uint32(0x3FFFFFFF)]
        buf[C0 + k], buf[C1 + k] = np.int32(up).view(np.float32), np.int32(up >> np.int64(32)).view(np.float32)
        buf[C2 + k], buf[C3 + k] = np.int32(below).view(np.float32), np.int32(below >> np.int64(32)).view(np.float32)


@ordered
def settle(start, Q_of, gx, gy, buf, out):
    # camera depth, in float64, of the root nearest to that found of every ray and the patch of its cell -> out (LANES,)
    for k in range(LANES):
        px, py = gx + float(k & (ACROSS - 1)) + 0.5, gy + float(k // ACROSS) + 0.5
        near = float(buf[NEAR + k]) + float(buf[REST + k]) + float(buf[S + k]) * float(buf[LENGTH + k])
        a, b, c, e = float(buf[C0 + k]), float(buf[C1 + k]), float(buf[C2 + k]), float(buf[C3 + k])
        du = Q_of[0] * px + Q_of[1] * py + Q_of[2]
        dv = Q_of[3] * px + Q_of[4] * py + Q_of[5]
        dd = Q_of[6] * px + Q_of[7] * py + Q_of[8]
        u, v = start[0] - float(buf[COLUMN + k]) + near * du, start[1] - float(buf[ROW + k]) + near * dv
        d = start[2] - a + near * dd
        along_u, along_v, twist = b - a, c - a, a - b - c + e
        A = -twist * du * dv
        B = dd - (along_u * du + along_v * dv + twist * (u * dv + v * du))
        C = d - (along_u * u + along_v * v + twist * u * v)
        square = B * B - 4.0 * A * C
        root = math.sqrt(max(square, 0.0))
        w = -0.5 * (B + (root if B >= 0.0 else -root))
        one = C / w
        close = abs(one) * max(abs(du), abs(dv)) < 1.0
        flat = (abs(du) + abs(dv)) == 0.0
        good = (square >= 0.0) & (close | flat)
        out[k] = near + one if good else near


@kernel
def search_exact(pairs, nodes, plan, grid, start, Q_of, front, whole, window, out, positions):
    # pairs (H * stride - 1,) i64: texel and its right neighbour, overlapping; the others: see
    # relief_linear.search_linear; front: 1 = only hits where d grows count, 0 = all; whole: no cell is a hole
    across = (window[1] - window[0] + WIDTH - 1) // WIDTH
    down = (window[3] - window[2] + HEIGHT - 1) // HEIGHT
    columns, rows = float(plan[1]), float(plan[0])
    last_i, last_j = np.float32(plan[1] - 1), np.float32(plan[0] - 1)
    low, scale, pitch = np.float32(grid[0]), np.float32(grid[1]), np.uint32(grid[4])
    top, top_size = np.uint32((plan[2] * plan[3]) >> (2 * plan[4])), np.float32(1 << plan[4])
    stride, first_size = np.float32(plan[3]), np.float32(1 << min(plan[4], FIRST_LEVEL))
    only, trusted = np.float32(front), top_size if whole else ONE
    for tile in prange(across * down):
        buf = np.empty(SLOTS * PITCH, np.float32)
        directions = np.empty(12)
        depths = np.empty(LANES)
        x0 = float(window[0] + (np.int64(tile) % across) * WIDTH)
        y0 = float(window[2] + (np.int64(tile) // across) * HEIGHT)
        corner_directions(Q_of, x0, y0, x0 + WIDTH, y0 + HEIGHT, directions)
        t, end = beam_start(nodes, plan, grid[0], grid[1], grid[2], grid[3], start, directions, 3)
        if not t <= end:
            continue
        fast = max(abs(directions[0]), abs(directions[1]))
        eye = np.float32(EYE_CELLS / max(fast, 1e-30))
        eye_depth = 1e-9 / max(fast, 1.0)
        for group in range(TILE // LANES):
            gx, gy = x0 + float(group % (WIDTH // ACROSS) * ACROSS), y0 + float(group // (WIDTH // ACROSS) * DOWN)
            first_i, first_j = set_out(Q_of, start, gx, gy, t, grid, columns, rows, first_size, buf)
            going = ONE
            while going > ZERO:
                while going > ZERO:
                    going = march(nodes, top, top_size, trusted, stride, last_i, last_j, first_i, first_j, buf)
                going = meet_cells(pairs, pitch, low, scale, only, last_i, last_j, first_i, first_j, eye, buf)
            take_corners(pairs, pitch, buf)
            settle(start, Q_of, gx, gy, buf, depths)
            for k in range(LANES):
                x, y = np.int64(gx) + (k & (ACROSS - 1)), np.int64(gy) + k // ACROSS
                if buf[STATE + k] == HIT and x < window[1] and y < window[3]:
                    depth = depths[k]
                    if eye_depth < depth < out[y, x]:
                        out[y, x] = depth
                        if positions.shape[0] > 0:
                            for axis in range(2):
                                rate = Q_of[3 * axis] * (x + 0.5) + Q_of[3 * axis + 1] * (y + 0.5) + Q_of[3 * axis + 2]
                                positions[y, x, axis] = start[axis] + depth * rate
