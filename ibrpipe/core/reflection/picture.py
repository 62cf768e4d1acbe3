"""Gloss of a whole picture in one pass: position, normal, mirrored direction and colour of pixels whose ray is free.

Pixels whose reflected ray may meet the surface again are left to the caller, who follows it. The arithmetic is that of
:mod:`ibrpipe.core.reflection.geometry` and :mod:`ibrpipe.core.reflection.model`.
"""

import math

import numpy as np
from numba import prange

from ibrpipe.core.jit import exact_kernel, fused_exact
from ibrpipe.core.reflection.directions import table_cell
from ibrpipe.core.reflection.geometry import patch_position
from ibrpipe.core.reflection.model import CHANNELS, CORNERS, TABLES, corner_weights, mix_texels, table_light
from ibrpipe.core.reflection.occupancy import sheets_of_ray

#: what `shade_free` says of a pixel
UNTOUCHED, SHADED, LEFT = 0, 1, 2


@fused_exact
def mean_normal(normals, samples, weights):
    """Unit normal of a position between samples; NaN where none is known."""
    x, y, z = 0.0, 0.0, 0.0
    for c in range(CORNERS):
        if weights[c] > 0.0:
            x += weights[c] * normals[samples[c], 0]
            y += weights[c] * normals[samples[c], 1]
            z += weights[c] * normals[samples[c], 2]
    length = math.sqrt(x * x + y * y + z * z)
    if not length > 0.0:
        return np.nan, np.nan, np.nan
    return x / length, y / length, z / length


@fused_exact
def mirror_ray(toward, normal):
    """Cosine between the eye, along `toward` (any length), and a unit normal; then the mirrored direction."""
    back = 1.0 / math.sqrt(toward[0] * toward[0] + toward[1] * toward[1] + toward[2] * toward[2])
    vx, vy, vz = toward[0] * back, toward[1] * back, toward[2] * back
    cosine = min(max(normal[0] * vx + normal[1] * vy + normal[2] * vz, 0.0), 1.0)
    twice = 2.0 * cosine
    return cosine, (twice * normal[0] - vx, twice * normal[1] - vy, twice * normal[2] - vz)


@fused_exact
def put_light(mixed, model, cosine, direction, out):
    """Fill out (3,) with the light of a position whose reflected ray is free; mixed: see `mix_texels`."""
    texels, tables, law = model
    width = int(math.sqrt(tables.shape[1]) + 0.5)
    s = (1.0 - cosine) ** 5
    cell, fx, fy = table_cell(direction[0], direction[1], direction[2], width - 2)
    for channel in range(CHANNELS):
        light = (1.0 - law[0] * s) * mixed[channel]
        for table in range(tables.shape[0]):
            f = law[2 + table]
            share = mixed[CHANNELS + table] if texels.shape[1] > CHANNELS else 1.0
            light += share * (f + (1.0 - f) * s) * table_light(tables[table], cell, width, fx, fy, channel)
        out[channel] = light


@exact_kernel
def shade_free(depth, ids, known, color, view, surface, model, grid, always, lift, out_state):
    """Set color (H, W, 3) f32 where the reflected ray is free; fill out_state (H, W) u8."""
    # depth (H, W) f32, inf = none; ids (H, W) u32; known (H, W) f32; view = (world from pixel (3, 3), centre (3,),
    # rows (H, 2), columns (W, 2)) f64: ray (y, x) passes through rows[y] + columns[x] of the picture
    # surface: records, corners, poses, normals, active (F,) bool; model: texels, padded tables, law; grid, always: see
    # :mod:`ibrpipe.core.reflection.occupancy`
    # lift (2,) f64: how far above the surface, and along its direction, a reflected ray starts
    records, corners, poses, normals, active = surface
    turn, eye, rows, columns = view
    for y in prange(depth.shape[0]):
        weights, mixed = np.empty(CORNERS), np.empty(CHANNELS + TABLES)
        for x in range(depth.shape[1]):
            out_state[y, x] = UNTOUCHED
            far, patch = float(depth[y, x]), np.int64(ids[y, x])
            if not (far < np.inf and known[y, x] > 0.0 and patch < len(records)):
                continue
            record = records[patch]
            if not active[record[2]]:
                continue
            px, py = rows[y, 0] + columns[x, 0], rows[y, 1] + columns[x, 1]
            wx = far * (px * turn[0, 0] + py * turn[0, 1] + turn[0, 2])
            wy = far * (px * turn[1, 0] + py * turn[1, 1] + turn[1, 2])
            wz = far * (px * turn[2, 0] + py * turn[2, 1] + turn[2, 2])
            ax, ay, az = eye[0] + wx, eye[1] + wy, eye[2] + wz
            p, q = patch_position(poses[record[2]], record, ax, ay, az)
            out_state[y, x] = LEFT
            if not corner_weights(record[4:], p, q, weights):
                continue
            n = mean_normal(normals, record[4:], weights)
            if math.isnan(n[0]):
                continue
            cosine, r = mirror_ray((-wx, -wy, -wz), n)
            sx, sy, sz = ax + lift[0] * n[0], ay + lift[0] * n[1], az + lift[0] * n[2]
            start = (sx + lift[1] * r[0], sy + lift[1] * r[1], sz + lift[1] * r[2])
            if sheets_of_ray(start, r, grid, always) != 0 or not corner_weights(corners[patch], p, q, weights):
                continue
            mix_texels(model[0], corners[patch], weights, mixed)
            put_light(mixed, model, cosine, r, color[y, x])
            out_state[y, x] = SHADED
