"""Planes through a map of inverse depth: least squares over the near samples of a window.

On a plane, inverse depth is linear in pixel coordinates, so that the fit is exact there. Samples further from the
middle one than a tolerance plus the slope that two neighbours show are another surface's and do not count.

Symbols: sample q at (dx, dy) from the middle; normal equations of q = c + a dx + b dy.
"""

from __future__ import annotations

from numba import prange

from ibrpipe.core.jit import exact_kernel, fused_exact


@fused_exact
def solve(n, sx, sy, xx, xy, yy, sq, xq, yq):
    # normal equations -> c, a, b; 0, 0, 0 where the samples do not span a plane
    a00, a01, a11 = n * xx - sx * sx, n * xy - sx * sy, n * yy - sy * sy
    b0, b1 = n * xq - sx * sq, n * yq - sy * sq
    determinant = a00 * a11 - a01 * a01
    if not (n >= 6.0 and determinant > 1e-3 * n * n * n * n):
        return 0.0, 0.0, 0.0
    a, b = (a11 * b0 - a01 * b1) / determinant, (a00 * b1 - a01 * b0) / determinant
    return (sq - a * sx - b * sy) / n, a, b


@exact_kernel
def fit_planes(inverse, radius, tolerance, planes):
    # inverse (H, W) f32: 1 / depth, 0 = unknown; radius: pixels; tolerance: inverse depth per pixel of distance
    # planes (3, H, W) f32 filled: q, a, b; q = 0 where unknown
    rows, columns = inverse.shape
    for i in prange(rows):
        for j in range(columns):
            q = float(inverse[i, j])
            c, a, b = 0.0, 0.0, 0.0
            if q > 0.0:
                n, sx, sy, xx, xy, yy, sq, xq, yq = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
                for y in range(max(i - radius, 0), min(i + radius + 1, rows)):
                    for x in range(max(j - radius, 0), min(j + radius + 1, columns)):
                        dx, dy = float(x - j), float(y - i)
                        apart = float(inverse[y, x]) - q
                        if inverse[y, x] > 0 and abs(apart) <= tolerance * (1.0 + max(abs(dx), abs(dy))):
                            n += 1.0
                            sx += dx
                            sy += dy
                            xx += dx * dx
                            xy += dx * dy
                            yy += dy * dy
                            sq += apart
                            xq += dx * apart
                            yq += dy * apart
                c, a, b = solve(n, sx, sy, xx, xy, yy, sq, xq, yq)
                c += q
            planes[0, i, j], planes[1, i, j], planes[2, i, j] = max(c, 0.0), a, b
