"""Pixels that show an edge: where one ray a pixel tells too little."""

from __future__ import annotations

import numpy as np

from ibrpipe.core.edges import find_edges, invert_depths
from ibrpipe.types import Array

#: rays that are traced at once, if a row of pixels does not have more
MOST_RAYS = 4_000_000
#: rays of an edge's pixel along either axis; where they pass through it, in whole 64ths, which float32 holds
SIDE = 3
OFFSETS = np.round(64 * (np.arange(SIDE) + 0.5) / SIDE) / 64
#: (SIDE^2, 2) the same along x and y, row by row
PLACES = np.stack([np.tile(OFFSETS, SIDE), np.repeat(OFFSETS, SIDE)], axis=1)


def edge_pixels(depth: Array, known: Array) -> Array:
    """(H, W) uint8, 1 where a pixel and one of the four around it show different surfaces, or only one has a colour.

    Parameters
    ----------
    depth : (H, W) float32, along camera z; +inf where nothing is hit
    known : (H, W) float32, 0 where there is no colour
    """
    widened = (depth.shape[0] + 4, depth.shape[1] + 4)
    inverse, colored = np.empty(widened, np.float32), np.empty(widened, np.uint8)
    out = np.empty(depth.shape, np.uint8)
    invert_depths(depth, known, inverse, colored)
    find_edges(inverse, colored, out)
    return out
