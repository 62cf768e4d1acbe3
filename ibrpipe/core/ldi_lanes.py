"""Up to 64 rays that walk one pyramid together, in short loops without branches that compilers turn into SIMD code.

Source: gong-yang, sec. 5.1 (children in ray order, a block whose depth range the ray misses is stepped over).
All numbers of the lanes stand in one float32 buffer, one block of `LANES` each. Kept when lanes are compacted:
start (U0, V0, W0) and way (DU, DV, DW) over s in [0, 1], in cells, cells and bound steps; IU, IV = 1/DU, 1/DV (1e30
where the ray stands still); S where the ray is; CI, CJ the cell that it is in; LE level, SZ = 2^LE; ID its pixel.
Scratch: EX where the ray leaves the block, UP 1 if it thereby leaves the parent block, NI, NJ the cell that it enters;
BI, BJ the block; NE, FA the ray's depth range in the block; LO, HI the block's own.
"""

from __future__ import annotations

import numpy as np

from ibrpipe.core.jit import fused, helper

LANES = 64
GROUP = 8  # lanes that a loop takes at a time; lanes between the number in use and the next multiple must be done
KEPT = 14
U0, V0, W0, DU, DV, DW, IU, IV, S, CI, CJ, LE, SZ, ID = (LANES * k for k in range(KEPT))
EX, UP, NI, NJ, BI, BJ, NE, FA, LO, HI = (LANES * (KEPT + k) for k in range(10))
FLOATS = (KEPT + 10) * LANES

ZERO, HALF, ONE, TWO = np.float32(0.0), np.float32(0.5), np.float32(1.0), np.float32(2.0)
PAD = np.float32(0.25)  # bound steps by which a ray's depth range is widened against rounding
WAITING, DONE = (
    np.float32(-1.0),
    np.float32(-2.0),
)  # levels of lanes that stand before a cell's surface, that are through


@helper
def whole_groups(n):
    return (n + GROUP - 1) // GROUP * GROUP


@helper
def find_exits(f, n):
    # where each of the first n lanes leaves its block, what cell it then enters, its depth range until then
    for k in range(whole_groups(n)):
        size = f[SZ + k]
        shrink = ONE / size
        bi, bj = np.float32(np.int32(f[CI + k] * shrink)), np.float32(np.int32(f[CJ + k] * shrink))
        right = ONE if f[IU + k] > ZERO else ZERO
        below = ONE if f[IV + k] > ZERO else ZERO
        plane_u, plane_v = (bi + right) * size, (bj + below) * size
        su, sv = (plane_u - f[U0 + k]) * f[IU + k], (plane_v - f[V0 + k]) * f[IV + k]
        leave = su if su < sv else sv
        leave = leave if leave > f[S + k] else f[S + k]
        leave = leave if leave < ONE else ONE
        stay_u, stay_v = f[U0 + k] + leave * f[DU + k], f[V0 + k] + leave * f[DV + k]
        low_u, low_v = bi * size, bj * size
        high_u, high_v = low_u + size - ONE, low_v + size - ONE
        stay_u = stay_u if stay_u > low_u else low_u
        stay_v = stay_v if stay_v > low_v else low_v
        stay_u, stay_v = np.float32(np.int32(stay_u)), np.float32(np.int32(stay_v))
        stay_u = stay_u if stay_u < high_u else high_u
        stay_v = stay_v if stay_v < high_v else high_v
        cross_u = plane_u + right - ONE
        cross_v = plane_v + below - ONE
        f[NI + k] = cross_u if su < sv else stay_u
        f[NJ + k] = stay_v if su < sv else cross_v
        odd_u = bi - TWO * np.float32(np.int32(bi * HALF))
        odd_v = bj - TWO * np.float32(np.int32(bj * HALF))
        up_u = ONE if odd_u == right else ZERO
        up_v = ONE if odd_v == below else ZERO
        f[UP + k] = up_u if su < sv else up_v
        f[EX + k] = leave
        f[BI + k] = bi
        f[BJ + k] = bj
        wa, wb = f[W0 + k] + f[S + k] * f[DW + k], f[W0 + k] + leave * f[DW + k]
        f[NE + k] = (wa if wa < wb else wb) - PAD
        f[FA + k] = (wa if wa > wb else wb) + PAD


@helper
def fetch_bounds(f, n, nodes, meta):
    for k in range(n):
        level = int(f[LE + k])
        level = level if level > 0 else 0
        node = nodes[meta[level, 0] + int(f[BJ + k]) * meta[level, 1] + int(f[BI + k])]
        f[LO + k] = np.float32(np.int32(node & np.uint32(0xFFFF)))
        f[HI + k] = np.float32(np.int32(node >> np.uint32(16)))


@helper
def choose_moves(f, n, top, last_u, last_v):
    # lanes that miss their block's depths step over it, the others descend; last_u, last_v: the last cell
    for k in range(whole_groups(n)):
        level, size, up, leave = f[LE + k], f[SZ + k], f[UP + k], f[EX + k]
        low, high, near, far = f[LO + k], f[HI + k], f[NE + k], f[FA + k]
        s, ci, cj, ni, nj = f[S + k], f[CI + k], f[CJ + k], f[NI + k], f[NJ + k]
        high = high if low <= high else np.float32(-9.0)
        apart = ONE if near > high else ZERO
        apart = ONE if far < low else apart
        up = up if level < top else ZERO
        over = level + up
        grown = size + up * size
        over = DONE if leave >= ONE else over
        over = DONE if ni < ZERO else over
        over = DONE if nj < ZERO else over
        over = DONE if ni > last_u else over
        over = DONE if nj > last_v else over
        step = over if apart > ZERO else level - ONE
        grown = grown if apart > ZERO else size * HALF
        step = level if level < ZERO else step
        apart = ZERO if level < ZERO else apart
        f[S + k] = s + apart * (leave - s)  # products rather than choices: masked stores are slow
        f[CI + k] = ci + apart * (ni - ci)
        f[CJ + k] = cj + apart * (nj - cj)
        f[LE + k] = step
        f[SZ + k] = size if step < ZERO else grown


@helper
def count_level(f, n, level):
    count = ZERO
    for k in range(n):
        count += ONE if f[LE + k] == level else ZERO
    return int(count)


@fused
def pass_cell(f, k, top, last_u, last_v):
    # lane k, which waited before a cell, has missed its surface: step over the cell
    outside = f[NI + k] < ZERO or f[NJ + k] < ZERO or f[NI + k] > last_u or f[NJ + k] > last_v
    if outside or f[EX + k] >= ONE:
        f[LE + k] = DONE
        return
    up = f[UP + k] if top > ZERO else ZERO
    f[S + k], f[CI + k], f[CJ + k] = f[EX + k], f[NI + k], f[NJ + k]
    f[LE + k], f[SZ + k] = up, ONE + up


@helper
def drop_done(f, n):
    # move the lanes that are not done to the front, mark the rest of the last group as done -> their number
    m = 0
    for k in range(n):
        if f[LE + k] != DONE:
            if m < k:
                for part in range(KEPT):
                    f[part * LANES + m] = f[part * LANES + k]
            m += 1
    close_group(f, m)
    return m


@helper
def close_group(f, n):
    # mark the lanes from n to the end of the last group as done
    for k in range(n, whole_groups(n)):
        f[LE + k], f[SZ + k] = DONE, ONE
        f[CI + k], f[CJ + k] = ZERO, ZERO
