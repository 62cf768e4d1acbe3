"""Whole numbers on a picture with holes, each told as the difference from what its neighbours before it foretell.

Row by row: where the left, the upper and the upper left neighbour are there, a plane through them; with one of them its
value; with none what was met last. A hole foretells nothing. Decoding repeats what encoding did, so nothing is lost.
"""

from __future__ import annotations

import numpy as np

from ibrpipe.core.jit import helper, serial

#: predictors where three neighbours are there
PLANE, MEDIAN = 0, 1


@helper
def foretold(values, there, i, j, last, predictor):
    # values (H, W) i64; there (H, W) bool; last: what was met last; predictor: PLANE or MEDIAN of left, upper and plane
    left = j > 0 and there[i, j - 1]
    upper = i > 0 and there[i - 1, j]
    if left and upper:
        a, b = values[i, j - 1], values[i - 1, j]
        if not there[i - 1, j - 1]:
            return (a + b) >> 1
        plane = a + b - values[i - 1, j - 1]
        return plane if predictor == PLANE else max(min(a, b), min(max(a, b), plane))
    if left:
        return values[i, j - 1]
    if upper:
        return values[i - 1, j]
    if i > 0 and j + 1 < there.shape[1] and there[i - 1, j + 1]:
        return values[i - 1, j + 1]
    return last


@serial
def take_differences(values, there, predictor, out_folded):
    # values (H, W) i64, below 2^40 in size; out_folded (S,) u64: 0, -1, 1, -2 … as 0, 1, 2, 3 …
    n, last = 0, np.int64(0)
    for i in range(values.shape[0]):
        for j in range(values.shape[1]):
            if there[i, j]:
                rest = values[i, j] - foretold(values, there, i, j, last, predictor)
                out_folded[n] = np.uint64((rest << 1) ^ (rest >> 63))
                last = values[i, j]
                n += 1


@serial
def add_differences(folded, there, predictor, out_values):
    # folded (S,) u64 as `take_differences` wrote, S = texels that are there; out_values (H, W) i64
    n, last = 0, np.int64(0)
    for i in range(there.shape[0]):
        for j in range(there.shape[1]):
            if there[i, j]:
                rest = np.int64(folded[n] >> np.uint64(1)) ^ -np.int64(folded[n] & np.uint64(1))
                last = foretold(out_values, there, i, j, last, predictor) + rest
                out_values[i, j] = last
                n += 1
