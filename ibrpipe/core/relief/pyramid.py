"""Min/max pyramid of a height field whose levels are found by arithmetic alone, so that vector lanes can fetch them.

Cells lie between four texel centres. Both sides of the grid of cells are padded to a multiple of 2^L; the nodes of the
coarsest level L come first, each finer level after it, so level l begins at ``top * (4^(L - l) - 1) / 3`` with `top`
the number of nodes of level L. Bounds are packed as in :mod:`ibrpipe.core.ldi.quadtree`: ``least | greatest << 16`` in
steps of the padded depth range, rounded outward; padding and cells without surface are `EMPTY`.

Symbols: ``plan = (rows, columns, padded rows, padded columns, levels L)``.
"""

from __future__ import annotations

import numpy as np
from numba import prange

from ibrpipe.core.jit import inlined, kernel
from ibrpipe.core.ldi.quadtree import EMPTY, pack_bounds

#: coarsest level: blocks of 64 x 64 cells
LEVELS = 6
#: sum of powers of four below 4^k is THIRDS & (4^k - 1)
THIRDS = 0x55555555


def plan_blocks(rows: int, columns: int) -> np.ndarray:
    """Return the plan (5,) int64 for a grid of `rows` x `columns` cells."""
    levels = 0
    while levels < LEVELS and max(rows, columns) > 2**levels:
        levels += 1
    size = 2**levels
    return np.array([rows, columns, -(-rows // size) * size, -(-columns // size) * size, levels], np.int64)


def count_nodes(plan: np.ndarray) -> int:
    """Return how many nodes the pyramid of a plan has."""
    top = int(plan[2] * plan[3]) >> (2 * int(plan[4]))
    return top * ((4 ** (int(plan[4]) + 1) - 1) // 3)


@inlined
def first_node(level, plan):
    # index of the first node of a level
    top = (plan[2] * plan[3]) >> (2 * plan[4])
    return top * (THIRDS & ((1 << (2 * (plan[4] - level))) - 1))


@kernel
def pack_cells(height, low, scale, gap, plan, out):
    # height (H, W) f32, NaN = hole -> level 0 of out (M,) u32; a cell whose corners differ by more than gap is a hole
    first = first_node(0, plan)
    for j in prange(plan[2]):
        for i in range(plan[3]):
            packed = np.uint32(EMPTY)
            if j < plan[0] and i < plan[1]:
                a, b, c, e = height[j, i], height[j, i + 1], height[j + 1, i], height[j + 1, i + 1]
                near, far = min(min(a, b), min(c, e)), max(max(a, b), max(c, e))
                whole = (a + b) + (c + e)
                if whole == whole and far - near <= gap:
                    packed = pack_bounds(float(near), float(far), low, scale)
            out[first + j * plan[3] + i] = packed


@kernel
def halve_blocks(nodes, level, plan):
    # nodes (M,) u32: fills `level` from level - 1 in place
    first, below = first_node(level, plan), first_node(level - 1, plan)
    rows, columns = plan[2] >> level, plan[3] >> level
    for j in prange(rows):
        for i in range(columns):
            at = below + 4 * j * columns + 2 * i
            p, q, r, s = nodes[at], nodes[at + 1], nodes[at + 2 * columns], nodes[at + 2 * columns + 1]
            mask = np.uint32(0xFFFF)
            least = min(min(p & mask, q & mask), min(r & mask, s & mask))
            greatest = max(max(p >> 16, q >> 16), max(r >> 16, s >> 16))
            nodes[first + j * columns + i] = least | (greatest << np.uint32(16))


def build_pyramid(height: np.ndarray, low: float, scale: float, gap: float) -> tuple[np.ndarray, np.ndarray]:
    """Return (plan, nodes) of a height field (H, W) float32 with H, W >= 2."""
    plan = plan_blocks(height.shape[0] - 1, height.shape[1] - 1)
    nodes = np.empty(count_nodes(plan), np.uint32)
    pack_cells(height, low, scale, gap, plan, nodes)
    for level in range(1, int(plan[4]) + 1):
        halve_blocks(nodes, level, plan)
    return plan, nodes
