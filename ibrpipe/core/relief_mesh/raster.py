"""Which polygon each pixel sees: triangles drawn in bands of rows, in homogeneous coordinates, so nothing is clipped.

For a triangle A, B, C seen from the eye at 0 and a pixel's direction w (camera z 1) the edge functions ``w . (B x C)``,
``w . (C x A)``, ``w . (A x B)`` have one sign inside, and ``det(A, B, C) / their sum`` is the camera depth. An edge's
function is taken in the order of its vertices' numbers, so that both faces at it get the same bits: no cracks.
"""

from __future__ import annotations

import math

import numpy as np
from numba import prange

from ibrpipe.core.jit import helper, kernel, ordered

#: rows of pixels that one thread draws
BAND = 8


@ordered
def edge_plane(vertices, i, j):
    # normal of the plane through the eye and an edge; exactly the negative for (j, i)
    a, b = (i, j) if i < j else (j, i)
    sign = 1.0 if i < j else -1.0
    x = vertices[a, 1] * vertices[b, 2] - vertices[a, 2] * vertices[b, 1]
    y = vertices[a, 2] * vertices[b, 0] - vertices[a, 0] * vertices[b, 2]
    z = vertices[a, 0] * vertices[b, 1] - vertices[a, 1] * vertices[b, 0]
    return sign * x, sign * y, sign * z


@ordered
def side_of(plane, x, y, z):
    return plane[0] * x + plane[1] * y + plane[2] * z


@kernel
def bound_faces(vertices, corners, pixel_from_world, both, width, height, out):
    # vertices (V, 3) f64 counted from the eye; pixel_from_world (3, 3) f64 = K R -> out (F, 4) i32: x0, x1, y0, y1 of
    # the pixels that a face may cover; empty where it is turned away (unless `both`), behind the eye or off the picture
    for f in prange(len(corners)):
        low_x, high_x, low_y, high_y = np.inf, -np.inf, np.inf, -np.inf
        ahead, behind = 0, 0
        for c in range(3):
            v = corners[f, c]
            x, y, z = vertices[v, 0], vertices[v, 1], vertices[v, 2]
            w = pixel_from_world[2, 0] * x + pixel_from_world[2, 1] * y + pixel_from_world[2, 2] * z
            reach = 1e-9 * (abs(x) + abs(y) + abs(z))
            if w > reach:
                ahead += 1
                px = (pixel_from_world[0, 0] * x + pixel_from_world[0, 1] * y + pixel_from_world[0, 2] * z) / w
                py = (pixel_from_world[1, 0] * x + pixel_from_world[1, 1] * y + pixel_from_world[1, 2] * z) / w
                low_x, high_x = min(low_x, px), max(high_x, px)
                low_y, high_y = min(low_y, py), max(high_y, py)
            else:
                behind += 1
        i, j, k = corners[f, 0], corners[f, 1], corners[f, 2]
        volume = side_of(edge_plane(vertices, j, k), vertices[i, 0], vertices[i, 1], vertices[i, 2])
        if ahead == 0 or volume == 0.0 or (volume > 0.0 and not both):
            out[f, 0], out[f, 1], out[f, 2], out[f, 3] = 1, 0, 1, 0
        elif behind > 0:
            out[f, 0], out[f, 1], out[f, 2], out[f, 3] = 0, width - 1, 0, height - 1
        else:
            out[f, 0] = int(math.floor(min(max(low_x - 0.5001, 0.0), width + 1.0)))
            out[f, 1] = int(math.ceil(min(max(high_x - 0.4999, -1.0), width - 1.0)))
            out[f, 2] = int(math.floor(min(max(low_y - 0.5001, 0.0), height + 1.0)))
            out[f, 3] = int(math.ceil(min(max(high_y - 0.4999, -1.0), height - 1.0)))


@helper
def draw_face(vertices, corners, f, world_from_pixel, x0, x1, y0, y1, after, limit, layer, face):
    # nearest depth beyond `after` and before `limit`, rows y0..y1; ties: the first face drawn
    i, j, k = corners[f, 0], corners[f, 1], corners[f, 2]
    jk, ki, ij = edge_plane(vertices, j, k), edge_plane(vertices, k, i), edge_plane(vertices, i, j)
    volume = side_of(jk, vertices[i, 0], vertices[i, 1], vertices[i, 2])
    sign = 1.0 if volume > 0.0 else -1.0
    volume *= sign
    for y in range(y0, y1 + 1):
        for x in range(x0, x1 + 1):
            px, py = x + 0.5, y + 0.5
            wx = world_from_pixel[0, 0] * px + world_from_pixel[0, 1] * py + world_from_pixel[0, 2]
            wy = world_from_pixel[1, 0] * px + world_from_pixel[1, 1] * py + world_from_pixel[1, 2]
            wz = world_from_pixel[2, 0] * px + world_from_pixel[2, 1] * py + world_from_pixel[2, 2]
            a, b, c = side_of(jk, wx, wy, wz) * sign, side_of(ki, wx, wy, wz) * sign, side_of(ij, wx, wy, wz) * sign
            if a >= 0.0 and b >= 0.0 and c >= 0.0 and a + b + c > 0.0:
                t = volume / (a + b + c)
                if t > after[y, x] and t < layer[y, x] and t < limit[y, x]:
                    layer[y, x] = t
                    face[y, x] = f


@kernel
def draw_faces(vertices, corners, bounds, world_from_pixel, after, limit, layer, face):
    # world_from_pixel (3, 3) f64; after (h, w) f64, limit (h, w) f32: depths between which a face must lie
    # -> layer (h, w) f64 depth of the nearest such face, face (h, w) i32, -1 = none; returned: pixels with a face
    rows, columns = layer.shape
    found = 0
    for band in prange((rows + BAND - 1) // BAND):
        first, last = np.int64(band) * BAND, min((np.int64(band) + 1) * BAND, rows) - 1
        for y in range(first, last + 1):
            for x in range(columns):
                layer[y, x], face[y, x] = np.inf, -1
        for f in range(len(corners)):
            y0, y1 = max(first, np.int64(bounds[f, 2])), min(last, np.int64(bounds[f, 3]))
            if y0 <= y1 and bounds[f, 0] <= bounds[f, 1]:
                draw_face(
                    vertices,
                    corners,
                    f,
                    world_from_pixel,
                    np.int64(bounds[f, 0]),
                    np.int64(bounds[f, 1]),
                    y0,
                    y1,
                    after,
                    limit,
                    layer,
                    face,
                )
        some = 0
        for y in range(first, last + 1):
            for x in range(columns):
                some += 1 if face[y, x] >= 0 else 0
        found += some
    return found
