"""Where hits lie in their patches, and where light that reaches the eye from there came from.

Positions are homogeneous field coordinates (:mod:`ibrpipe.core.rays`): ``(x, y, n, q) = pose @ (X, 1)``.
"""

import math

import numpy as np
from numba import prange

from ibrpipe.core.jit import exact_kernel, fused_exact
from ibrpipe.core.reflection.directions import table_cell
from ibrpipe.core.reflection.model import CORNERS, corner_weights, mirror

BLOCK = 128


@fused_exact
def patch_position(pose, record, x, y, z):
    # world point -> (p, q) in [0, 1] of the patch's cell; record: column, row, field, 0, samples
    q = pose[3, 0] * x + pose[3, 1] * y + pose[3, 2] * z + pose[3, 3]
    u = (pose[0, 0] * x + pose[0, 1] * y + pose[0, 2] * z + pose[0, 3]) / q - record[0]
    v = (pose[1, 0] * x + pose[1, 1] * y + pose[1, 2] * z + pose[1, 3]) / q - record[1]
    return min(max(u, 0.0), 1.0), min(max(v, 0.0), 1.0)


@exact_kernel
def place_hits(points, ids, records, poses, normals, out_traits, out_normals):
    """Fill p and q of every hit's traits, and its normal, bilinear between its patch's samples."""
    # points (N, 3) f64 world; ids (N,) i64 patches, -1 = none; records (P, 8) i32 as scene.records; poses (F, 4, 4)
    # normals (S, 3) f32; out_traits (N, 12) f32; out_normals (N, 3) f64 unit, NaN where no sample has one
    for block in prange((len(points) + BLOCK - 1) // BLOCK):
        weights = np.empty(CORNERS)
        for i in range(block * BLOCK, min(block * BLOCK + BLOCK, len(points))):
            out_normals[i, 0], out_normals[i, 1], out_normals[i, 2] = np.nan, np.nan, np.nan
            if ids[i] < 0:
                continue
            record = records[ids[i]]
            p, q = patch_position(poses[record[2]], record, points[i, 0], points[i, 1], points[i, 2])
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
    """Fill cell, s and position in the cell of every hit, and the direction (N, 3) f64 that its mirror looks along."""
    # normals, toward (the eye) (N, 3) f64 unit; size: cells of a table's edge
    for block in prange((len(normals) + BLOCK - 1) // BLOCK):
        for i in range(block * BLOCK, min(block * BLOCK + BLOCK, len(normals))):
            rx, ry, rz, s = mirror(
                normals[i, 0], normals[i, 1], normals[i, 2], toward[i, 0], toward[i, 1], toward[i, 2]
            )
            out_reflected[i, 0], out_reflected[i, 1], out_reflected[i, 2] = rx, ry, rz
            if math.isnan(rx):
                out_where[i, 1] = 0
                continue
            cell, fx, fy = table_cell(rx, ry, rz, size)
            out_where[i, 1] = cell
            out_traits[i, 2], out_traits[i, 3], out_traits[i, 4] = s, fx, fy
