"""Depth layers of a relief map as mesh rays search them: padded grids, and pyramids of bounds that know of tiling.

Depth runs from 0 (on the polygon) to 1 (deepest). Cells lie between four texel centres. A tiled map's grid repeats its
first row and column at the end; a map that is cut at its rectangle has its border texels once more on all sides, half a
texel of which belongs to it.

Symbols: ``plan = (rows, columns of cells, levels, wraps, then per level: first node, nodes per row)``; cell coordinates
``x = u * texels across + shift``, y likewise.
"""

from __future__ import annotations

import numpy as np
from numba import prange

from ibrpipe.core.jit import inlined, kernel

#: numbers of a plan before those of its levels
HEAD = 4


def pad_layer(depth: np.ndarray, wraps: bool) -> np.ndarray:
    """Return the grid (R + 1, C + 1) float32 of a layer (H, W): R, C = H, W where it wraps, else one more each."""
    padding = ((0, 1), (0, 1)) if wraps else ((1, 1), (1, 1))
    return np.ascontiguousarray(np.pad(depth, padding, "wrap" if wraps else "edge"), np.float32)


def shift_of(wraps: bool) -> float:
    """Return the cell coordinate of the texture's outer edge."""
    return -0.5 if wraps else 0.5


def plan_levels(rows: int, columns: int, wraps: bool) -> np.ndarray:
    """Return the plan of a grid of `rows` x `columns` cells, int64."""
    levels: list[tuple[int, int]] = []
    first, level = 0, 0
    while True:
        down, across = -(-rows >> level), -(-columns >> level)
        levels.append((first, across))
        first += down * across
        if down == across == 1:
            break
        level += 1
    head = [rows, columns, level, int(wraps)]
    return np.array(head + [number for entry in levels for number in entry], np.int64)


def count_nodes(plan: np.ndarray) -> int:
    """Return how many nodes the pyramid of a plan has: the coarsest level has one."""
    return int(plan[HEAD + 2 * plan[2]]) + 1


@inlined
def _pick(one, other, least):
    return min(one, other) if least else max(one, other)


@kernel
def bound_cells(grid, least, out):
    # grid (R + 1, C + 1) f32 -> least (or greatest) of the corners of each cell, out (M,) f32, level 0
    columns = grid.shape[1] - 1
    for j in prange(grid.shape[0] - 1):
        for i in range(columns):
            up = _pick(grid[j, i], grid[j, i + 1], least)
            out[j * columns + i] = _pick(up, _pick(grid[j + 1, i], grid[j + 1, i + 1], least), least)


@kernel
def bound_blocks(plan, level, least, out):
    # out (M,) f32: fills `level` from level - 1
    below, wide = plan[HEAD + 2 * (level - 1)], plan[HEAD + 2 * (level - 1) + 1]
    first, across = plan[HEAD + 2 * level], plan[HEAD + 2 * level + 1]
    high = (plan[HEAD + 2 * level] - below) // wide
    for j in prange((high + 1) // 2):
        for i in range(across):
            found = out[below + 2 * j * wide + 2 * i]
            for k in range(1, 4):
                y, x = 2 * j + (k >> 1), 2 * i + (k & 1)
                if y < high and x < wide:
                    found = _pick(found, out[below + y * wide + x], least)
            out[first + j * across + i] = found


def build_bounds(grid: np.ndarray, plan: np.ndarray, least: bool) -> np.ndarray:
    """Return the least (or greatest) depths of all blocks of all levels, (M,) float32."""
    out = np.empty(count_nodes(plan), np.float32)
    bound_cells(grid, least, out)
    for level in range(1, int(plan[2]) + 1):
        bound_blocks(plan, level, least, out)
    return out


def slopes(height: np.ndarray, wraps: bool) -> np.ndarray:
    """(H, W, 3) float64: minus the slopes of the heights per texture along u and v, by central differences; 0."""
    padded = np.pad(height.astype(np.float64), 1, "wrap" if wraps else "edge")
    out = np.zeros((*height.shape, 3))
    rows, columns = height.shape
    out[..., 0] = (padded[1:-1, :-2] - padded[1:-1, 2:]) * (0.5 * columns)
    out[..., 1] = (padded[:-2, 1:-1] - padded[2:, 1:-1]) * (0.5 * rows)
    return out
