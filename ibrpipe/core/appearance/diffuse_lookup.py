"""Diffuse colour of surface points out of layered depth images. Source: gong-yang, sec. 4.2 and fig. 4.

The texture that faces a point best supplies its colour; the next best steps in where that one has no sample there.
"""

import math

import numpy as np
from numba import prange

from ibrpipe.core.appearance.photo_blend import BLOCK
from ibrpipe.core.jit import helper, kernel


@helper
def sample_near(offsets, start, depth, observers, row, column, wanted, tolerance):
    """Index of the seen sample of a pixel whose depth is nearest to `wanted` within `tolerance`, or -1."""
    # offsets (H, W + 1) of this texture, counted from `start` in the joint arrays
    best, gap = -1, tolerance
    for i in range(start + offsets[row, column], start + offsets[row, column + 1]):
        if observers[i] > 0 and abs(depth[i] - wanted) <= gap:
            best, gap = i, abs(depth[i] - wanted)
    return best


@helper
def bilinear_diffuse(offsets, start, depth, color, observers, u, v, wanted, tolerance, out):
    """Add bilinear colour at (u, v) into out (4,): weighted R, G, B, and weight of the samples found."""
    height, width = offsets.shape[0], offsets.shape[1] - 1
    fx, fy = u - 0.5, v - 0.5
    column, row = math.floor(fx), math.floor(fy)
    fx -= column
    fy -= row
    for corner in range(4):
        c, r = int(column) + corner % 2, int(row) + corner // 2
        if c < 0 or r < 0 or c >= width or r >= height:
            continue
        weight = (fx if corner % 2 else 1.0 - fx) * (fy if corner // 2 else 1.0 - fy)
        i = sample_near(offsets, start, depth, observers, r, c, wanted, tolerance)
        if i >= 0:
            out[0] += weight * color[i, 0]
            out[1] += weight * color[i, 1]
            out[2] += weight * color[i, 2]
            out[3] += weight


@kernel
def lookup_diffuse(
    points, facing, projections, texels, offsets, starts, depth, color, observers, out_color
):  # fmt: skip
    """Fill out_color (N, 3) f32 with the diffuse colour of points (N, 3) f64; NaN where no texture has one."""
    # facing (N, T) f64 cosine to each texture, -1 = outside; projections (T, 4, 4) f64 rows u, v, depth, w
    # texels (T,) f64 texel size in the world; offsets: tuple of T arrays (H, W + 1) i64; starts (T + 1,) i64
    # depth (S,) f32, color (S, 3) f32, observers (S,) i32 of all textures, joined
    for block in prange((len(points) + BLOCK - 1) // BLOCK):
        total, order = np.empty(4), np.empty(facing.shape[1])
        for i in range(block * BLOCK, min((block + 1) * BLOCK, len(points))):
            out_color[i] = np.nan
            order[:] = facing[i]
            for _ in range(len(order)):
                t = int(np.argmax(order))
                cosine = order[t]
                if cosine <= 0.0:
                    break
                order[t] = -2.0
                m = projections[t]
                x, y, z = points[i, 0], points[i, 1], points[i, 2]
                w = m[3, 0] * x + m[3, 1] * y + m[3, 2] * z + m[3, 3]
                u = (m[0, 0] * x + m[0, 1] * y + m[0, 2] * z + m[0, 3]) / w
                v = (m[1, 0] * x + m[1, 1] * y + m[1, 2] * z + m[1, 3]) / w
                wanted = m[2, 0] * x + m[2, 1] * y + m[2, 2] * z + m[2, 3]
                slope = math.sqrt(max(1.0 - cosine * cosine, 0.0)) / cosine
                total[:] = 0.0
                bilinear_diffuse(
                    offsets[t], starts[t], depth, color, observers, u, v, wanted, 1.5 * texels[t] * (1.0 + slope), total
                )
                if total[3] > 0.05:
                    for c in range(3):
                        out_color[i, c] = total[c] / total[3]
                    break
