"""Plane hypotheses of PatchMatch stereo: inverse depth and its gradient over the picture.

On a plane, inverse depth is linear in pixel coordinates. A hypothesis of a pixel is ``(q, a, b)``: inverse depth q at
the pixel's centre, and its change a, b per pixel to the right and down. The unit normal that faces the camera is
``-K^T (a, b, q - a x - b y)`` normalised.

Symbols: ``lens (4,)`` = fx, fy, cx, cy (no skew: it is folded away by the caller).
"""

from __future__ import annotations

import math

import numpy as np
from numba import prange

from ibrpipe.core.jit import exact_kernel, fused_exact

MASK = 0xFFFFFFFF
#: greatest cosine between a plane's normal (facing the camera) and the viewing ray: 82 degrees from frontal
STEEPEST = -0.14


@fused_exact
def hashed(seed, pixel, sweep_number, salt):
    # a number 0..2^32-1 from four whole numbers (two rounds of a 32-bit mixer with multipliers below 2^31)
    h = (seed * 0x21F0AAAD + pixel) & MASK
    for extra in (sweep_number, salt):
        h ^= h >> 16
        h = (h * 0x21F0AAAD) & MASK
        h ^= h >> 15
        h = ((h ^ extra) * 0x735A2D97) & MASK
        h ^= h >> 15
    h ^= h >> 16
    h = (h * 0x21F0AAAD) & MASK
    return h ^ (h >> 15)


@fused_exact
def uniform(seed, pixel, sweep_number, salt):
    # 0 <= number < 1
    return hashed(seed, pixel, sweep_number, salt) / 4294967296.0


@fused_exact
def tilted(q, nx, ny, nz, x, y, lens):
    # inverse depth at pixel (x, y) and a normal -> (a, b) of the plane
    g0, g1 = nx / lens[0], ny / lens[1]
    g2 = nz - g0 * lens[2] - g1 * lens[3]
    scale = q / (g0 * x + g1 * y + g2)
    return g0 * scale, g1 * scale


@fused_exact
def facing(q, a, b, x, y, lens):
    # hypothesis at pixel centre (x, y) -> unit normal that faces the camera
    nx, ny = -a * lens[0], -b * lens[1]
    nz = -(a * lens[2] + b * lens[3] + q - a * x - b * y)
    length = math.sqrt(nx * nx + ny * ny + nz * nz)
    if not length > 0.0:
        return 0.0, 0.0, -1.0
    return nx / length, ny / length, nz / length


@fused_exact
def towards(nx, ny, nz, x, y, lens):
    # bend a direction so that it faces the camera at pixel (x, y) and is not too steep -> unit normal
    rx, ry, rz = (x - lens[2]) / lens[0], (y - lens[3]) / lens[1], 1.0
    inverse = 1.0 / math.sqrt(rx * rx + ry * ry + 1.0)
    rx, ry, rz = rx * inverse, ry * inverse, rz * inverse
    length = math.sqrt(nx * nx + ny * ny + nz * nz)
    if not length > 1e-12:
        return -rx, -ry, -rz
    nx, ny, nz = nx / length, ny / length, nz / length
    along = nx * rx + ny * ry + nz * rz
    if along > 0.0:
        nx, ny, nz, along = -nx, -ny, -nz, -along
    if along > STEEPEST:
        sx, sy, sz = nx - along * rx, ny - along * ry, nz - along * rz
        side = math.sqrt((1.0 - STEEPEST * STEEPEST) / max(1.0 - along * along, 1e-12))
        nx, ny, nz = sx * side + STEEPEST * rx, sy * side + STEEPEST * ry, sz * side + STEEPEST * rz
    return nx, ny, nz


@fused_exact
def random_normal(seed, pixel, sweep_number, salt, x, y, lens):
    # evenly over the half-sphere that faces the camera
    z = 2.0 * uniform(seed, pixel, sweep_number, salt) - 1.0
    phi = 6.283185307179586 * uniform(seed, pixel, sweep_number, salt + 1)
    r = math.sqrt(max(1.0 - z * z, 0.0))
    return towards(r * math.cos(phi), r * math.sin(phi), z, x, y, lens)


@exact_kernel
def random_planes(lens, valid, low, high, seed, state):
    # valid (H, W) u8; low, high: inverse depth -> state (4, H, W) f32: planes q, a, b (0 where not valid), cost inf
    for i in prange(valid.shape[0]):
        for j in range(valid.shape[1]):
            q, a, b = 0.0, 0.0, 0.0
            if valid[i, j]:
                pixel = i * valid.shape[1] + j
                x, y = j + 0.5, i + 0.5
                q = low + (high - low) * uniform(seed, pixel, 0, 0)
                nx, ny, nz = random_normal(seed, pixel, 0, 1, x, y, lens)
                a, b = tilted(q, nx, ny, nz, x, y, lens)
            state[0, i, j], state[1, i, j], state[2, i, j], state[3, i, j] = q, a, b, np.inf


@exact_kernel
def depths_and_normals(lens, state, depth, normal):
    # state (4, H, W) f32 -> depth (H, W) f32 (0 = unknown), normal (H, W, 3) f32, unit, facing the camera
    for i in prange(depth.shape[0]):
        for j in range(depth.shape[1]):
            q = float(state[0, i, j])
            known = q > 0.0
            depth[i, j] = 1.0 / q if known else 0.0
            nx, ny, nz = facing(q, float(state[1, i, j]), float(state[2, i, j]), j + 0.5, i + 0.5, lens)
            normal[i, j, 0] = nx if known else 0.0
            normal[i, j, 1] = ny if known else 0.0
            normal[i, j, 2] = nz if known else 0.0
