"""Where each pixel's ray meets the relief under the polygon that it sees. Source: policarpo2005, sec. 3.

A pixel's point on its polygon has texture coordinates (u, v) and axes T = dP/du, B = dP/dv, N, averaged over the
corners and made orthogonal to N; deep leads from depth 0 to 1, scene units. Then ``X = P + du T + dv B - dz deep
N``, and the ray is straight in (u, v, z); the rows of the inverse of ``[T, B, -deep N]`` are the frame (3, 3) that
shading uses again.

Symbols: w direction of a pixel, camera z 1; t camera depth; ``rule``: see the names of its slots.
"""

from __future__ import annotations

import math

import numpy as np
from numba import prange

from ibrpipe.core.jit import helper, kernel
from ibrpipe.core.relief_mesh.raster import edge_plane, side_of
from ibrpipe.core.relief_mesh.search import clip_unit, layer_at, search_along, step_along

#: slots of the rule: texels across and down, cell coordinate of the texture's edge, depth of the relief, what is
#: mapped, whether the search is exact, linear and binary steps, least linear steps
ACROSS, DOWN, SHIFT, DEEP, MAPPING, EXACT, STEPS, BISECTION_STEPS, LEAST = range(9)
RULES = 9
#: what is mapped
PLAIN, BUMP, PARALLAX, RELIEF = 0.0, 1.0, 2.0, 3.0
#: slots of a pixel's scratch: frame (9), t, u, v
T, U, V, BOX = 9, 10, 11, 12
#: the averaged normal is turned until it faces the eye at least this share as much as the polygon does
FACING = 0.5


@helper
def _blend(frames, f, first, a, b, c):
    x = a * frames[f, 0, first] + b * frames[f, 1, first] + c * frames[f, 2, first]
    y = a * frames[f, 0, first + 1] + b * frames[f, 1, first + 1] + c * frames[f, 2, first + 1]
    z = a * frames[f, 0, first + 2] + b * frames[f, 1, first + 2] + c * frames[f, 2, first + 2]
    return x, y, z


@helper
def _unit(x, y, z):
    length = math.sqrt(x * x + y * y + z * z)
    share = 1.0 / length if length > 0.0 else 0.0
    return x * share, y * share, z * share


@helper
def _facing(n, g, w):
    # turn the normal n toward the face's g so far that it faces the eye
    one, other = -(n[0] * w[0] + n[1] * w[1] + n[2] * w[2]), -(g[0] * w[0] + g[1] * w[1] + g[2] * w[2])
    if one >= FACING * other or not other > 0.0:
        return n
    share = (FACING * other - one) / (other - one)
    return _unit(n[0] + share * (g[0] - n[0]), n[1] + share * (g[1] - n[1]), n[2] + share * (g[2] - n[2]))


@helper
def local_frame(vertices, corners, uv, frames, f, w, deep, box):
    # fill box -> does the polygon have a relief here? (not from behind, nor where its mapping is degenerate)
    i, j, k = corners[f, 0], corners[f, 1], corners[f, 2]
    a = side_of(edge_plane(vertices, j, k), w[0], w[1], w[2])
    b = side_of(edge_plane(vertices, k, i), w[0], w[1], w[2])
    c = side_of(edge_plane(vertices, i, j), w[0], w[1], w[2])
    share = 1.0 / (a + b + c)
    a, b, c = a * share, b * share, c * share
    px, py, pz = (
        vertices[j, 0] - vertices[i, 0],
        vertices[j, 1] - vertices[i, 1],
        vertices[j, 2] - vertices[i, 2],
    )
    qx, qy, qz = (
        vertices[k, 0] - vertices[i, 0],
        vertices[k, 1] - vertices[i, 1],
        vertices[k, 2] - vertices[i, 2],
    )
    g = _unit(py * qz - pz * qy, pz * qx - px * qz, px * qy - py * qx)
    away = g[0] * w[0] + g[1] * w[1] + g[2] * w[2] >= 0.0
    n = _unit(*_blend(frames, f, 0, a, b, c))
    n = n if away else _facing(n, g, w)
    tx, ty, tz = _blend(frames, f, 3, a, b, c)
    bx, by, bz = _blend(frames, f, 6, a, b, c)
    along, across = tx * n[0] + ty * n[1] + tz * n[2], bx * n[0] + by * n[1] + bz * n[2]
    tx, ty, tz = tx - along * n[0], ty - along * n[1], tz - along * n[2]
    bx, by, bz = bx - across * n[0], by - across * n[1], bz - across * n[2]
    area = n[0] * (ty * bz - tz * by) + n[1] * (tz * bx - tx * bz) + n[2] * (tx * by - ty * bx)
    size = math.sqrt((tx * tx + ty * ty + tz * tz) * (bx * bx + by * by + bz * bz))
    sound = abs(area) > 1e-6 * size
    over = 1.0 / area if sound else 0.0
    box[0], box[1], box[2] = (
        (by * n[2] - bz * n[1]) * over,
        (bz * n[0] - bx * n[2]) * over,
        (bx * n[1] - by * n[0]) * over,
    )
    box[3], box[4], box[5] = (
        (n[1] * tz - n[2] * ty) * over,
        (n[2] * tx - n[0] * tz) * over,
        (n[0] * ty - n[1] * tx) * over,
    )
    box[6], box[7], box[8] = -n[0] / deep, -n[1] / deep, -n[2] / deep
    box[U] = a * uv[f, 0, 0] + b * uv[f, 1, 0] + c * uv[f, 2, 0]
    box[V] = a * uv[f, 0, 1] + b * uv[f, 1, 1] + c * uv[f, 2, 1]
    return sound and not away


@helper
def linear_steps(rule, slope):
    # how many steps for a ray whose angle to the normal has the cosine `slope`
    if rule[LEAST] >= rule[STEPS]:
        return np.int64(rule[STEPS])
    return np.int64(math.ceil(rule[LEAST] + (rule[STEPS] - rule[LEAST]) * (1.0 - min(max(slope, 0.0), 1.0))))


@helper
def search_layers(front, back, lows, highs, plan, rule, ray, begin, end, solid, slope):
    # first depth by the rule's search
    if rule[EXACT] > 0.0:
        return search_along(front, back, lows, highs, plan, ray, begin, end, solid)
    return step_along(front, back, plan, ray, begin, end, linear_steps(rule, slope), np.int64(rule[BISECTION_STEPS]))


@kernel
def hit_faces(mesh, layers, rule, world_from_pixel, layer, face, depth, mine, positions, hit_frames):
    # mesh: vertices (V, 3) f64 from the eye, corners (F, 3) i64, uv (F, 3, 2) f64, frames (F, 3, 9) f32; layers: front,
    # back, lows, highs, plan; layer (h, w) f64, face (h, w) i32: polygons seen -> depth (h, w) f32 lowered where the
    # ray hits nearer, there mine (h, w) u8 = 1, and unless they are empty positions (h, w, 3) f64 = (x, y cells, z),
    # hit_frames (h, w, 9) f32
    vertices, corners, uv, frames = mesh
    front, back, lows, highs, plan = layers
    for y in prange(face.shape[0]):
        box = np.empty(BOX)
        for x in range(face.shape[1]):
            f = np.int64(face[y, x])
            if f < 0:
                continue
            px, py = x + 0.5, y + 0.5
            w = (
                world_from_pixel[0, 0] * px + world_from_pixel[0, 1] * py + world_from_pixel[0, 2],
                world_from_pixel[1, 0] * px + world_from_pixel[1, 1] * py + world_from_pixel[1, 2],
                world_from_pixel[2, 0] * px + world_from_pixel[2, 1] * py + world_from_pixel[2, 2],
            )
            t = layer[y, x]
            able = local_frame(vertices, corners, uv, frames, f, w, rule[DEEP], box)
            at_x, at_y, s = box[U] * rule[ACROSS] + rule[SHIFT], box[V] * rule[DOWN] + rule[SHIFT], 0.0
            if able and rule[MAPPING] >= PARALLAX:
                fall = box[6] * w[0] + box[7] * w[1] + box[8] * w[2]
                du = (box[0] * w[0] + box[1] * w[1] + box[2] * w[2]) / fall
                dv = (box[3] * w[0] + box[4] * w[1] + box[5] * w[2]) / fall
                dx, dy = du * rule[ACROSS], dv * rule[DOWN]
                if rule[MAPPING] == PARALLAX:
                    shift = layer_at(front, plan, at_x, at_y)
                    at_x, at_y = at_x + shift * dx, at_y + shift * dy
                else:
                    begin, end = 0.0, 1.0
                    if plan[3] == 0:
                        begin, end = clip_unit(box[U], du, begin, end)
                        begin, end = clip_unit(box[V], dv, begin, end)
                        if not begin <= end:
                            continue
                    slope = fall * rule[DEEP] / math.sqrt(w[0] * w[0] + w[1] * w[1] + w[2] * w[2])
                    ray = (at_x, at_y, 0.0, dx, dy, 1.0)
                    s = search_layers(front, back, lows, highs, plan, rule, ray, begin, end, True, slope)
                    if not s < np.inf:
                        continue
                    at_x, at_y, t = at_x + s * dx, at_y + s * dy, t + s / fall
            if not t < depth[y, x]:
                continue
            depth[y, x] = t
            mine[y, x] = 1
            if positions.shape[0] > 0:
                positions[y, x, 0], positions[y, x, 1], positions[y, x, 2] = at_x, at_y, s
                for k in range(9):
                    hit_frames[y, x, k] = box[k]
