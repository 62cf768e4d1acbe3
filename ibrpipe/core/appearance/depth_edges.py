"""Where a picture of depths passes from one surface to another."""

from __future__ import annotations

import numpy as np


def beside_edge(depth, mask):
    """(H, W) bool: pixels that have a neighbour on another surface or outside the mask.

    A surface goes on where inverse depth, which is straight on planes, bends by less than a hundredth.
    """
    inverse = np.pad(np.where(mask >= 0.5, 1.0 / depth, 0.0), 1, mode="edge")
    inner, out = inverse[1:-1, 1:-1], np.zeros(depth.shape, bool)
    for before, after in ((inverse[1:-1, :-2], inverse[1:-1, 2:]), (inverse[:-2, 1:-1], inverse[2:, 1:-1])):
        out |= np.abs(before + after - 2 * inner) > 0.01 * inner
        out |= (before == 0) | (after == 0)
    return out
