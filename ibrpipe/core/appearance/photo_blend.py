"""Which photos see a surface point, and what colour they give it. Source: gong-yang, sec. 4.1 and 4.2.

A `packed` photo set is one flat array for all pixels of all photos: photo p owns pixels ``starts[p]`` to
``starts[p + 1]``, row-major, of size ``sizes[p] = (H, W)``. Kernels take it as the tuple ``photos``: projection
(P, 3, 4) f64, pixels from world; centers (P, 3) f64; sizes (P, 2) i32; starts (P + 1,) i64; color (T, 3) f32, display
code; depth (T,) f32 along camera z; mask (T,) f32. Without the color it is the tuple ``views``.

A photo is *clean* for a point when all four pixels around the projection show the point's surface (depths agree
within what the slope allows) well inside the mask. It is *usable* when some do, which happens along silhouettes; only
those pixels are then read, so what stands behind or before never bleeds in.

Colours are mixed in display code (the sRGB curve, carried on above 1): mixing linear light would let one highlight
among four photos outshine the others (measured: 0.2 dB worse on held-out views).
"""

import math

import numpy as np
from numba import prange

from ibrpipe.core.jit import helper, kernel

BLOCK = 128
#: rad, added to angles, so that a photo from the very direction does not weigh infinitely
LEAST_ANGLE = 0.003
#: places of the rules: least cosine between normal and photo; how far depths may differ, pixels; see `weigh` and `mix`
COS_MIN, SLACK, FALLOFF, SHARPNESS = range(4)
HIDDEN, USABLE, CLEAN = 0, 1, 2


@helper
def see(point, normal, photo, views, cos_min, slack, corners, row):
    """Say how one photo sees a point, and through which of its pixels.

    Fills corners[row] (4, 2) f64 with index and weight of the pixels that show the same surface (weights sum to 1).
    """
    # point, normal: three f64 each; slack in pixels
    (px, py, pz), (nx, ny, nz) = point, normal
    projection, centers, sizes, starts, depth, mask = views
    height, width, start = sizes[photo, 0], sizes[photo, 1], starts[photo]
    z = (
        projection[photo, 2, 0] * px
        + projection[photo, 2, 1] * py
        + projection[photo, 2, 2] * pz
        + projection[photo, 2, 3]
    )
    if not z > 0.0:
        return HIDDEN
    x = (
        projection[photo, 0, 0] * px
        + projection[photo, 0, 1] * py
        + projection[photo, 0, 2] * pz
        + projection[photo, 0, 3]
    ) / z - 0.5
    y = (
        projection[photo, 1, 0] * px
        + projection[photo, 1, 1] * py
        + projection[photo, 1, 2] * pz
        + projection[photo, 1, 3]
    ) / z - 0.5
    if not (x >= 0.0 and y >= 0.0 and x <= width - 1 and y <= height - 1):
        return HIDDEN
    dx, dy, dz = centers[photo, 0] - px, centers[photo, 1] - py, centers[photo, 2] - pz
    distance = math.sqrt(dx * dx + dy * dy + dz * dz)
    cosine = (nx * dx + ny * dy + nz * dz) / distance
    if not cosine >= cos_min:
        return HIDDEN
    tolerance = slack * z / focal_length(projection, photo) / max(cosine, 0.05)
    i0, j0 = max(min(int(x), width - 2), 0), max(min(int(y), height - 2), 0)
    fx, fy = x - i0, y - j0
    clean, total = True, 0.0
    for corner in range(4):
        i, j = min(i0 + corner % 2, width - 1), min(j0 + corner // 2, height - 1)
        index = start + j * width + i
        weight = (fx if corner % 2 else 1.0 - fx) * (fy if corner // 2 else 1.0 - fy)
        same = abs(depth[index] - z) <= tolerance and mask[index] >= 0.5
        if not (same and mask[index] >= 0.95):
            clean = False
        corners[row, corner, 0] = index
        corners[row, corner, 1] = weight if same else 0.0
        total += corners[row, corner, 1]
    if total < 0.25:
        return HIDDEN
    for corner in range(4):
        corners[row, corner, 1] /= total
    return CLEAN if clean else USABLE


@helper
def focal_length(projection, photo):
    """Pixels per unit of x / z of a photo."""
    a, b, c = projection[photo, 0, 0], projection[photo, 0, 1], projection[photo, 0, 2]
    d, e, f = projection[photo, 2, 0], projection[photo, 2, 1], projection[photo, 2, 2]
    along = a * d + b * e + c * f  # the principal point's share
    return math.sqrt(max(a * a + b * b + c * c - along * along, 1e-300))


@helper
def fetch(color, corners, row):
    """Return the weighted colour of the pixels that `see` put into corners[row]."""
    red, green, blue = 0.0, 0.0, 0.0
    for corner in range(4):
        index, weight = int(corners[row, corner, 0]), corners[row, corner, 1]
        red += weight * color[index, 0]
        green += weight * color[index, 1]
        blue += weight * color[index, 2]
    return red, green, blue


@helper
def blend_weights(dots, count, weights):
    """Fill `weights` for `count` dot products in descending order: dot_i - dot_4, normalised (gong-yang, sec. 4.2).

    Four are as many as there is room for in dots. With fewer photos the threshold lies half the spread below the last,
    so that it still counts.
    """
    low = dots[count - 1]
    if count < len(dots):
        low -= 0.5 * (dots[0] - dots[count - 1]) + 1e-9
    total = 0.0
    for i in range(count):
        weights[i] = max(dots[i] - low, 0.0)
        total += weights[i]
    for i in range(count):
        weights[i] = weights[i] / total if total > 0.0 else 1.0 / count


@helper
def best_photos(point, normal, direction, views, cos_min, slack, dots, chosen, corners, best):
    """Find the (at most N) photos that see the point from nearest to direction d. Return how many.

    dots (P,) f64 is scratch; chosen (N,) i64, corners (N, 4, 2) f64 and best (N,) f64 are filled.
    """
    (px, py, pz), (dx, dy, dz), centers = point, direction, views[1]
    count = len(centers)
    for p in range(count):
        ex, ey, ez = centers[p, 0] - px, centers[p, 1] - py, centers[p, 2] - pz
        dots[p] = (ex * dx + ey * dy + ez * dz) / math.sqrt(ex * ex + ey * ey + ez * ez)
    found = 0
    for _ in range(count):
        top = int(np.argmax(dots))
        value = dots[top]
        dots[top] = -3.0
        quality = see(point, normal, top, views, cos_min, slack, corners, found)
        if quality != HIDDEN:
            chosen[found], best[found] = top, value
            found += 1
            if found == len(chosen):
                break
    return found


@helper
def angle_weights(dots, count, falloff, weights):
    """Fill `weights` for `count` dot products in descending order by angle: (1 - angle / last) / angle^falloff.

    As many as there is room for in dots are full; with fewer the last lies a little beyond the last photo. Source:
    buehler2001, sec. 4.
    """
    last = math.acos(max(min(dots[count - 1], 1.0), -1.0))
    if count < len(dots):
        last = 1.2 * last + 1e-6
    total = 0.0
    for i in range(count):
        angle = math.acos(max(min(dots[i], 1.0), -1.0))
        weights[i] = max(1.0 - angle / last, 0.0) / (angle + LEAST_ANGLE) ** falloff if last > 0.0 else 0.0
        total += weights[i]
    for i in range(count):
        weights[i] = weights[i] / total if total > 0.0 else 1.0 / count


@helper
def weigh(dots, count, falloff, weights):
    """Fill `weights` as `blend_weights` where falloff is 0, else as `angle_weights`."""
    if falloff > 0.0:
        angle_weights(dots, count, falloff, weights)
    else:
        blend_weights(dots, count, weights)


@helper
def tap(t, a):
    """Weight of a pixel at distance t >= 0 in cubic convolution of parameter a. Source: keys1981."""
    if t < 1.0:
        return ((a + 2.0) * t - (a + 3.0)) * t * t + 1.0
    return a * (((t - 5.0) * t + 8.0) * t - 4.0)


@helper
def fetch_sharp(color, photo, views, corners, row, sharpness):
    """Return the colour at the place in corners[row] by cubic convolution; bilinear beside what is no object."""
    _, _, sizes, starts, _, mask = views
    height, width, start = sizes[photo, 0], sizes[photo, 1], starts[photo]
    first = int(corners[row, 0, 0]) - start
    i0, j0 = first % width, first // width
    whole = (
        corners[row, 0, 1] > 0.0 and corners[row, 1, 1] > 0.0 and corners[row, 2, 1] > 0.0 and corners[row, 3, 1] > 0.0
    )
    if not (whole and i0 >= 1 and j0 >= 1 and i0 + 2 < width and j0 + 2 < height):
        return fetch(color, corners, row)
    fx, fy = corners[row, 1, 1] + corners[row, 3, 1], corners[row, 2, 1] + corners[row, 3, 1]
    red, green, blue = 0.0, 0.0, 0.0
    for j in range(-1, 3):
        down = tap(abs(j - fy), -sharpness)
        for i in range(-1, 3):
            index = start + (j0 + j) * width + i0 + i
            if not mask[index] >= 0.5:
                return fetch(color, corners, row)
            weight = down * tap(abs(i - fx), -sharpness)
            red += weight * color[index, 0]
            green += weight * color[index, 1]
            blue += weight * color[index, 2]
    return red, green, blue


@helper
def mix(color, chosen, views, corners, weights, count, sharpness):
    """Return the mean of what `count` photos show, by their weights; bilinear where sharpness is 0."""
    red, green, blue = 0.0, 0.0, 0.0
    for j in range(count):
        if weights[j] <= 0.0:
            continue
        if sharpness > 0.0:
            r, g, b = fetch_sharp(color, chosen[j], views, corners, j, sharpness)
        else:
            r, g, b = fetch(color, corners, j)
        red += weights[j] * r
        green += weights[j] * g
        blue += weights[j] * b
    return red, green, blue


@kernel
def blend_photos(points, normals, directions, photos, most, rules, out_color, out_count):
    """Colour every point as seen from its direction, from the best photos (gong-yang, sec. 4.2: the best four)."""
    # points, directions (N, 3) f64, directions unit and toward the viewer; normals (N, 3) f32 unit
    # photos: see above; most i64, photos of a point; rules (4,) f64: see above
    # out_color (N, 3) f32 display code, NaN where no photo sees the point; out_count (N,) i32 photos used
    projection, centers, sizes, starts, color, depth, mask = photos
    for block in prange((len(points) + BLOCK - 1) // BLOCK):
        views = projection, centers, sizes, starts, depth, mask
        dots = np.empty(len(centers))
        chosen, corners, best = np.empty(most, np.int64), np.empty((most, 4, 2)), np.empty(most)
        weights = np.empty(most)
        for i in range(block * BLOCK, min((block + 1) * BLOCK, len(points))):
            point, normal = (points[i, 0], points[i, 1], points[i, 2]), (normals[i, 0], normals[i, 1], normals[i, 2])
            direction = directions[i, 0], directions[i, 1], directions[i, 2]
            found = best_photos(
                point, normal, direction, views, rules[COS_MIN], rules[SLACK], dots, chosen, corners, best
            )
            out_count[i] = found
            if found == 0:
                out_color[i] = np.nan
                continue
            weigh(best, found, rules[FALLOFF], weights)
            red, green, blue = mix(color, chosen, views, corners, weights, found, rules[SHARPNESS])
            out_color[i, 0], out_color[i, 1], out_color[i, 2] = red, green, blue
