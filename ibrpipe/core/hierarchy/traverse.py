"""Which parts of a scene are drawn, and how: one level of the hierarchy at a time. Source: max1999, sec. 2.

A node is a part that has copies of others, or a mesh. Its pose (12,) f64 is the 3 x 4 matrix, row by row, that takes
its coordinates to those of the camera. A node is drawn from slices where a texel of some resolution covers no more than
the permitted pixels, is taken apart where none does, and is drawn as polygons where it cannot be taken apart.
"""

from __future__ import annotations

import math

from numba import prange

from ibrpipe.core.jit import helper, kernel

CULLED, SLICES, PARTS, POLYGONS = 0, 1, 2, 3


@helper
def stretch(pose):
    # -> bound of the greatest singular value of the left 3 x 3; exact where its columns are orthogonal and equally long
    most = 0.0
    for i in range(3):
        row = 0.0
        for j in range(3):
            row += abs(pose[i] * pose[j] + pose[4 + i] * pose[4 + j] + pose[8 + i] * pose[8 + j])
        most = max(most, row)
    return math.sqrt(most)


@helper
def determinant(pose):
    return (
        pose[0] * (pose[5] * pose[10] - pose[6] * pose[9])
        - pose[1] * (pose[4] * pose[10] - pose[6] * pose[8])
        + pose[2] * (pose[4] * pose[9] - pose[5] * pose[8])
    )


@helper
def solve(pose, det, x, y, z):
    # -> the vector that the left 3 x 3 takes to (x, y, z)
    a = x * (pose[5] * pose[10] - pose[6] * pose[9])
    a += y * (pose[2] * pose[9] - pose[1] * pose[10]) + z * (pose[1] * pose[6] - pose[2] * pose[5])
    b = x * (pose[6] * pose[8] - pose[4] * pose[10])
    b += y * (pose[0] * pose[10] - pose[2] * pose[8]) + z * (pose[2] * pose[4] - pose[0] * pose[6])
    c = x * (pose[4] * pose[9] - pose[5] * pose[8])
    c += y * (pose[1] * pose[8] - pose[0] * pose[9]) + z * (pose[0] * pose[5] - pose[1] * pose[4])
    return a / det, b / det, c / det


@helper
def octahedral_cell(x, y, z, size):
    # -> row * size + column of the cell of a square octahedral map in which a direction lies (cigolle2014)
    length = abs(x) + abs(y) + abs(z)
    u, v = x / length, y / length
    if z < 0.0:
        u, v = (1.0 - abs(v)) * (1.0 if u >= 0.0 else -1.0), (1.0 - abs(u)) * (1.0 if v >= 0.0 else -1.0)
    column = min(max(int((u + 1.0) * 0.5 * size), 0), size - 1)
    row = min(max(int((v + 1.0) * 0.5 * size), 0), size - 1)
    return row * size + column


@helper
def choose(number, pose, spheres, kinds, costs, resolutions, lookup, view):
    # -> what to do with a node, and the index of resolution and direction in a table (L, D)
    # spheres (P, 4) f64; kinds (P, 2) i64: has slices, first triangle count (0 = has parts); costs (P, L) f32: time of
    # drawing slices over that of drawing polygons, at one texel a pixel; view (9,) f64: f, near, least texels per
    # pixel, then x and y slopes: low x, high x, low y, high y of the picture at z = 1, 0, 0
    cx, cy, cz = spheres[number, 0], spheres[number, 1], spheres[number, 2]
    x = pose[0] * cx + pose[1] * cy + pose[2] * cz + pose[3]
    y = pose[4] * cx + pose[5] * cy + pose[6] * cz + pose[7]
    z = pose[8] * cx + pose[9] * cy + pose[10] * cz + pose[11]
    size = stretch(pose)
    radius = size * spheres[number, 3]
    if not radius > 0.0 or z + radius <= view[1]:
        return CULLED, 0
    if (
        x - view[3] * z < -radius * math.sqrt(1.0 + view[3] * view[3])
        or view[4] * z - x < -radius * math.sqrt(1.0 + view[4] * view[4])
        or y - view[5] * z < -radius * math.sqrt(1.0 + view[5] * view[5])
        or view[6] * z - y < -radius * math.sqrt(1.0 + view[6] * view[6])
    ):
        return CULLED, 0
    det = determinant(pose)
    if kinds[number, 0] == 1 and z > 1.5 * radius and z - radius > view[1] and abs(det) > 1e-6 * size * size * size:
        need = 2.0 * radius * view[0] * view[2] / z
        for level in range(len(resolutions)):
            if resolutions[level] >= need:
                if kinds[number, 1] > 0 and costs[number, level] > 1.0:
                    break
                ex, ey, ez = solve(pose, det, -pose[3], -pose[7], -pose[11])
                cell = octahedral_cell(ex - cx, ey - cy, ez - cz, lookup.shape[0])
                directions = lookup[cell // lookup.shape[0], cell % lookup.shape[0]]
                return SLICES, level << 16 | directions
    return (PARTS if kinds[number, 1] == 0 else POLYGONS), 0


@kernel
def classify(nodes, poses, spheres, kinds, costs, resolutions, lookup, view, action, choice):
    # nodes (N,) i32, poses (N, 12) f64 -> action (N,) i8, choice (N,) i32: level << 16 | direction
    for n in prange(len(nodes)):
        action[n], choice[n] = choose(nodes[n], poses[n], spheres, kinds, costs, resolutions, lookup, view)


@kernel
def expand(parents, copies, poses, children, matrices, nodes, out):
    # parents (M,) i64: row of the pose of the parent; copies (M,) i64: row of children (C,) i32, matrices (C, 12) f64
    # -> nodes (M,) i32, out (M, 12) f64
    for n in prange(len(parents)):
        p, c = parents[n], copies[n]
        nodes[n] = children[c]
        for i in range(3):
            for j in range(4):
                value = poses[p, 4 * i + 3] if j == 3 else 0.0
                for k in range(3):
                    value += poses[p, 4 * i + k] * matrices[c, 4 * k + j]
                out[n, 4 * i + j] = value
