"""Nearest spiral samples of a direction, and their interpolation at a surface point. Source: gong-yang, sec. 5.2.

Symbols: q yaw in [0, 2 pi), p pitch (angle from the outward normal), t round of the spiral below the direction.

Kernels take all T textures with their D images as three tuples. ``frames``: rotations (T, 3, 3) f64, rows a, b, -f of
the rectangles; origins (T, 3) f64; scales (T, 2) f64, 1 / edge lengths. ``spirals``: alphas (D,) f64; k (T,) f64;
greatest pitch (T,) f64; images of the closing turn (T,) i64; first image (T + 1,) i64. ``images``: directions (D, 3)
f64; sizes (D, 2) i32, height and width; starts (D + 1,) i64, first texel; texels (N, 4) u8 or f32, the last channel
says whether it is valid; zero (D,) f64, code of nothing.
"""

import math

import numpy as np
from numba import prange

from ibrpipe.core.jit import helper, kernel
from ibrpipe.core.spiral.directions import lower_bound

TURN = 2.0 * math.pi


@helper
def neighbours(x, y, z, alphas, first, last, k, limit, closing, indices, weights):
    """Fill indices (4,) i64 and weights (4,) f64 of the samples around direction (x, y, z) among alphas[first:last].

    Two lie on round t and two on round t + 1; weights are linear along the spiral and across its turns. The pole
    stands in for the round before the first. `closing` is how many samples at the end of `alphas` run along the
    horizon at pitch `limit` (0: the published spiral, whose last sample stands in past its end).
    """
    p = math.atan2(math.sqrt(x * x + y * y), z)
    q = math.atan2(y, x)
    if q < 0.0:
        q += TURN
    if q >= TURN:
        q = 0.0
    t = math.floor((p - k * q) / (TURN * k))
    if t < 0.0:
        indices[0], indices[1], weights[0], weights[1] = first, first, 1.0, 0.0
        low = 0.0
        above = q
    else:
        here = TURN * t + q
        if closing > 0 and k * here >= limit:  # on or past the closing turn
            along(here, alphas, first, last, closing, 0, indices, weights)
            indices[2], indices[3], weights[2], weights[3] = first, first, 0.0, 0.0
            return
        along(here, alphas, first, last, closing, 0, indices, weights)
        low = k * here
        above = here + TURN
    along(above, alphas, first, last, closing, 2, indices, weights)
    high = k * above
    if closing > 0:
        high = min(high, limit)
    s = min(max((p - low) / (high - low), 0.0), 1.0) if high > low else 1.0
    weights[0] *= 1.0 - s
    weights[1] *= 1.0 - s
    weights[2] *= s
    weights[3] *= s


@helper
def along(alpha, alphas, first, last, closing, at, indices, weights):
    """Fill entries `at` and `at + 1` with the two samples around alpha on the spiral alphas[first:last]."""
    circle = last - closing
    if closing > 0 and alpha >= alphas[circle]:  # the closing turn is a circle
        alpha = alphas[circle] + (alpha - alphas[circle]) % TURN
    i = lower_bound(alphas, first, last, alpha)
    if i < last - 1:
        below, beyond = alphas[i], alphas[i + 1]
        indices[at], indices[at + 1] = i, i + 1
    elif closing > 0:
        below, beyond = alphas[i], alphas[circle] + TURN
        indices[at], indices[at + 1] = i, circle
    else:
        indices[at], indices[at + 1] = i, i
        weights[at], weights[at + 1] = 1.0, 0.0
        return
    s = (alpha - below) / (beyond - below)
    weights[at], weights[at + 1] = 1.0 - s, s


@helper
def residual_at(point, images, scale, indices, weights, total):
    """Add the residuals of four images at a surface point to total (4,) f64: weighted R, G, B, and weight.

    The point (three f64) is in the rectangle's frame: in [0, 1] along its edges, and the depth below it; `scale` (two
    f64, 1 / edge lengths) turns a shift along the plane into those units. Every image is read where the ray from the
    point along the image's own direction meets the rectangle (depth correction, gong-yang, fig. 6).
    """
    directions, sizes, starts, texels, zero = images
    (sx, sy, sz), (scale_u, scale_v) = point, scale
    for n in range(4):
        w = weights[n]
        if w <= 0.0:
            continue
        i = indices[n]
        dz = directions[i, 2]
        u = sx + sz * directions[i, 0] / dz * scale_u
        v = sy + sz * directions[i, 1] / dz * scale_v
        height, width = sizes[i, 0], sizes[i, 1]
        fx, fy = u * width - 0.5, v * height - 0.5
        if not (fx > -1.0 and fy > -1.0 and fx < width and fy < height):
            continue
        column, row = int(math.floor(fx)), int(math.floor(fy))
        fx -= column
        fy -= row
        for corner in range(4):
            right, below = corner % 2, corner // 2
            c, r = column + right, row + below
            if c < 0 or r < 0 or c >= width or r >= height:
                continue
            texel = starts[i] + r * width + c
            if texels[texel, 3] == 0:
                continue
            part = w * (fx if right else 1.0 - fx) * (fy if below else 1.0 - fy)
            total[0] += part * (float(texels[texel, 0]) - zero[i])
            total[1] += part * (float(texels[texel, 1]) - zero[i])
            total[2] += part * (float(texels[texel, 2]) - zero[i])
            total[3] += part


@kernel
def shade(color, depth, grid, eye, world_from_pixel, frames, spirals, images, coded, encode, lost):
    """Add interpolated residuals to every pixel that is hit.

    Each view ray asks the texture through whose rectangle it passes; where some of the four samples lie outside that
    rectangle, the textures whose rectangles they pass through fill in, and all weights are normalised together.
    """
    # color (H, W, 3) f32 linear, in and out; depth (H, W) f32 along camera z; eye (3,), world_from_pixel (3, 3) f64
    # grid = (rows (H, 2), columns (W, 2)) f64: ray (y, x) passes through rows[y] + columns[x] of the picture
    # frames, spirals, images: see above; coded: residuals are in display code
    # encode (E,) f32: display code of linear i / (E - 1); lost (H,) i64: hit pixels that found no residual
    rotations, origins, scales = frames
    alphas, ks, limits, closings, image_ranges = spirals
    directions, sizes, starts, texels, zero = images
    height, width = depth.shape
    textures = len(origins)
    for row in prange(height):
        indices, weights, total = np.empty(4, np.int64), np.empty(4), np.empty(4)
        local, view = np.empty((textures, 3)), np.empty((textures, 3))
        order = np.empty(textures)
        lost[row] = 0
        for column in range(width):
            z = depth[row, column]
            if not z < np.inf:
                continue
            wx, wy, wz = pixel_ray(
                world_from_pixel, grid[0][row, 0] + grid[1][column, 0], grid[0][row, 1] + grid[1][column, 1]
            )
            length = math.sqrt(wx * wx + wy * wy + wz * wz)
            for t in range(textures):
                into_rectangle(
                    eye[0] + z * wx, eye[1] + z * wy, eye[2] + z * wz, -wx / length, -wy / length, -wz / length,
                    rotations, origins, scales, t, local, view
                )  # fmt: skip
                order[t] = preference(local, view, scales, t)
            total[:] = 0.0
            for _ in range(textures):
                t = int(np.argmax(order))
                if order[t] <= -1.0:
                    break
                order[t] = -2.0
                first, last = image_ranges[t], image_ranges[t + 1]
                neighbours(
                    view[t, 0], view[t, 1], view[t, 2], alphas, first, last, ks[t], limits[t], closings[t], indices,
                    weights
                )  # fmt: skip
                residual_at(
                    (local[t, 0], local[t, 1], local[t, 2]), (directions, sizes, starts, texels, zero),
                    (scales[t, 0], scales[t, 1]), indices, weights, total
                )  # fmt: skip
                if total[3] > 0.98:
                    break
            if total[3] < 1e-3:
                lost[row] += 1
                continue
            for c in range(3):
                add(color, row, column, c, total[c] / total[3], coded, encode)


@helper
def pixel_ray(world_from_pixel, x, y):
    """World direction of the ray through (x, y) of the picture, one unit of depth long."""
    return (
        world_from_pixel[0, 0] * x + world_from_pixel[0, 1] * y + world_from_pixel[0, 2],
        world_from_pixel[1, 0] * x + world_from_pixel[1, 1] * y + world_from_pixel[1, 2],
        world_from_pixel[2, 0] * x + world_from_pixel[2, 1] * y + world_from_pixel[2, 2],
    )


@helper
def into_rectangle(px, py, pz, dx, dy, dz, rotations, origins, scales, t, local, view):
    """Bring a world point and the direction to the viewer into rectangle t's frame: row t of local and view."""
    px -= origins[t, 0]
    py -= origins[t, 1]
    pz -= origins[t, 2]
    for r in range(3):
        local[t, r] = rotations[t, r, 0] * px + rotations[t, r, 1] * py + rotations[t, r, 2] * pz
        view[t, r] = rotations[t, r, 0] * dx + rotations[t, r, 1] * dy + rotations[t, r, 2] * dz
    local[t, 0] *= scales[t, 0]
    local[t, 1] *= scales[t, 1]
    local[t, 2] = -local[t, 2]


@helper
def preference(local, view, scales, t):
    """How well texture t serves the view ray: 1 + z inside its rectangle, less the distance outside; -1 never."""
    z = view[t, 2]
    if z <= 0.02:
        return -1.0
    u = local[t, 0] + local[t, 2] * view[t, 0] / z * scales[t, 0]
    v = local[t, 1] + local[t, 2] * view[t, 1] / z * scales[t, 1]
    outside = max(max(-u, u - 1.0), max(-v, v - 1.0))
    if outside <= 0.0:
        return 1.0 + z
    return z / (1.0 + outside) - 0.5


@helper
def add(color, row, column, channel, residual, coded, encode):
    """Add one residual to one channel, in display code or in linear light."""
    value = color[row, column, channel]
    if not coded:
        color[row, column, channel] = max(value + residual, 0.0)
        return
    color[row, column, channel] = decoded(coded_of(value, encode) + residual / 255.0)


@helper
def decoded(code):
    """Linear light of a display code, 0 below 0."""
    return max(code, 0.0) / 12.92 if code <= 0.04045 else math.pow((code + 0.055) / 1.055, 2.4)


@helper
def encoded(light):
    """Display code of linear light above 0.0031308."""
    return 1.055 * math.pow(light, 1.0 / 2.4) - 0.055


@helper
def coded_of(value, encode):
    """Display code of linear light: table with linear interpolation below 1, the formula above."""
    last = len(encode) - 1
    if value >= 1.0:
        return encoded(value)
    at = math.sqrt(max(value, 0.0)) * last
    i = int(at)
    return encode[i] + (at - i) * (encode[min(i + 1, last)] - encode[i])
