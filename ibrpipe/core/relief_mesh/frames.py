"""Normal and texture axes of every corner of a textured mesh, made anew for every set of vertices.

Corners average the faces around their vertex by angle: normals over the faces that bend less than a crease, texture
axes over those of them that also carry the same texture coordinates there, but for whole textures, and run the same way
round. The axes are lengths per texture (dP/du, dP/dv), so that scale, skew and mirroring of the mapping are kept.
Source: policarpo2005, sec. 3, where they are unit vectors.
"""

from __future__ import annotations

import math

import numpy as np
from numba import prange

from ibrpipe.core.jit import helper, kernel

#: numbers of a face: unit normal, dP/du, dP/dv, angles of its corners, which way round its texture runs (0: nowhere)
FACE_SIZE = 13


@helper
def _angle(ax, ay, az, bx, by, bz):
    x, y, z = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    return math.atan2(math.sqrt(x * x + y * y + z * z), ax * bx + ay * by + az * bz)


@kernel
def face_axes(vertices, corners, uv, out):
    # vertices (V, 3) f64, corners (F, 3) i64, uv (F, 3, 2) f64 -> out (F, 13) f64
    for f in prange(len(corners)):
        i, j, k = corners[f, 0], corners[f, 1], corners[f, 2]
        ax, ay, az = vertices[i, 0], vertices[i, 1], vertices[i, 2]
        px, py, pz = vertices[j, 0] - ax, vertices[j, 1] - ay, vertices[j, 2] - az
        qx, qy, qz = vertices[k, 0] - ax, vertices[k, 1] - ay, vertices[k, 2] - az
        x, y, z = py * qz - pz * qy, pz * qx - px * qz, px * qy - py * qx
        length = math.sqrt(x * x + y * y + z * z)
        share = 1.0 / length if length > 0.0 else 0.0
        out[f, 0], out[f, 1], out[f, 2] = x * share, y * share, z * share
        pu, pv = uv[f, 1, 0] - uv[f, 0, 0], uv[f, 1, 1] - uv[f, 0, 1]
        qu, qv = uv[f, 2, 0] - uv[f, 0, 0], uv[f, 2, 1] - uv[f, 0, 1]
        area = pu * qv - pv * qu
        sound = abs(area) > 1e-12 * (abs(pu * qv) + abs(pv * qu)) and length > 0.0
        over = 1.0 / area if sound else 0.0
        out[f, 3], out[f, 4], out[f, 5] = (
            (px * qv - qx * pv) * over,
            (py * qv - qy * pv) * over,
            (pz * qv - qz * pv) * over,
        )
        out[f, 6], out[f, 7], out[f, 8] = (
            (qx * pu - px * qu) * over,
            (qy * pu - py * qu) * over,
            (qz * pu - pz * qu) * over,
        )
        out[f, 9] = _angle(px, py, pz, qx, qy, qz)
        out[f, 10] = _angle(qx - px, qy - py, qz - pz, -px, -py, -pz)
        out[f, 11] = _angle(-qx, -qy, -qz, px - qx, py - qy, pz - qz)
        out[f, 12] = (1.0 if area > 0.0 else -1.0) if sound else 0.0


@kernel
def corner_frames(corners, uv, starts, around, faces, cos_crease, smooth, out):
    # starts, around: CSR of the faces around each vertex; faces (F, 13) f64; smooth: normals heed no crease
    # -> out (F, 3, 9) f32: unit normal, dP/du, dP/dv of each corner
    for f in prange(len(corners)):
        sums = np.empty(9)
        for c in range(3):
            vertex, total = corners[f, c], 0.0
            for k in range(9):
                sums[k] = 0.0
            for at in range(starts[vertex], starts[vertex + 1]):
                other, corner = around[at], 0
                while corners[other, corner] != vertex:
                    corner += 1
                bend = faces[f, 0] * faces[other, 0] + faces[f, 1] * faces[other, 1] + faces[f, 2] * faces[other, 2]
                near = other == f or bend >= cos_crease
                weight = faces[other, 9 + corner]
                if near or smooth:
                    for axis in range(3):
                        sums[axis] += weight * faces[other, axis]
                u, v = uv[other, corner, 0] - uv[f, c, 0], uv[other, corner, 1] - uv[f, c, 1]
                same = abs(u - round(u)) < 1e-9 and abs(v - round(v)) < 1e-9
                if near and (same or other == f) and faces[other, 12] == faces[f, 12]:
                    total += weight
                    for axis in range(3, 9):
                        sums[axis] += weight * faces[other, axis]
            length = math.sqrt(sums[0] * sums[0] + sums[1] * sums[1] + sums[2] * sums[2])
            share = 1.0 / total if total > 0.0 else 0.0
            for axis in range(3):
                out[f, c, axis] = sums[axis] / length if length > 0.0 else faces[f, axis]
            for axis in range(3, 9):
                out[f, c, axis] = sums[axis] * share
