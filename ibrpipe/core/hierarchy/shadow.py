"""What share of a light reaches the pixels of a picture, by the depths that the light sees.

Source: max1999, sec. 4 (as a wish); reeves1987 (percentage closer: depths are compared, then averaged). A pixel is lit
by a texel of the light's picture that is not nearer to the light than the pixel by more than a bias. The bias is
derived from texels: of the light's picture, of the picture itself, and from the slope of what the light sees.
"""

from __future__ import annotations

import math

import numpy as np
from numba import prange

from ibrpipe.core.jit import helper, kernel

#: texels over which the slope of what the light sees is followed
REACH = 2.5


@helper
def slope(seen, column, row):
    # change of depth a texel, along both sides; of two neighbours the one nearer in depth: no step is a slope
    total, last = 0.0, len(seen) - 1
    here = seen[row, column]
    left, right = seen[row, max(column - 1, 0)], seen[row, min(column + 1, last)]
    above, below = seen[max(row - 1, 0), column], seen[min(row + 1, last), column]
    for across in (min(abs(left - here), abs(right - here)), min(abs(above - here), abs(below - here))):
        total += across if math.isfinite(across) else 0.0
    return total


@helper
def lit_share(seen, u, v, w, bias, steepest):
    # share of 3 x 3 texels around (u, v), weighted as a square of 3 texels covers them, that are not before w
    size = len(seen)
    if not (0.0 <= u < size and 0.0 <= v < size):
        return 1.0
    left, top = int(math.floor(u - 1.5)), int(math.floor(v - 1.5))
    right, below = u - 1.5 - left, v - 1.5 - top
    steep = REACH * slope(seen, min(int(u), size - 1), min(int(v), size - 1))
    limit = w - bias - min(steep, steepest)
    lit = 0.0
    for j in range(4):
        weight_v = (1.0 - below) if j == 0 else (below if j == 3 else 1.0)
        row = min(max(top + j, 0), size - 1)
        for i in range(4):
            weight_u = (1.0 - right) if i == 0 else (right if i == 3 else 1.0)
            column = min(max(left + i, 0), size - 1)
            if seen[row, column] >= limit:
                lit += weight_u * weight_v
    return lit / 9.0


@kernel
def visibility(depth, view, maps, lights, biases, footprint, out):
    # depth (H, W) f32 along z, inf where there is nothing; view (3, 4) f64: world from (x z, y z, z, 1) of a pixel
    # maps (M, N, N) f32: depth that each light sees, inf = nothing; lights (M, 3, 4) f64: (u w, v w, w) in a light's
    # picture of a place of the world; biases (M, 2) f64: depth by which a place may lie behind what is seen, and what
    # the slope of that adds to it at most; footprint: the same per unit of depth of the pixel
    # -> out (M, H, W) f32: share of each light that reaches a pixel
    for row in prange(depth.shape[0]):
        place = np.empty(3)
        for column in range(depth.shape[1]):
            z = np.float64(depth[row, column])
            if not math.isfinite(z):
                for m in range(len(maps)):
                    out[m, row, column] = 1.0
                continue
            x, y = (column + 0.5) * z, (row + 0.5) * z
            for c in range(3):
                place[c] = view[c, 0] * x + view[c, 1] * y + view[c, 2] * z + view[c, 3]
            for m in range(len(maps)):
                p = lights[m]
                u = p[0, 0] * place[0] + p[0, 1] * place[1] + p[0, 2] * place[2] + p[0, 3]
                v = p[1, 0] * place[0] + p[1, 1] * place[1] + p[1, 2] * place[2] + p[1, 3]
                w = p[2, 0] * place[0] + p[2, 1] * place[1] + p[2, 2] * place[2] + p[2, 3]
                bias = biases[m, 0] + footprint * z
                out[m, row, column] = lit_share(maps[m], u / w, v / w, w, bias, biases[m, 1])
