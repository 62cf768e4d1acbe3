"""Colour of hits: bilinear in the cell, weights renormalised over the corners whose colour is known.

A hit is a camera depth and a number: patches of layered images are numbered first, then the cells of height fields.
Where in its cell a hit lies follows from its ray and its depth. Coordinates: :mod:`ibrpipe.core.rays`.

``grid`` = (rows (h, 2), columns (w, 2)) f64: ray (y, x) passes through ``rows[y] + columns[x]`` of the picture.
"""

from __future__ import annotations

import numpy as np
from numba import prange

from ibrpipe.core.jit import helper, kernel


@helper
def place_in_cell(px, py, t, i, j, start, Q_of):
    # where the ray through (px, py) of the picture is at camera depth t, in cell (i, j) -> (p, q), kept in [0, 1]
    q = start[3] + t * (Q_of[3, 0] * px + Q_of[3, 1] * py + Q_of[3, 2])
    u = (start[0] + t * (Q_of[0, 0] * px + Q_of[0, 1] * py + Q_of[0, 2])) / q - i
    v = (start[1] + t * (Q_of[1, 0] * px + Q_of[1, 1] * py + Q_of[1, 2])) / q - j
    return min(max(u, 0.0), 1.0), min(max(v, 0.0), 1.0)


@kernel
def shade_heights(depth, ids, grid, base, start, Q_of, color, out, known):
    # color (H, W, 3) f32 texels, hits with ids from `base` on; out (h, w, 3) f32 and known (h, w) f32 are set
    # where this field is hit
    columns, cells = color.shape[1] - 1, (color.shape[0] - 1) * (color.shape[1] - 1)
    for y in prange(depth.shape[0]):
        for x in range(depth.shape[1]):
            cell = np.int64(ids[y, x]) - base
            if not depth[y, x] < np.inf or cell < 0 or cell >= cells:
                continue
            j, i = cell // columns, cell % columns
            px, py = grid[0][y, 0] + grid[1][x, 0], grid[0][y, 1] + grid[1][x, 1]
            p, q = place_in_cell(px, py, float(depth[y, x]), i, j, start, Q_of)
            for k in range(3):
                upper = color[j, i, k] + p * (color[j, i + 1, k] - color[j, i, k])
                lower = color[j + 1, i, k] + p * (color[j + 1, i + 1, k] - color[j + 1, i, k])
                out[y, x, k] = upper + q * (lower - upper)
            known[y, x] = 1.0


@kernel
def shade_patches(depth, ids, grid, records, starts, Q_of, color, out, known):
    # records (P, 8) i32: column, row, field, 0, samples of four corners (-1 = none); starts (F, 4), Q_of (F, 4, 3):
    # rays of every field; color (S, 4) f32, the fourth the sample's coverage, 0 where no photo saw it; out (h, w, 3)
    # f32; known (h, w) f32: coverage of the hit by samples whose colour is known, 0 = unknown
    for y in prange(depth.shape[0]):
        for x in range(depth.shape[1]):
            t, patch = float(depth[y, x]), ids[y, x]
            if not t < np.inf or patch >= records.shape[0]:
                continue
            f = records[patch, 2]
            px, py = grid[0][y, 0] + grid[1][x, 0], grid[0][y, 1] + grid[1][x, 1]
            q = starts[f, 3] + t * (Q_of[f, 3, 0] * px + Q_of[f, 3, 1] * py + Q_of[f, 3, 2])
            u = starts[f, 0] + t * (Q_of[f, 0, 0] * px + Q_of[f, 0, 1] * py + Q_of[f, 0, 2])
            v = starts[f, 1] + t * (Q_of[f, 1, 0] * px + Q_of[f, 1, 1] * py + Q_of[f, 1, 2])
            p, r = u / q - records[patch, 0], v / q - records[patch, 1]
            p, r = np.float32(min(max(p, 0.0), 1.0)), np.float32(min(max(r, 0.0), 1.0))
            total, red, green, blue = np.float32(0.0), np.float32(0.0), np.float32(0.0), np.float32(0.0)
            seen = np.float32(0.0)
            for corner in range(4):
                sample = records[patch, 4 + corner]
                weight = (p if corner & 1 else np.float32(1.0) - p) * (r if corner & 2 else np.float32(1.0) - r)
                weight *= np.float32(1.0) if sample >= 0 else np.float32(0.0)
                sample = sample if sample >= 0 else 0
                seen += weight if color[sample, 3] > np.float32(0.0) else np.float32(0.0)
                weight *= color[sample, 3]
                total += weight
                red += weight * color[sample, 0]
                green += weight * color[sample, 1]
                blue += weight * color[sample, 2]
            if total > 0.0:
                out[y, x, 0], out[y, x, 1], out[y, x, 2] = red / total, green / total, blue / total
                known[y, x] = min(total / seen, np.float32(1.0))
            else:
                known[y, x] = 0.0
