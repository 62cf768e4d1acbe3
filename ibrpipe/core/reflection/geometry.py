"""Where hits lie in their patches, and where light that reaches the eye from there came from.

Places are homogeneous field coordinates (:mod:`ibrpipe.core.rays`): ``(x, y, n, q) = place @ (X, 1)``.
"""

import math

import numpy as np
from numba import prange

from ibrpipe.core.jit import exact_kernel, fused_exact
from ibrpipe.core.ldi.search import walk_ray
from ibrpipe.core.rays import clip_box, depth_at
from ibrpipe.core.reflection.directions import table_cell
from ibrpipe.core.reflection.model import CORNERS, corner_weights

BLOCK = 128


@fused_exact
def place_in_patch(place, record, x, y, z):
    # world point -> (p, q) in [0, 1] of the patch's cell; record: column, row, field, 0, samples
    q = place[3, 0] * x + place[3, 1] * y + place[3, 2] * z + place[3, 3]
    u = (place[0, 0] * x + place[0, 1] * y + place[0, 2] * z + place[0, 3]) / q - record[0]
    v = (place[1, 0] * x + place[1, 1] * y + place[1, 2] * z + place[1, 3]) / q - record[1]
    return min(max(u, 0.0), 1.0), min(max(v, 0.0), 1.0)


@exact_kernel
def place_hits(points, ids, records, places, normals, out_traits, out_normals):
    """Fill p and q of every hit's traits, and its normal, bilinear between its patch's samples."""
    # points (N, 3) f64 world; ids (N,) i64 patches, -1 = none; records (P, 8) i32 as scene.records; places (F, 4, 4)
    # normals (S, 3) f32; out_traits (N, 12) f32; out_normals (N, 3) f64 unit, NaN where no sample has one
    for block in prange((len(points) + BLOCK - 1) // BLOCK):
        weights = np.empty(CORNERS)
        for i in range(block * BLOCK, min(block * BLOCK + BLOCK, len(points))):
            out_normals[i, 0], out_normals[i, 1], out_normals[i, 2] = np.nan, np.nan, np.nan
            if ids[i] < 0:
                continue
            record = records[ids[i]]
            p, q = place_in_patch(places[record[2]], record, points[i, 0], points[i, 1], points[i, 2])
            out_traits[i, 0], out_traits[i, 1] = p, q
            if not corner_weights(record[4:], p, q, weights):
                continue
            x, y, z = 0.0, 0.0, 0.0
            for c in range(CORNERS):
                if weights[c] > 0.0:
                    x += weights[c] * normals[record[4 + c], 0]
                    y += weights[c] * normals[record[4 + c], 1]
                    z += weights[c] * normals[record[4 + c], 2]
            length = math.sqrt(x * x + y * y + z * z)
            if length > 0.0:
                out_normals[i, 0], out_normals[i, 1], out_normals[i, 2] = x / length, y / length, z / length


@exact_kernel
def reflect(normals, toward, size, out_where, out_traits, out_reflected):
    """Fill cell, s and place in the cell of every hit, and the direction (N, 3) f64 that its mirror looks along."""
    # normals, toward (the eye) (N, 3) f64 unit; size: cells of a table's edge
    for block in prange((len(normals) + BLOCK - 1) // BLOCK):
        for i in range(block * BLOCK, min(block * BLOCK + BLOCK, len(normals))):
            nx, ny, nz = normals[i, 0], normals[i, 1], normals[i, 2]
            vx, vy, vz = toward[i, 0], toward[i, 1], toward[i, 2]
            cosine = min(max(nx * vx + ny * vy + nz * vz, 0.0), 1.0)
            off = 1.0 - cosine
            rx, ry, rz = 2.0 * cosine * nx - vx, 2.0 * cosine * ny - vy, 2.0 * cosine * nz - vz
            out_reflected[i, 0], out_reflected[i, 1], out_reflected[i, 2] = rx, ry, rz
            if math.isnan(rx):
                out_where[i, 1] = 0
                continue
            cell, fx, fy = table_cell(rx, ry, rz, size)
            out_where[i, 1] = cell
            out_traits[i, 2], out_traits[i, 3], out_traits[i, 4] = off**5, fx, fy


@exact_kernel
def search_rays(rays, place, box, grid, nodes, meta, cells, corners, masks, base, out_t, out_ids):
    """Lower out_t (N,) f64 and set out_ids (N,) i64 where free rays meet the front of one sheet of patches nearer."""
    # rays (N, 6) f64 origin, direction (t in its lengths); place (4, 4); box ... masks: see renderers.search.quadtree
    nothing = np.empty((0, 0), np.float32)
    columns, rows = int(box[0]), int(box[1])
    for block in prange((len(rays) + BLOCK - 1) // BLOCK):
        start = np.empty(4)
        for i in range(block * BLOCK, min(block * BLOCK + BLOCK, len(rays))):
            x, y, z = rays[i, 0], rays[i, 1], rays[i, 2]
            dx, dy, dz = rays[i, 3], rays[i, 4], rays[i, 5]
            for k in range(4):
                start[k] = place[k, 0] * x + place[k, 1] * y + place[k, 2] * z + place[k, 3]
            du = place[0, 0] * dx + place[0, 1] * dy + place[0, 2] * dz
            dv = place[1, 0] * dx + place[1, 1] * dy + place[1, 2] * dz
            dn = place[2, 0] * dx + place[2, 1] * dy + place[2, 2] * dz
            dq = place[3, 0] * dx + place[3, 1] * dy + place[3, 2] * dz
            near, far = clip_box(start, du, dv, dn, dq, box, out_t[i])
            if not near <= far:
                continue
            qa, qb = start[3] + near * dq, start[3] + far * dq
            u, v, d = (start[0] + near * du) / qa, (start[1] + near * dv) / qa, (start[2] + near * dn) / qa
            su, sv = (start[0] + far * du) / qb - u, (start[1] + far * dv) / qb - v
            sd = (start[2] + far * dn) / qb - d
            s, patch, _, _ = walk_ray(
                nodes, meta, nothing, cells, corners, masks, columns, rows, grid, u, v, d, su, sv, sd, near, True
            )
            if s < np.inf:
                t = depth_at(s, near, far, qa, qb)
                if t < out_t[i]:
                    out_t[i], out_ids[i] = t, base + patch
