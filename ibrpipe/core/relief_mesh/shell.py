"""Rays through the shell below a mesh, so that silhouettes follow the relief: beyond policarpo2005.

Every polygon is the top of a prism that reaches down to depth 1 along the normals of its vertices. A prism is cut into
three tetrahedra, its sides along the diagonal from the top of the vertex of lower number, so that neighbours agree; in
each the texture coordinates and depth are linear, and a ray is straight in (x, y, z) there. A ray that enters a
tetrahedron inside the relief hits it there if it came through a wall (a border of the mesh or a seam of the texture);
else it comes from where there is no relief to see, from below or from the eye itself.

Symbols: vertices a, b, c by number; 0 top, 1 bottom; tetrahedra (a0 b0 c0 c1), (a0 b0 b1 c1), (a0 a1 b1 c1).
"""

from __future__ import annotations

import math

import numpy as np
from numba import prange

from ibrpipe.core.jit import helper, kernel
from ibrpipe.core.relief_mesh.hit import ACROSS, DEEP, DOWN, SHIFT, search_layers
from ibrpipe.core.relief_mesh.search import clip_unit
from ibrpipe.core.relief_mesh.tree import LEAF

#: corner (0 a, 1 b, 2 c) and floor (0 top, 1 bottom) of the tetrahedra's vertices, and the side of the prism that lies
#: opposite to each: 0 ab, 1 bc, 2 ca, 3 inside, 4 top, 5 bottom
TETRA = np.array(
    [
        [[0, 0, 1], [1, 0, 2], [2, 0, 3], [2, 1, 4]],
        [[0, 0, 1], [1, 0, 3], [1, 1, 3], [2, 1, 0]],
        [[0, 0, 5], [0, 1, 3], [1, 1, 2], [2, 1, 0]],
    ],
    np.int64,
)
#: a ray still passes through a tetrahedron when it misses it by this share
SLACK = 1e-12


@helper
def box_entry(boxes, node, inverse, far):
    # where the ray t * w, from the eye at 0, enters a box; inf = not before `far`
    near = 0.0
    for axis in range(3):
        one, other = boxes[node, axis] * inverse[axis], boxes[node, 3 + axis] * inverse[axis]
        near, far = max(near, min(one, other)), min(far, max(one, other))
    return near if near <= far else np.inf


@helper
def sorted_corners(corners, f, rank):
    # rank (3,): corners of a face in the order of their vertices' numbers
    rank[0], rank[1], rank[2] = 0, 1, 2
    for k in (0, 1, 0):
        if corners[f, rank[k]] > corners[f, rank[k + 1]]:
            rank[k], rank[k + 1] = rank[k + 1], rank[k]


@helper
def is_wall(walls, f, rank, side):
    # side 0 ab, 1 bc, 2 ca of the sorted corners
    if side > 2:
        return False
    one, other = rank[side], rank[(side + 1) % 3]
    edge = one if (one + 1) % 3 == other else other
    return walls[f, edge] != 0


@helper
def enter_tetra(points, w, far, rows):
    # points (4, 6): position, x, y, z of the vertices -> (t0, t1, vertex opposite to the face of entry); rows (3, 3)
    # filled with the gradients of the barycentric coordinates of vertices 1 to 3
    ax, ay, az = points[1, 0] - points[0, 0], points[1, 1] - points[0, 1], points[1, 2] - points[0, 2]
    bx, by, bz = points[2, 0] - points[0, 0], points[2, 1] - points[0, 1], points[2, 2] - points[0, 2]
    cx, cy, cz = points[3, 0] - points[0, 0], points[3, 1] - points[0, 1], points[3, 2] - points[0, 2]
    rows[0, 0], rows[0, 1], rows[0, 2] = by * cz - bz * cy, bz * cx - bx * cz, bx * cy - by * cx
    rows[1, 0], rows[1, 1], rows[1, 2] = cy * az - cz * ay, cz * ax - cx * az, cx * ay - cy * ax
    rows[2, 0], rows[2, 1], rows[2, 2] = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    volume = ax * rows[0, 0] + ay * rows[0, 1] + az * rows[0, 2]
    if volume == 0.0:
        return 0.0, -1.0, 0
    begin, end, gate = 0.0, far, -1
    rest_at, rest_rate = 1.0, 0.0
    for k in range(4):
        if k < 3:
            for axis in range(3):
                rows[k, axis] /= volume
            at = -(rows[k, 0] * points[0, 0] + rows[k, 1] * points[0, 1] + rows[k, 2] * points[0, 2])
            rate = rows[k, 0] * w[0] + rows[k, 1] * w[1] + rows[k, 2] * w[2]
            rest_at, rest_rate = rest_at - at, rest_rate - rate
        else:
            at, rate = rest_at, rest_rate
        t = -(at + SLACK) / rate if rate != 0.0 else 0.0
        if rate > 0.0:
            if t > begin:
                begin, gate = t, (k + 1) & 3
        elif rate < 0.0:
            end = min(end, t)
        elif at < -SLACK:
            end = -1.0
    return begin, end, gate


@helper
def meet_prism(shell, layers, rule, f, w, far, points, rows, rank, box):
    # nearest hit in a prism before `far` -> t, inf = none; box (15,): frame, x, y, z, normal of the mesh
    vertices, normals, corners, uv, walls = shell
    front, back, lows, highs, plan = layers
    sorted_corners(corners, f, rank)
    best, deep = far, rule[DEEP]
    for tetra in range(3):
        for k in range(4):
            c, floor = rank[TETRA[tetra, k, 0]], TETRA[tetra, k, 1]
            v = corners[f, c]
            for axis in range(3):
                points[k, axis] = vertices[v, axis] - floor * deep * normals[v, axis]
            points[k, 3] = uv[f, c, 0] * rule[ACROSS] + rule[SHIFT]
            points[k, 4] = uv[f, c, 1] * rule[DOWN] + rule[SHIFT]
            points[k, 5] = floor
        begin, end, gate = enter_tetra(points, w, best, rows)
        if not begin <= end:
            continue
        solid = gate >= 0 and is_wall(walls, f, rank, TETRA[tetra, gate, 2])
        for axis in range(3):  # gradients of x, y, z -> box
            for q in range(3):
                box[3 * q + axis] = (
                    rows[0, axis] * (points[1, 3 + q] - points[0, 3 + q])
                    + rows[1, axis] * (points[2, 3 + q] - points[0, 3 + q])
                    + rows[2, axis] * (points[3, 3 + q] - points[0, 3 + q])
                )
        at_x, at_y, at_z = points[0, 3], points[0, 4], points[0, 5]
        for axis in range(3):
            at_x -= box[axis] * points[0, axis]
            at_y -= box[3 + axis] * points[0, axis]
            at_z -= box[6 + axis] * points[0, axis]
        dx = box[0] * w[0] + box[1] * w[1] + box[2] * w[2]
        dy = box[3] * w[0] + box[4] * w[1] + box[5] * w[2]
        dz = box[6] * w[0] + box[7] * w[1] + box[8] * w[2]
        if plan[3] == 0:
            first = begin
            begin, end = clip_unit((at_x - rule[SHIFT]) / rule[ACROSS], dx / rule[ACROSS], begin, end)
            begin, end = clip_unit((at_y - rule[SHIFT]) / rule[DOWN], dy / rule[DOWN], begin, end)
            solid = solid or begin > first
            if not begin <= end:
                continue
        slope = abs(dz) * deep / math.sqrt(w[0] * w[0] + w[1] * w[1] + w[2] * w[2])
        ray = (at_x, at_y, at_z, dx, dy, dz)
        t = search_layers(front, back, lows, highs, plan, rule, ray, begin, end, solid, slope)
        if t < best:
            best = t
            box[9], box[10], box[11] = at_x + t * dx, at_y + t * dy, at_z + t * dz
            for k in range(9):
                box[15 + k] = box[k]
            for axis in range(3):
                total, rest = 0.0, 1.0
                for k in range(3):
                    share = 0.0
                    for q in range(3):
                        share += rows[k, q] * (t * w[q] - points[0, q])
                    rest -= share
                    total += share * normals[corners[f, rank[TETRA[tetra, k + 1, 0]]], axis]
                box[12 + axis] = total + rest * normals[corners[f, rank[TETRA[tetra, 0, 0]]], axis]
    return best if best < far else np.inf


@kernel
def hit_shell(shell, layers, rule, world_from_pixel, order, boxes, depth, mine, positions, hit_frames):
    # shell: vertices (V, 3) f64 from the eye, their normals (V, 3) f64, corners (F, 3) i64, uv (F, 3, 2) f64, walls
    # (F, 3) u8; order, boxes: see relief_mesh_tree; the others: see relief_mesh_hit.hit_faces
    leaves = (len(boxes) + 1) // 2
    for y in prange(depth.shape[0]):
        box, points, rows = np.empty(24), np.empty((4, 6)), np.empty((3, 3))
        rank, stack, entries = np.empty(3, np.int64), np.empty(64, np.int64), np.empty(64)
        inverse = np.empty(3)
        for x in range(depth.shape[1]):
            px, py = x + 0.5, y + 0.5
            w = (
                world_from_pixel[0, 0] * px + world_from_pixel[0, 1] * py + world_from_pixel[0, 2],
                world_from_pixel[1, 0] * px + world_from_pixel[1, 1] * py + world_from_pixel[1, 2],
                world_from_pixel[2, 0] * px + world_from_pixel[2, 1] * py + world_from_pixel[2, 2],
            )
            for axis in range(3):
                inverse[axis] = 1.0 / (w[axis] if abs(w[axis]) > 1e-200 else 1e-200)
            best, size = float(depth[y, x]), 0
            found = False
            entry = box_entry(boxes, 0, inverse, best)
            if entry < np.inf:
                stack[0], entries[0], size = 0, entry, 1
            while size > 0:
                size -= 1
                node = stack[size]
                if entries[size] > best:
                    continue
                if node >= leaves - 1:
                    first = LEAF * (node - leaves + 1)
                    for at in range(first, min(first + LEAF, len(order))):
                        t = meet_prism(shell, layers, rule, order[at], w, best, points, rows, rank, box)
                        if t < best:
                            best, found = t, True
                            if positions.shape[0] > 0:
                                positions[y, x, 0], positions[y, x, 1], positions[y, x, 2] = box[9], box[10], box[11]
                                for axis in range(3):
                                    hit_frames[y, x, axis] = box[15 + axis] / rule[ACROSS]
                                    hit_frames[y, x, 3 + axis] = box[18 + axis] / rule[DOWN]
                                    hit_frames[y, x, 6 + axis] = -box[12 + axis] / rule[DEEP]
                    continue
                one, other = 2 * node + 1, 2 * node + 2
                near, far = box_entry(boxes, one, inverse, best), box_entry(boxes, other, inverse, best)
                if far < near:
                    one, other, near, far = other, one, far, near
                if far < np.inf:
                    stack[size], entries[size] = other, far
                    size += 1
                if near < np.inf:
                    stack[size], entries[size] = one, near
                    size += 1
            if found and np.float32(best) < depth[y, x]:
                depth[y, x] = best
                mine[y, x] = 1
