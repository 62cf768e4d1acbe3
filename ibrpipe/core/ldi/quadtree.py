"""Min/max depth pyramid over the cells of one field, both bounds packed in 32 bits.

Source: gong-yang, sec. 5.1 (quadtree over the layered depth image, each node the least and the greatest depth of its
block). Depths are counted in steps of 1/65535 of the field's padded depth range, rounded outward, so that a bound
never excludes its surface: ``least | greatest << 16``; a block without surface is `EMPTY` (least > greatest).

Symbols: ``meta[l] = (first index, row stride, rows)`` of level l; level 0 are the cells, the last level is one block.
"""

from __future__ import annotations

import numpy as np
from numba import prange

from ibrpipe.core.jit import inlined, kernel

EMPTY = 0x0000FFFF
STEPS = 65535.0


def plan_levels(rows: int, columns: int) -> np.ndarray:
    """Return `meta` (L, 3) int64 for a grid of `rows` x `columns` cells: first index, row stride, rows per level."""
    levels, first = [], 0
    while True:
        levels.append((first, columns, rows))
        first += rows * columns
        if rows == 1 and columns == 1:
            return np.array(levels, np.int64)
        rows, columns = (rows + 1) // 2, (columns + 1) // 2


@inlined
def pack_bounds(near, far, low, scale):
    # near <= far in depth units; low, scale: depth -> steps. Rounded outward by at least a hundredth of a step
    least = min(max((near - low) * scale - 0.01, 0.0), STEPS)
    greatest = min(max((far - low) * scale + 1.01, 0.0), STEPS)
    return np.uint32(np.int32(least)) | (np.uint32(np.int32(greatest)) << np.uint32(16))


@kernel
def measure_heights(height, out_near, out_far):
    # height (H, W) f32, NaN = hole; out_near, out_far (H,) f32 per row, +inf and -inf where a row is all holes
    for j in prange(height.shape[0]):
        near, far = np.float32(np.inf), np.float32(-np.inf)
        for i in range(height.shape[1]):
            value = height[j, i]
            near = value if value < near else near
            far = value if value > far else far
        out_near[j], out_far[j] = near, far


@kernel
def pack_heights(height, low, scale, out):
    # height (H, W) f32; out ((H - 1) * (W - 1),) u32: bounds of the cells between texel centres
    columns = height.shape[1] - 1
    for j in prange(height.shape[0] - 1):
        for i in range(columns):
            a, b, c, e = height[j, i], height[j, i + 1], height[j + 1, i], height[j + 1, i + 1]
            near = min(min(a, b), min(c, e))
            far = max(max(a, b), max(c, e))
            whole = (a + b) + (c + e)
            packed = pack_bounds(float(near), float(far), low, scale) if whole == whole else np.uint32(EMPTY)
            out[j * columns + i] = packed


@kernel
def halve_bounds(nodes, meta, level):
    # nodes (M,) u32: fills level from level - 1 in place
    below, below_stride, below_rows = meta[level - 1]
    first, stride, rows = meta[level]
    for j in prange(rows):
        for i in range(stride):
            least, greatest = np.uint32(EMPTY), np.uint32(0)
            for c in range(4):
                y, x = 2 * j + (c >> 1), 2 * i + (c & 1)
                if y < below_rows and x < below_stride:
                    node = nodes[below + y * below_stride + x]
                    least = min(least, node & np.uint32(0xFFFF))
                    greatest = max(greatest, node >> np.uint32(16))
            nodes[first + j * stride + i] = least | (greatest << np.uint32(16))


def build_levels(nodes: np.ndarray, meta: np.ndarray) -> None:
    """Fill all levels above level 0 of `nodes` in place."""
    for level in range(1, len(meta)):
        halve_bounds(nodes, meta, level)
