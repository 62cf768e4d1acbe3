"""Colours of a whole picture from kept photos: at every pixel the best of those that see its point (buehler2001).

The photos of a place, and their weights, are those of :mod:`ibrpipe.core.appearance.photo_blend`. Packed arguments:
``photos`` as there, with codes as bytes (T, 3) u8 and the mask u8; ``surface`` (records (P, 8) i32 as scene.records;
normals (S, 3) f32; active (F,) bool: fields that take their colours from photos).
"""

import math

import numpy as np
from numba import prange

from ibrpipe.core.appearance.photo_blend import COS_MIN, FALLOFF, SHARPNESS, SLACK, best_photos, mix, weigh
from ibrpipe.core.jit import helper, kernel
from ibrpipe.core.reflection.picture import mean_normal, pixel_ray, weigh_corners

#: rows that are drawn together
ROWS = 4


@helper
def normal_toward(point, toward, patch, records, poses, normals, weights):
    """Unit normal of a patch at a point on the side of unit direction `toward`; that direction where none is known."""
    if not weigh_corners(point[0], point[1], point[2], patch, records, poses, weights):
        return toward
    nx, ny, nz = mean_normal(normals, records, patch, weights)
    length = math.sqrt(nx * nx + ny * ny + nz * nz)
    if not length > 0.0:
        return toward
    if nx * toward[0] + ny * toward[1] + nz * toward[2] < 0.0:
        length = -length
    return nx / length, ny / length, nz / length


@helper
def decoded(code, table):
    """Linear light of a display code, by a table of equal steps from 0 to its top; code in steps."""
    low = min(max(int(code), 0), len(table) - 2)
    part = min(max(code - low, 0.0), 1.0)
    return (1.0 - part) * table[low] + part * table[low + 1]


@kernel
def draw_photos(picture, color, view, surface, poses, photos, most, rules, table, out_counts):
    """Colour the pixels of color (H, W, 3) f32 that photos see; out_counts (H, 2) i64: pixels asked, and seen."""
    # picture: depth (H, W) f32, inf = none; ids (H, W) u32; known (H, W) f32; view = (world from pixel (3, 3), centre
    # (3,), rows (H, 2), columns (W, 2)) f64: ray (y, x) passes through rows[y] + columns[x] of the camera's picture
    # poses (F, 4, 4) f64 field from world; most i64, photos of a pixel; rules (4,) f64: see photo_blend; table
    # (N,) f32: linear light of codes 0 to 255 in equal steps
    depth, ids, known = picture
    world_from_pixel, eye, rows, columns = view
    records, normals, active = surface
    projection, centers, sizes, starts, codes, far, mask = photos
    step = (len(table) - 1) / 255.0
    for block in prange((color.shape[0] + ROWS - 1) // ROWS):
        views = projection, centers, sizes, starts, far, mask
        dots, corner_weights = np.empty(len(centers)), np.empty(4)
        chosen, corners, best = np.empty(most, np.int64), np.empty((most, 4, 2)), np.empty(most)
        weights = np.empty(most)
        for y in range(block * ROWS, min(block * ROWS + ROWS, color.shape[0])):
            for x in range(color.shape[1]):
                z, patch = float(depth[y, x]), np.int64(ids[y, x])
                if not (z < np.inf and known[y, x] > 0.0 and patch < len(records)):
                    continue
                if not active[records[patch, 2]]:
                    continue
                wx, wy, wz = pixel_ray(world_from_pixel, rows[y, 0] + columns[x, 0], rows[y, 1] + columns[x, 1])
                point = eye[0] + z * wx, eye[1] + z * wy, eye[2] + z * wz
                back = -1.0 / math.sqrt(wx * wx + wy * wy + wz * wz)
                toward = back * wx, back * wy, back * wz
                normal = normal_toward(point, toward, patch, records, poses, normals, corner_weights)
                found = best_photos(
                    point, normal, toward, views, rules[COS_MIN], rules[SLACK], dots, chosen, corners, best
                )
                out_counts[y, 0] += 1
                if found == 0:
                    continue
                out_counts[y, 1] += 1
                weigh(best, found, rules[FALLOFF], weights)
                red, green, blue = mix(codes, chosen, views, corners, weights, found, rules[SHARPNESS])
                color[y, x, 0] = decoded(step * red, table)
                color[y, x, 1] = decoded(step * green, table)
                color[y, x, 2] = decoded(step * blue, table)
