"""Where the rays of one tile can first meet a field in a parallel frame: the tile walks the pyramid as one beam.

At camera depth t the beam of a tile covers the box ``P + t * (C - E) .. P + t * (C + E)`` in field coordinates, C the
direction of its middle and E half its spread; both ends are linear in t. The beam walks over windows of blocks that
hold it, and stops where the depths of a window that is about as wide as the beam itself meet the beam's.
"""

from __future__ import annotations

import numpy as np

from ibrpipe.core.jit import helper
from ibrpipe.core.rays import clip_side

#: steps after which the beam is content with what it knows
PATIENCE = 96


@helper
def widest_move(start, center, spread, low, high, count, near, far):
    # t until which the beam stays in cells [low, high); an end at the grid's border never ends it
    until = far
    slow, fast = center - spread, center + spread
    if low > 0.0 and slow < 0.0:
        until = min(until, (low - start) / slow)
    if high < count and fast > 0.0:
        until = min(until, (high - start) / fast)
    return max(until, near)


@helper
def span_blocks(start, center, spread, t, level, count):
    # first and last block of the level that hold the beam at t, and one more on the sides that it moves to
    slow, fast = center - spread, center + spread
    first = int(min(max(start + t * slow, 0.0), count - 1.0)) >> level
    last = int(min(max(start + t * fast, 0.0), count - 1.0)) >> level
    most = (int(count) - 1) >> level
    if slow < 0.0 and first > 0:
        first -= 1
    if fast > 0.0 and last < most:
        last += 1
    return first, last


@helper
def window_bounds(nodes, first_node, stride, first_u, last_u, first_v, last_v):
    least, greatest = np.uint32(0xFFFF), np.uint32(0)
    for j in range(first_v, last_v + 1):
        for i in range(first_u, last_u + 1):
            node = nodes[first_node + j * stride + i]
            least, greatest = min(least, node & np.uint32(0xFFFF)), max(greatest, node >> np.uint32(16))
    return float(least), float(greatest)


@helper
def enter_field(start, center, spread, box, far):
    # (t, t) between which the beam may be inside the box, at most `far`; start, center, spread: (u, v, d) triples
    near = 0.0
    for k in range(3):
        low, high = (0.0, box[k]) if k < 2 else (box[2], box[3])
        near, far = clip_side(start[k] - low, center[k] + spread[k], near, far)
        near, far = clip_side(high - start[k], spread[k] - center[k], near, far)
    return near, far


@helper
def walk_beam(corner, side, start, turn, box, grid, nodes, meta, far):
    # corner: first pixel x, y -> (t, level): no ray of the tile meets the field before t; t = inf: none before `far`
    x, y, half = corner[0] + 0.5 * side, corner[1] + 0.5 * side, 0.5 * side - 0.5
    c0 = turn[0, 0] * x + turn[0, 1] * y + turn[0, 2]
    c1 = turn[1, 0] * x + turn[1, 1] * y + turn[1, 2]
    c2 = turn[2, 0] * x + turn[2, 1] * y + turn[2, 2]
    e0 = (abs(turn[0, 0]) + abs(turn[0, 1])) * half
    e1 = (abs(turn[1, 0]) + abs(turn[1, 1])) * half
    e2 = (abs(turn[2, 0]) + abs(turn[2, 1])) * half
    near, far = enter_field(start, (c0, c1, c2), (e0, e1, e2), box, far)
    level, t = len(meta) - 1, near
    if not near <= far:
        return np.inf, level
    for _ in range(PATIENCE):
        size = 1 << level
        i0, i1 = span_blocks(start[0], c0, e0, t, level, box[0])
        j0, j1 = span_blocks(start[1], c1, e1, t, level, box[1])
        until = widest_move(start[0], c0, e0, float(i0 * size), float((i1 + 1) * size), box[0], t, far)
        until = widest_move(start[1], c1, e1, float(j0 * size), float((j1 + 1) * size), box[1], t, until)
        low = min(start[2] + t * (c2 - e2), start[2] + until * (c2 - e2))
        high = max(start[2] + t * (c2 + e2), start[2] + until * (c2 + e2))
        least, greatest = window_bounds(nodes, meta[level, 0], meta[level, 1], i0, i1, j0, j1)
        near_step, far_step = (low - grid[0]) * grid[1] - 0.5, (high - grid[0]) * grid[1] + 0.5
        if least > greatest or near_step > greatest or far_step < least:
            if until >= far:
                return np.inf, level
            t, level = until, min(level + 1, len(meta) - 1)
        elif level > 0 and size > t * max(e0, e1):
            level -= 1
        else:
            break
    return t, level
