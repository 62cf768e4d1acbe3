"""How many neighbours' depth maps agree with a view's own, in place, depth and normal.

Symbols: as in `patchmatch_views`; a neighbour's plane (q', a', b') seen in the reference has the gradient M^T (a', b',
q' - a' u - b' v), up to scale.
"""

from __future__ import annotations

import math

import numpy as np
from numba import prange

from ibrpipe.core.jit import exact_kernel, fused_exact
from ibrpipe.core.patchmatch.planes import facing


@fused_exact
def agrees(views, others, n, x, y, q, nx, ny, nz, lens, limits):
    # does neighbour n's plane lead back to (x, y), at the same depth and with the same normal?
    w = views[n, 6] * x + views[n, 7] * y + views[n, 8] + views[n, 11] * q
    if not w > 1e-6:
        return False
    u = (views[n, 0] * x + views[n, 1] * y + views[n, 2] + views[n, 9] * q) / w
    v = (views[n, 3] * x + views[n, 4] * y + views[n, 5] + views[n, 10] * q) / w
    if not (u >= 0.0 and v >= 0.0 and u < views[n, 12] and v < views[n, 13]):
        return False
    column, row = math.floor(u), math.floor(v)
    pixel_idx = np.int64(row) * np.int64(views[n, 14]) + np.int64(column)
    a, b = others[n, 1, pixel_idx], others[n, 2, pixel_idx]
    if not others[n, 0, pixel_idx] > 0.0:
        return False
    back = others[n, 0, pixel_idx] + a * (u - column - 0.5) + b * (v - row - 0.5)
    r = views[n, 22] * u + views[n, 23] * v + views[n, 24] + views[n, 27] * back
    if not (r > 1e-6 and back > 0.0 and abs(r * q / back - 1.0) < limits[1]):
        return False
    s = (views[n, 16] * u + views[n, 17] * v + views[n, 18] + views[n, 25] * back) / r - x
    t = (views[n, 19] * u + views[n, 20] * v + views[n, 21] + views[n, 26] * back) / r - y
    if not s * s + t * t < limits[0] * limits[0]:
        return False
    c = back - a * u - b * v
    g0 = views[n, 0] * a + views[n, 3] * b + views[n, 6] * c
    g1 = views[n, 1] * a + views[n, 4] * b + views[n, 7] * c
    g2 = views[n, 2] * a + views[n, 5] * b + views[n, 8] * c
    mx, my, mz = facing(g0 * x + g1 * y + g2, g0, g1, x, y, lens)
    return mx * nx + my * ny + mz * nz > limits[2]


@exact_kernel
def count_agreeing(lens, limits, views, others, state, count):
    # limits (3,): pixels, relative depth, cosine of normals; views (V, 32) f64; others (V, 3, N) f32: their planes
    # state (4, H, W) f32; count (H, W) u8 filled
    for i in prange(count.shape[0]):
        for j in range(count.shape[1]):
            x, y, q = j + 0.5, i + 0.5, float(state[0, i, j])
            found = 0
            if q > 0.0:
                nx, ny, nz = facing(q, float(state[1, i, j]), float(state[2, i, j]), x, y, lens)
                for n in range(views.shape[0]):
                    found += agrees(views, others, n, x, y, q, nx, ny, nz, lens, limits)
            count[i, j] = found
