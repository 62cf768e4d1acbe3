"""Smooth normals that keep creases: every corner of a face averages the faces around its vertex that bend less."""

import math

import numpy as np
from numba import prange

from ibrpipe.core.jit import kernel


def weld(vertices):
    """(V,) i64: one number for all vertices at the same position (texture seams split vertices that are one point)."""
    _, number = np.unique(vertices, axis=0, return_inverse=True)
    return number.reshape(-1)


def incidence(corners, count):
    """Faces around every vertex as CSR: (starts (count + 1,), faces) for corners (F, 3) of welded vertices."""
    flat = corners.reshape(-1)
    order = np.argsort(flat, kind="stable")
    starts = np.searchsorted(flat[order], np.arange(count + 1))
    return starts.astype(np.int64), (order // 3).astype(np.int64)


def face_normals(vertices, faces):
    """(F, 3) f64 normals whose length is twice the face's area; counter-clockwise faces point outward."""
    a, b, c = vertices[faces[:, 0]], vertices[faces[:, 1]], vertices[faces[:, 2]]
    return np.cross(b - a, c - a)


def corner_normals(vertices, faces, crease_deg=40.0):
    """(F, 3, 3) f32 unit normal of every face corner, averaged by angle over faces within `crease_deg`."""
    number = weld(vertices)
    corners = number[faces].astype(np.int64)
    starts, around = incidence(corners, int(number.max()) + 1)
    normals = face_normals(vertices, faces)
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    unit = normals / np.where(lengths > 0, lengths, 1.0)
    out = np.empty((len(faces), 3, 3), np.float32)
    _corner_normals(
        corners, starts, around, unit, corner_angles(vertices, faces), math.cos(math.radians(crease_deg)), out
    )
    return out


def corner_angles(vertices, faces):
    """(F, 3) f64 angle of every corner in radians."""
    out = np.empty(faces.shape)
    for c in range(3):
        p = vertices[faces[:, c]]
        e, g = vertices[faces[:, (c + 1) % 3]] - p, vertices[faces[:, (c + 2) % 3]] - p
        sine = np.linalg.norm(np.cross(e, g), axis=1)
        out[:, c] = np.arctan2(sine, (e * g).sum(axis=1))
    return out


@kernel
def _corner_normals(corners, starts, around, unit, angles, cos_crease, out):
    # corners (F, 3) i64 welded; starts, around CSR of faces; unit (F, 3) f64; angles (F, 3) f64; out (F, 3, 3) f32
    for face in prange(len(corners)):
        for c in range(3):
            vertex = corners[face, c]
            x, y, z = 0.0, 0.0, 0.0
            for i in range(starts[vertex], starts[vertex + 1]):
                other = around[i]
                bend = unit[face, 0] * unit[other, 0] + unit[face, 1] * unit[other, 1] + unit[face, 2] * unit[other, 2]
                if other != face and bend < cos_crease:
                    continue
                corner = 0
                while corners[other, corner] != vertex:
                    corner += 1
                x += angles[other, corner] * unit[other, 0]
                y += angles[other, corner] * unit[other, 1]
                z += angles[other, corner] * unit[other, 2]
            length = math.sqrt(x * x + y * y + z * z)
            if length > 0.0:
                out[face, c, 0], out[face, c, 1], out[face, c, 2] = x / length, y / length, z / length
            else:
                out[face, c, 0], out[face, c, 1], out[face, c, 2] = unit[face, 0], unit[face, 1], unit[face, 2]
