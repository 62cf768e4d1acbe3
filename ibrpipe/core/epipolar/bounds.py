"""Bounds of blocks of cells for the epipolar renderer, built in two passes: bands of rows, then what is above them.

The format is that of :mod:`ibrpipe.core.ldi.quadtree`: ``least | greatest << 16`` in steps of the field's depth range,
rounded outward; ``meta[l] = (first index, row stride, rows)``.
"""

from __future__ import annotations

import numpy as np
from numba import prange

from ibrpipe.core.jit import fused, kernel, serial
from ibrpipe.core.ldi.quadtree import EMPTY, pack_bounds

#: levels that are built within a band, and rows of cells of a band
BAND_LEVELS, BAND = 6, 64


@fused
def halve_row(nodes, meta, level, j):
    # fill row j of a level from the level below
    below, below_stride, below_rows = meta[level - 1]
    first, stride, _ = meta[level]
    upper = below + 2 * j * below_stride
    lower = upper + below_stride if 2 * j + 1 < below_rows else upper
    for i in range(stride):
        left, right = 2 * i, min(2 * i + 1, below_stride - 1)
        a, b, c, e = nodes[upper + left], nodes[upper + right], nodes[lower + left], nodes[lower + right]
        mask = np.uint32(65535)
        least = min(min(a & mask, b & mask), min(c & mask, e & mask))
        greatest = max(max(a >> np.uint32(16), b >> np.uint32(16)), max(c >> np.uint32(16), e >> np.uint32(16)))
        nodes[first + j * stride + i] = np.uint32(least | (greatest << np.uint32(16)))


@fused
def halve_band(nodes, meta, band):
    # fill levels 1 to BAND_LEVELS above one band of level 0
    for level in range(1, min(BAND_LEVELS + 1, len(meta))):
        rows = BAND >> level
        for j in range(band * rows, min((band + 1) * rows, meta[level, 2])):
            halve_row(nodes, meta, level, j)


@kernel
def bound_heights(height, low, scale, meta, nodes):
    # height (H, W) f32, NaN = hole; levels 0 to BAND_LEVELS of nodes are filled
    columns, rows, zero = height.shape[1] - 1, height.shape[0] - 1, np.float32(0.0)
    for band_number in prange(-(-rows // BAND)):
        band = np.int64(band_number)
        for j in range(band * BAND, min((band + 1) * BAND, rows)):
            for i in range(columns):
                a, b, c, e = height[j, i], height[j, i + 1], height[j + 1, i], height[j + 1, i + 1]
                p, q, r, s = a if a < b else b, c if c < e else e, b if a < b else a, e if c < e else c
                near, far = p if p < q else q, r if r > s else s
                whole = (a + b) + (c + e)
                near, far = near if whole == whole else zero, far if whole == whole else zero
                packed = pack_bounds(float(near), float(far), low, scale)
                nodes[j * columns + i] = packed if whole == whole else np.uint32(EMPTY)
        halve_band(nodes, meta, band)


@kernel
def bound_patches(starts, near, far, low, scale, meta, nodes):
    # starts (cells + 1,) i64 first patch of every cell; near, far (P,) f64; levels 0 to BAND_LEVELS are filled
    columns, rows = meta[0, 1], meta[0, 2]
    for band_number in prange(-(-rows // BAND)):
        band = np.int64(band_number)
        for cell in range(band * BAND * columns, min((band + 1) * BAND, rows) * columns):
            least, greatest = np.inf, -np.inf
            for patch in range(starts[cell], starts[cell + 1]):
                least, greatest = min(least, near[patch]), max(greatest, far[patch])
            empty = starts[cell] == starts[cell + 1]
            nodes[cell] = np.uint32(EMPTY) if empty else pack_bounds(least, greatest, low, scale)
        halve_band(nodes, meta, band)


@serial
def bound_above(nodes, meta):
    # fill the levels above BAND_LEVELS
    for level in range(BAND_LEVELS + 1, len(meta)):
        for j in range(meta[level, 2]):
            halve_row(nodes, meta, level, j)
