"""Which photos see a surface point, and what colour they give it. Source: gong-yang, sec. 4.1 and 4.2.

A `packed` photo set is one flat array for all pixels of all photos: photo p owns pixels ``starts[p]`` to
``starts[p + 1]``, row-major, of size ``sizes[p] = (H, W)``.

A photo's pixel is *clean* for a point when all four pixels around the projection lie on the same surface as the point
(depths agree within what the slope allows) and inside the mask: its colour is then of the object alone.
It is *usable* when only the nearest pixel agrees, which happens along silhouettes; usable pixels count only
where no photo is clean.
"""

import math

import numpy as np
from numba import prange

from ibrpipe.core.jit import helper, kernel

BLOCK = 128
HIDDEN, USABLE, CLEAN = 0, 1, 2


@helper
def see(px, py, pz, nx, ny, nz, projection, center, height, width, start, depth, mask, cos_min, slack):
    """Return (quality, x, y): how photo sees the point, and where (pixel coordinates, centres at .5)."""
    # projection (3, 4) f64 world to pixel; center (3,) f64; depth, mask flat f32; slack in pixels
    z = projection[2, 0] * px + projection[2, 1] * py + projection[2, 2] * pz + projection[2, 3]
    if not z > 0.0:
        return HIDDEN, 0.0, 0.0
    x = (projection[0, 0] * px + projection[0, 1] * py + projection[0, 2] * pz + projection[0, 3]) / z
    y = (projection[1, 0] * px + projection[1, 1] * py + projection[1, 2] * pz + projection[1, 3]) / z
    if not (x >= 0.5 and y >= 0.5 and x <= width - 0.5 and y <= height - 0.5):
        return HIDDEN, 0.0, 0.0
    dx, dy, dz = center[0] - px, center[1] - py, center[2] - pz
    distance = math.sqrt(dx * dx + dy * dy + dz * dz)
    cosine = (nx * dx + ny * dy + nz * dz) / distance
    if not cosine >= cos_min:
        return HIDDEN, 0.0, 0.0
    # a pixel's width on the surface, stretched along the view by the slope
    footprint = math.sqrt(
        projection[0, 0] * projection[0, 0] + projection[0, 1] * projection[0, 1] + projection[0, 2] * projection[0, 2]
    )
    tolerance = slack * z / footprint / max(cosine, 0.05)
    column, row = min(int(x - 0.5), width - 2), min(int(y - 0.5), height - 2)
    column, row = max(column, 0), max(row, 0)
    clean = True
    for corner in range(4):
        i, j = min(column + corner % 2, width - 1), min(row + corner // 2, height - 1)
        index = start + j * width + i
        if not (abs(depth[index] - z) <= tolerance and mask[index] >= 0.95):
            clean = False
    if clean:
        return CLEAN, x, y
    index = start + min(int(y), height - 1) * width + min(int(x), width - 1)
    if depth[index] >= z - tolerance and mask[index] >= 0.5:
        return USABLE, x, y
    return HIDDEN, 0.0, 0.0


@helper
def fetch(color, start, height, width, x, y):
    """Return the bilinear colour of one photo at (x, y), clamped at its border."""
    fx, fy = min(max(x - 0.5, 0.0), width - 1.0), min(max(y - 0.5, 0.0), height - 1.0)
    i, j = min(int(fx), max(width - 2, 0)), min(int(fy), max(height - 2, 0))
    p, q = fx - i, fy - j
    i1, j1 = min(i + 1, width - 1), min(j + 1, height - 1)
    a, b = start + j * width + i, start + j * width + i1
    c, d = start + j1 * width + i, start + j1 * width + i1
    wa, wb, wc, wd = (1 - p) * (1 - q), p * (1 - q), (1 - p) * q, p * q
    red = wa * color[a, 0] + wb * color[b, 0] + wc * color[c, 0] + wd * color[d, 0]
    green = wa * color[a, 1] + wb * color[b, 1] + wc * color[c, 1] + wd * color[d, 1]
    blue = wa * color[a, 2] + wb * color[b, 2] + wc * color[c, 2] + wd * color[d, 2]
    return red, green, blue


@helper
def blend_weights(dots, count, weights):
    """Fill `weights` for `count` dot products in descending order: dot_i - dot_4, normalised (gong-yang, sec. 4.2).

    With fewer than four photos the threshold lies half the spread below the last, so that it still counts.
    """
    low = dots[3] if count >= 4 else dots[count - 1] - 0.5 * (dots[0] - dots[count - 1]) - 1e-9
    total = 0.0
    for i in range(count):
        weights[i] = max(dots[i] - low, 0.0)
        total += weights[i]
    for i in range(count):
        weights[i] = weights[i] / total if total > 0.0 else 1.0 / count


@helper
def best_photos(
    px, py, pz, nx, ny, nz, dx, dy, dz, projection, centers, sizes, starts, depth, mask, cos_min, slack,
    dots, chosen, places, best
):  # fmt: skip
    """Find the (at most four) photos that see the point from nearest to direction d. Return how many.

    dots (P,) f64 is scratch; chosen (4,) i64, places (4, 2) f64 and best (4,) f64 are filled.
    """
    photos = len(centers)
    for wanted in (CLEAN, USABLE):
        for p in range(photos):
            ex, ey, ez = centers[p, 0] - px, centers[p, 1] - py, centers[p, 2] - pz
            dots[p] = (ex * dx + ey * dy + ez * dz) / math.sqrt(ex * ex + ey * ey + ez * ez)
        found = 0
        for _ in range(photos):
            top, value = -1, -2.0
            for p in range(photos):
                if dots[p] > value:
                    top, value = p, dots[p]
            if top < 0:
                break
            dots[top] = -3.0
            quality, x, y = see(
                px, py, pz, nx, ny, nz, projection[top], centers[top], sizes[top, 0], sizes[top, 1], starts[top],
                depth, mask, cos_min, slack
            )  # fmt: skip
            if quality >= wanted:
                chosen[found], best[found] = top, value
                places[found, 0], places[found, 1] = x, y
                found += 1
                if found == 4:
                    break
        if found > 0:
            return found
    return 0


@kernel
def blend_photos(
    points, normals, directions, projection, centers, sizes, starts, color, depth, mask, cos_min, slack,
    out_color, out_count
):  # fmt: skip
    """Colour every point as seen from its direction, from the best four photos (gong-yang, sec. 4.2)."""
    # points, directions (N, 3) f64, directions unit and toward the viewer; normals (N, 3) f32 unit
    # projection (P, 3, 4) f64, centers (P, 3) f64, sizes (P, 2) i32 (H, W), starts (P + 1,) i64
    # color (T, 3) f32 linear, depth (T,) f32 along camera z, mask (T,) f32; cos_min, slack f64
    # out_color (N, 3) f32, NaN where no photo sees the point; out_count (N,) i32 photos used
    for block in prange((len(points) + BLOCK - 1) // BLOCK):
        dots = np.empty(len(centers))
        chosen, places, best = np.empty(4, np.int64), np.empty((4, 2)), np.empty(4)
        weights = np.empty(4)
        for i in range(block * BLOCK, min((block + 1) * BLOCK, len(points))):
            found = best_photos(
                points[i, 0], points[i, 1], points[i, 2], normals[i, 0], normals[i, 1], normals[i, 2],
                directions[i, 0], directions[i, 1], directions[i, 2], projection, centers, sizes, starts, depth, mask,
                cos_min, slack, dots, chosen, places, best
            )  # fmt: skip
            out_count[i] = found
            if found == 0:
                out_color[i] = np.nan
                continue
            blend_weights(best, found, weights)
            red, green, blue = 0.0, 0.0, 0.0
            for j in range(found):
                p = chosen[j]
                r, g, b = fetch(color, starts[p], sizes[p, 0], sizes[p, 1], places[j, 0], places[j, 1])
                red += weights[j] * r
                green += weights[j] * g
                blue += weights[j] * b
            out_color[i, 0], out_color[i, 1], out_color[i, 2] = red, green, blue
