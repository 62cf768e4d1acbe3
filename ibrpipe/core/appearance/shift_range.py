"""What colours a small shift of a picture could bring to a pixel.

After birchfield1998: there the range of the intensities half a pixel around, along the scan line; here along eight
directions and to a radius of at most one.
"""

from __future__ import annotations

import math

import numpy as np
from numba import prange

from ibrpipe.core.jit import helper, kernel


@helper
def colour_beside(picture, row, column, down, right, channel):
    """Bilinear colour of a pixel's neighbourhood, `down` and `right` (-1 to 1) away; NaN where a corner is missing."""
    step_y, step_x = (1 if down > 0.0 else -1), (1 if right > 0.0 else -1)
    fy, fx = abs(down), abs(right)
    total = 0.0
    for corner in range(4):
        dy, dx = corner // 2, corner % 2
        weight = (fy if dy else 1.0 - fy) * (fx if dx else 1.0 - fx)
        if weight < 1e-9:
            continue
        y, x = row + dy * step_y, column + dx * step_x
        if y < 0 or x < 0 or y >= picture.shape[0] or x >= picture.shape[1]:
            return np.nan
        total += weight * picture[y, x, channel]
    return total


@kernel
def range_around(picture, rows, columns, radius, out_low, out_high):
    """Find the least and the greatest colour of pixels and of the eight points `radius` around them."""
    # picture (H, W, 3) f32, NaN = missing; rows, columns (N,) i64; radius f64, pixels, 0 to 1
    # out_low, out_high (N, 3) f32: range over the points whose colour is known; NaN where the pixel's own is missing
    for i in prange(len(rows)):
        for c in range(3):
            own = picture[rows[i], columns[i], c]
            low, high = own, own
            for octant in range(8 if radius > 0.0 else 0):
                angle = octant * math.pi / 4.0
                down, right = radius * math.sin(angle), radius * math.cos(angle)
                value = colour_beside(picture, rows[i], columns[i], down, right, c)
                if value < low:
                    low = value
                if value > high:
                    high = value
            out_low[i, c], out_high[i, c] = low, high
