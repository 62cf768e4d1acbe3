"""Colour of hits on height fields: bilinear, weights renormalised over the corners whose colour is known."""

from __future__ import annotations

import numpy as np
from numba import prange

from ibrpipe.core.jit import kernel


@kernel
def place_hits(depth, ids, width, start, Q_of, positions):
    # depth (h, w) f32, ids (h, w) u32 number of the cell hit, of `width` cells a row, 2^32 - 1 = none; start (4,),
    # Q_of (4, 3): rays in cells -> positions (h, w, 2) f64 of the hits, within their cells
    none = np.uint32(2**32 - 1)
    for y in prange(depth.shape[0]):
        for x in range(depth.shape[1]):
            if ids[y, x] == none:
                continue
            i, j, t = ids[y, x] % width, ids[y, x] // width, depth[y, x]
            u = start[0] + t * (Q_of[0, 0] * (x + 0.5) + Q_of[0, 1] * (y + 0.5) + Q_of[0, 2])
            v = start[1] + t * (Q_of[1, 0] * (x + 0.5) + Q_of[1, 1] * (y + 0.5) + Q_of[1, 2])
            positions[y, x, 0], positions[y, x, 1] = min(max(u, float(i)), i + 1.0), min(max(v, float(j)), j + 1.0)


@kernel
def color_heights(mine, positions, color, out, alpha):
    # mine (h, w) bool, positions (h, w, 2) f64 hits in cells; color (H, W, 4) f32, the fourth 0 where unknown
    # -> out (h, w, 3), alpha (h, w) f32 where mine
    last_i, last_j = color.shape[1] - 2, color.shape[0] - 2
    for y in prange(mine.shape[0]):
        for x in range(mine.shape[1]):
            if not mine[y, x]:
                continue
            u, v = positions[y, x, 0], positions[y, x, 1]
            i, j = min(max(int(u), 0), last_i), min(max(int(v), 0), last_j)
            p, q = min(max(u - i, 0.0), 1.0), min(max(v - j, 0.0), 1.0)
            total, red, green, blue = 0.0, 0.0, 0.0, 0.0
            for corner in range(4):
                right, down = corner & 1, corner >> 1
                weight = (p if right else 1.0 - p) * (q if down else 1.0 - q) * color[j + down, i + right, 3]
                total += weight
                red += weight * color[j + down, i + right, 0]
                green += weight * color[j + down, i + right, 1]
                blue += weight * color[j + down, i + right, 2]
            if total > 0.0:
                out[y, x, 0], out[y, x, 1], out[y, x, 2] = red / total, green / total, blue / total
                alpha[y, x] = 1.0
