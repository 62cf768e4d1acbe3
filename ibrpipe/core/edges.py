"""Pixels of a picture of depths that show an edge.

An edge lies between two adjacent pixels where inverse depth, which is straight along a row of pixels on a plane, makes
a step that neither of the steps beside it foretells.
"""

from __future__ import annotations

import numpy as np
from numba import prange

from ibrpipe.core.jit import inlined, kernel

#: step of inverse depth that is no edge, as a share of it; times the smaller of the steps beside it
LEAST_STEP, FORETOLD = np.float32(0.003), np.float32(2.0)


@kernel
def invert_depths(depth, known, out_inverse, out_known):
    # depth (H, W) f32, inf = nothing is hit; known (H, W) f32 -> 1 / depth and is it known?, (H + 4, W + 4) f32 and u8,
    # two pixels larger on every side, where the picture's border goes on
    rows, columns = depth.shape
    for row in prange(rows + 4):
        y = min(max(np.int64(row) - 2, 0), rows - 1)
        for x in range(columns):
            out_inverse[row, x + 2], out_known[row, x + 2] = np.float32(1.0) / depth[y, x], known[y, x] > 0.0
        for x in range(2):
            out_inverse[row, x], out_known[row, x] = out_inverse[row, 2], out_known[row, 2]
            out_inverse[row, columns + 2 + x] = out_inverse[row, columns + 1]
            out_known[row, columns + 2 + x] = out_known[row, columns + 1]


@inlined
def is_step(before, one, two, after):
    # do inverse depths of four pixels in a row step from the second to the third?
    step, below, above = abs(two - one), abs(one - before), abs(after - two)
    foretold = below if below < above else above
    return step > LEAST_STEP * (one if one > two else two) + FORETOLD * foretold


@kernel
def find_edges(q, known, out_asked):
    # inverse depths q (H + 4, W + 4) f32 and known (H + 4, W + 4) u8 of `invert_depths` -> (H, W) u8: is there an edge
    # between the pixel and one of the four around it, or has only one of the two a colour?
    rows, columns = out_asked.shape
    for row in prange(rows):
        y = np.int64(row)  # prange counts unsigned
        for x in range(columns):
            here, left, right = q[y + 2, x + 2], q[y + 2, x + 1], q[y + 2, x + 3]
            above, below = q[y + 1, x + 2], q[y + 3, x + 2]
            edge = is_step(q[y + 2, x], left, here, right) | is_step(left, here, right, q[y + 2, x + 4])
            edge |= is_step(q[y, x + 2], above, here, below) | is_step(above, here, below, q[y + 4, x + 2])
            own = known[y + 2, x + 2]
            differs = (known[y + 2, x + 1] ^ own) | (known[y + 2, x + 3] ^ own)
            differs |= (known[y + 1, x + 2] ^ own) | (known[y + 3, x + 2] ^ own)
            out_asked[y, x] = np.uint8(edge) | differs
