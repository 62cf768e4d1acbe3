"""Colour of hits on height fields: bilinear, weights renormalised over the corners whose colour is known."""

from __future__ import annotations

from numba import prange

from ibrpipe.core.jit import kernel


@kernel
def color_heights(mine, depth, start, turn, color, out, alpha):
    # mine (h, w) bool, depth (h, w) f32 camera depth; start (4,), turn (4, 3) f64: see rays, a parallel frame;
    # color (H, W, 4) f32, the fourth 0 where unknown -> out (h, w, 3), alpha (h, w) f32 where mine
    last_i, last_j = color.shape[1] - 2, color.shape[0] - 2
    for y in prange(depth.shape[0]):
        for x in range(depth.shape[1]):
            if not mine[y, x]:
                continue
            px, py, t = x + 0.5, y + 0.5, float(depth[y, x])
            u = start[0] + t * (turn[0, 0] * px + turn[0, 1] * py + turn[0, 2])
            v = start[1] + t * (turn[1, 0] * px + turn[1, 1] * py + turn[1, 2])
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
