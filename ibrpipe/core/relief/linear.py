"""The published search (policarpo2005, sec. 3) in a box over a height field: linear steps, then bisection.

The part of the ray inside the box is walked in equal steps, fewer where a tile of rays falls along the normal (as
policarpo2005 does, sec. 5: in proportion to 1 - cos, here of the tile's most grazing corner); the first sample at or
beyond the surface and its predecessor are halved, heights being bilinear. Sixty-four rays march together in loops
without branches, and the samples that a tile of rays provably takes outside (:mod:`ibrpipe.core.relief.beam`) are not
fetched, so the picture is that of the plain search.

Symbols: A + s B position (u, v, d) on the clipped ray, s in [0, 1]; t = t0 + s (t1 - t0) camera depth; side = +1:
outside is above the heights, -1: below; k sample number.
"""

from __future__ import annotations

import numpy as np
from numba import prange

from ibrpipe.core.jit import fused, inlined, kernel
from ibrpipe.core.relief.beam import beam_start, clip_ray, corner_directions
from ibrpipe.core.relief.pyramid import first_node

#: rays that march together, and pixels of a tile
ACROSS, DOWN, WIDTH, HEIGHT = 8, 8, 16, 16
LANES, TILE = ACROSS * DOWN, WIDTH * HEIGHT
#: floats between the parts of the lanes' state
PITCH = 64
#: least level of the pyramid that samples are skipped by
SKIP_LEVEL = 3


@inlined
def first_of(pair):
    # the float32 in the lower half of a 64-bit word
    return np.uint32(pair & np.uint64(0xFFFFFFFF)).view(np.float32)


@inlined
def second_of(pair):
    # the float32 in the upper half of a 64-bit word
    return np.uint32(pair >> np.uint64(32)).view(np.float32)


@inlined
def bilinear_at(pairs, stride, u, v, last_i, last_j):
    # height at (u, v) cells, f32; pairs: see search_linear
    fi = np.float32(np.int32(min(max(u, np.float32(0.0)), last_i)))
    fj = np.float32(np.int32(min(max(v, np.float32(0.0)), last_j)))
    index = np.uint32(np.int32(fj)) * stride + np.uint32(np.int32(fi))
    above, below = np.uint64(pairs[index]), np.uint64(pairs[index + stride])
    a, b, c, e = first_of(above), second_of(above), first_of(below), second_of(below)
    p, q = u - fi, v - fj
    upper, lower = a + (b - a) * p, c + (e - c) * p
    return upper + (lower - upper) * q


@fused
def clip_lanes(Q_of, start, x0, y0, t, bottom, top, columns, rows, buf):
    # buf (15 * PITCH,) f32: A, B, t0, t1 - t0 of the rays of a group of pixels, t1 - t0 < 0 where the box is missed;
    # s at camera depth t
    for k in range(LANES):
        px, py = x0 + float(k & (ACROSS - 1)) + 0.5, y0 + float(k // ACROSS) + 0.5
        x, y, z, near, length, met = clip_ray(Q_of, start, px, py, 0.0, columns, rows, bottom, top)
        buf[k] = start[0] + near * x if met else 0.0
        buf[PITCH + k] = start[1] + near * y if met else 0.0
        buf[2 * PITCH + k] = start[2] + near * z if met else 0.0
        buf[3 * PITCH + k] = length * x
        buf[4 * PITCH + k] = length * y
        buf[5 * PITCH + k] = length * z
        buf[6 * PITCH + k] = near
        buf[7 * PITCH + k] = length
        buf[8 * PITCH + k] = (t - near) / max(length, 1e-300)


@fused
def skip_samples(nodes, first, level, columns, last_i, last_j, low, step, side, steps, share, buf):
    # move every lane's sample number (slot 8) past samples that are outside because their block of the pyramid is:
    # all those before the ray leaves the block or comes down to its bound -> how many lanes moved
    zero, one, size = np.float32(0.0), np.float32(1.0), np.float32(1 << level)
    unsize = one / size
    high = zero if side > zero else one
    for k in range(LANES):
        s = buf[8 * PITCH + k] * share
        u, v = buf[k] + s * buf[3 * PITCH + k], buf[PITCH + k] + s * buf[4 * PITCH + k]
        i, j = (
            np.uint32(np.int32(min(max(u, zero), last_i) * unsize)),
            np.uint32(np.int32(min(max(v, zero), last_j) * unsize)),
        )
        node = nodes[first + j * columns + i]
        least, greatest = np.float32(np.int32(node & np.uint32(0xFFFF))), np.float32(np.int32(node >> np.uint32(16)))
        buf[9 * PITCH + k] = low + step * (greatest + (least - greatest) * high)
    moved = zero
    for k in range(LANES):
        sample = buf[8 * PITCH + k]
        s = sample * share
        u, v = buf[k] + s * buf[3 * PITCH + k], buf[PITCH + k] + s * buf[4 * PITCH + k]
        d = buf[2 * PITCH + k] + s * buf[5 * PITCH + k]
        fi, fj = (
            np.float32(np.int32(min(max(u, zero), last_i) * unsize)),
            np.float32(np.int32(min(max(v, zero), last_j) * unsize)),
        )
        edge_u = (fi + (one if buf[3 * PITCH + k] >= zero else zero)) * size
        edge_v = (fj + (one if buf[4 * PITCH + k] >= zero else zero)) * size
        leave = min((edge_u - buf[k]) * buf[12 * PITCH + k], (edge_v - buf[PITCH + k]) * buf[13 * PITCH + k])
        bound = buf[9 * PITCH + k] + step * side
        meet = (bound - buf[2 * PITCH + k]) * buf[14 * PITCH + k]
        meet = meet if buf[5 * PITCH + k] * side < zero else steps + one
        to = min(min(leave, meet) - np.float32(0.01), steps)
        to = max(np.float32(np.int32(max(to, zero))), sample) + one
        on = one if (d - bound) * side > zero else zero
        on = on if sample <= steps else zero
        buf[8 * PITCH + k] = sample + (to - sample) * on
        moved += on
    return moved


@inlined
def steps_of(pace, x0, y0):
    # samples of the rays of the tile at (x0, y0); pace: see search_linear
    least = 1.0
    for c in range(4):
        x, y = x0 + WIDTH * (c & 1), y0 + HEIGHT * (c >> 1)
        along = abs(pace[3] * x + pace[4] * y + pace[5])
        square = x * (pace[6] * x + 2.0 * (pace[7] * y + pace[8])) + y * (pace[9] * y + 2.0 * pace[10]) + pace[11]
        least = min(least, along / np.sqrt(max(square, 1e-300)))
    steps = np.int64(np.ceil(pace[0] + (pace[1] - pace[0]) * (1.0 - least) - 1e-6))
    return np.float64(max(min(steps, np.int64(pace[1])), 1))


@kernel
def search_linear(pairs, nodes, plan, grid, start, Q_of, side, pace, window, out, positions):
    # pairs (H * stride - 1,) i64: texel and its right neighbour, overlapping; grid (5,) f64: low, scale, bottom, top,
    # stride; start (3,), Q_of (9,) f64: rays; window (4,) i64: x0, x1, y0, y1 pixels; out (h, w) f32 camera depth,
    # lowered in place where the ray hits nearer; pace (12,) f64: samples along the normal, at grazing angles, and
    # halvings; N (3,) and the upper half of M (6,): a pixel's ray p = (x, y, 1) makes the angle to the normal whose
    # cosine is |N p| / sqrt(p M p); positions (h, w, 2) f64 or (0, 0, 2): hits in cells
    across = (window[1] - window[0] + WIDTH - 1) // WIDTH
    down = (window[3] - window[2] + HEIGHT - 1) // HEIGHT
    columns, rows = float(plan[1]), float(plan[0])
    last_i, last_j = np.float32(columns - 1.0), np.float32(rows - 1.0)
    stride = np.uint32(grid[4])
    side32, bisection_steps = np.float32(side), np.int64(pace[2])
    low, step = np.float32(grid[0]), np.float32(1.0 / grid[1])
    half, one, zero = np.float32(0.5), np.float32(1.0), np.float32(0.0)
    for tile in prange(across * down):
        buf = np.empty(15 * PITCH, np.float32)
        directions = np.empty(12)
        x0 = float(window[0] + (np.int64(tile) % across) * WIDTH)
        y0 = float(window[2] + (np.int64(tile) // across) * HEIGHT)
        steps = steps_of(pace, x0, y0)
        steps32, share = np.float32(steps), np.float32(1.0 / steps)
        corner_directions(Q_of, x0, y0, x0 + WIDTH, y0 + HEIGHT, directions)
        t, end = beam_start(nodes, plan, grid[0], grid[1], grid[2], grid[3], start, directions, 3)
        if not t < end:
            continue
        spacing = (end - t) * max(abs(directions[0]), abs(directions[1])) / steps
        level = min(np.int64(SKIP_LEVEL), plan[4])
        while level < plan[4] and float(1 << level) < 2.0 * spacing:
            level += 1
        first_block = np.uint32(first_node(level, plan))
        block_columns = np.uint32(plan[3] >> level)
        for group in range(TILE // LANES):
            gx, gy = x0 + float(group % (WIDTH // ACROSS) * ACROSS), y0 + float(group // (WIDTH // ACROSS) * DOWN)
            clip_lanes(Q_of, start, gx, gy, t, grid[2], grid[3], columns, rows, buf)
            for k in range(LANES):
                length = buf[7 * PITCH + k]
                skipped = min(max(buf[8 * PITCH + k], -one), one) * steps32
                first = np.float32(np.int32(min(max(skipped - np.float32(0.01), zero), steps32))) + one
                buf[8 * PITCH + k] = first if length > zero else steps32 + one
            for k in range(LANES):
                for axis in range(3):
                    rate = buf[(3 + axis) * PITCH + k] * share
                    buf[(12 + axis) * PITCH + k] = one / (rate if abs(rate) > np.float32(1e-30) else np.float32(1e-30))
            going = one
            while going > zero:
                moved = one
                while moved > zero:
                    moved = skip_samples(
                        nodes, first_block, level, block_columns, last_i, last_j, low, step, side32, steps32, share, buf
                    )
                going = zero
                for k in range(LANES):
                    s = buf[8 * PITCH + k] * share
                    u = buf[k] + s * buf[3 * PITCH + k]
                    v = buf[PITCH + k] + s * buf[4 * PITCH + k]
                    d = buf[2 * PITCH + k] + s * buf[5 * PITCH + k]
                    buf[10 * PITCH + k] = (bilinear_at(pairs, stride, u, v, last_i, last_j) - d) * side32
                for k in range(LANES):
                    outside = one if not (buf[10 * PITCH + k] >= zero) else zero
                    live = one if buf[8 * PITCH + k] <= steps32 else zero
                    on = outside * live
                    buf[8 * PITCH + k] += on
                    going += on
            for k in range(LANES):
                buf[10 * PITCH + k] = (buf[8 * PITCH + k] - one) * share
                buf[11 * PITCH + k] = half * share
            for _ in range(bisection_steps):
                for k in range(LANES):
                    s = buf[10 * PITCH + k] + buf[11 * PITCH + k]
                    u = buf[k] + s * buf[3 * PITCH + k]
                    v = buf[PITCH + k] + s * buf[4 * PITCH + k]
                    d = buf[2 * PITCH + k] + s * buf[5 * PITCH + k]
                    buf[9 * PITCH + k] = (bilinear_at(pairs, stride, u, v, last_i, last_j) - d) * side32
                for k in range(LANES):
                    buf[10 * PITCH + k] += zero if buf[9 * PITCH + k] >= zero else buf[11 * PITCH + k]
                    buf[11 * PITCH + k] *= half
            for k in range(LANES):
                x, y = np.int64(gx) + (k & (ACROSS - 1)), np.int64(gy) + k // ACROSS
                if buf[8 * PITCH + k] <= steps32 and x < window[1] and y < window[3]:
                    s = buf[10 * PITCH + k] + buf[11 * PITCH + k]
                    depth = buf[6 * PITCH + k] + s * buf[7 * PITCH + k]
                    if depth < out[y, x]:
                        out[y, x] = depth
                        if positions.shape[0] > 0:
                            positions[y, x, 0] = buf[k] + s * buf[3 * PITCH + k]
                            positions[y, x, 1] = buf[PITCH + k] + s * buf[4 * PITCH + k]
