"""Slices from front to back, and which tiles of the picture they touch."""

from __future__ import annotations

import numpy as np

from ibrpipe.core.jit import serial

#: pixels along a side of a tile
TILE = 32
_DIGITS = 11


@serial
def sort_depths(depths, order):
    # depths (N,) f32, positive -> order (N,) i64: indices of ascending depth, equal ones as they came
    # radix sort by the bits of the floats, whose order is that of their values
    keys = depths.view(np.uint32)
    count = len(keys)
    spare = np.empty(count, np.int64)
    for i in range(count):
        order[i] = i
    for turn in range(3):
        shift = np.uint32(_DIGITS * turn)
        starts = np.zeros((1 << _DIGITS) + 1, np.int64)
        for i in range(count):
            starts[((keys[i] >> shift) & np.uint32((1 << _DIGITS) - 1)) + 1] += 1
        for digit in range(1 << _DIGITS):
            starts[digit + 1] += starts[digit]
        for i in range(count):
            digit = (keys[order[i]] >> shift) & np.uint32((1 << _DIGITS) - 1)
            spare[starts[digit]] = order[i]
            starts[digit] += 1
        for i in range(count):
            order[i] = spare[i]


@serial
def count_tiles(order, pixels, columns, starts):
    # order (N,) i64, pixels (M, >= 4) i64: x0, x1, y0, y1 (exclusive) -> starts (T + 1,) i64: first entry of each tile
    starts[:] = 0
    for i in order:
        if pixels[i, 0] < pixels[i, 1]:
            for row in range(pixels[i, 2] // TILE, (pixels[i, 3] - 1) // TILE + 1):
                for column in range(pixels[i, 0] // TILE, (pixels[i, 1] - 1) // TILE + 1):
                    starts[row * columns + column + 1] += 1
    for tile in range(len(starts) - 1):
        starts[tile + 1] += starts[tile]
    return starts[-1]


@serial
def fill_tiles(order, pixels, columns, starts, items):
    # -> items (E,) i64: what each tile shows, in the given order
    at = starts.copy()
    for i in order:
        if pixels[i, 0] < pixels[i, 1]:
            for row in range(pixels[i, 2] // TILE, (pixels[i, 3] - 1) // TILE + 1):
                for column in range(pixels[i, 0] // TILE, (pixels[i, 1] - 1) // TILE + 1):
                    items[at[row * columns + column]] = i
                    at[row * columns + column] += 1
