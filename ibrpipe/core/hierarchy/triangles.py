"""Triangles of parts that are near: to the camera, lit, clipped at the near plane, made ready for drawing.

A triangle's numbers are (21,) f32: rows over (x, y, 1), x and y counted from the first column and row of its box, of
what is linear in the picture: three weights that are positive inside, 1 / depth, and red, green, blue over depth.
"""

from __future__ import annotations

import math

import numpy as np
from numba import prange

from ibrpipe.core.jit import helper, kernel


@helper
def face_light(corners, lights, lighting, light, normal):
    # corners (3, 3) f64 in the camera's frame -> light (3,): what a white face sends back; normal (3,) to the viewer
    ax, ay, az = corners[1, 0] - corners[0, 0], corners[1, 1] - corners[0, 1], corners[1, 2] - corners[0, 2]
    bx, by, bz = corners[2, 0] - corners[0, 0], corners[2, 1] - corners[0, 1], corners[2, 2] - corners[0, 2]
    x, y, z = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    length = math.sqrt(x * x + y * y + z * z)
    if not length > 0.0:
        return False
    if x * corners[0, 0] + y * corners[0, 1] + z * corners[0, 2] > 0.0:
        length = -length
    normal[0], normal[1], normal[2] = x / length, y / length, z / length
    for c in range(3):
        light[c] = lighting[0, c]
    for n in range(len(lights)):
        cosine = max(normal[0] * lights[n, 0] + normal[1] * lights[n, 1] + normal[2] * lights[n, 2], 0.0)
        for c in range(3):
            light[c] += lighting[1 + n, c] * cosine
    return True


@helper
def highlight(point, normal, lights, lighting, material, out):
    # adds the highlight (3,) that a viewer at 0 sees at a point
    far = math.sqrt(point[0] * point[0] + point[1] * point[1] + point[2] * point[2])
    for n in range(len(lights)):
        x, y, z = lights[n, 0] - point[0] / far, lights[n, 1] - point[1] / far, lights[n, 2] - point[2] / far
        length = math.sqrt(x * x + y * y + z * z)
        if length > 1e-9 and lights[n, 0] * normal[0] + lights[n, 1] * normal[1] + lights[n, 2] * normal[2] > 0.0:
            cosine = max(normal[0] * x + normal[1] * y + normal[2] * z, 0.0) / length
            for c in range(3):
                out[c] += material[0] * lighting[1 + n, c] * math.exp((min(cosine, 1.0) - 1.0) * material[1])


@helper
def clip_near(points, colors, near, out, out_colors):
    # points, colors (3, 3) f64 -> corners (up to 4) of what lies beyond z = near; their number
    count = 0
    for i in range(3):
        j = (i + 1) % 3
        here, there = points[i, 2] - near, points[j, 2] - near
        if here > 0.0:
            for c in range(3):
                out[count, c], out_colors[count, c] = points[i, c], colors[i, c]
            count += 1
        if (here > 0.0) != (there > 0.0):
            share = here / (here - there)
            for c in range(3):
                out[count, c] = points[i, c] + share * (points[j, c] - points[i, c])
                out_colors[count, c] = colors[i, c] + share * (colors[j, c] - colors[i, c])
            out[count, 2] = near
            count += 1
    return count


@helper
def set_up(points, colors, first, second, third, calibration, limits, numbers, box):
    # one triangle of three corners ahead of the near plane -> numbers (21,), box (4,): x0, x1, y0, y1; empty: x0 = x1
    x, y = np.empty(3), np.empty(3)
    for i in range(3):
        p = first if i == 0 else (second if i == 1 else third)
        z = points[p, 2]
        x[i] = (calibration[0, 0] * points[p, 0] + calibration[0, 1] * points[p, 1]) / z + calibration[0, 2]
        y[i] = calibration[1, 1] * points[p, 1] / z + calibration[1, 2]
    box[0] = int(max(math.floor(min(x[0], x[1], x[2])), 0.0))
    box[1] = int(min(math.floor(max(x[0], x[1], x[2])) + 1.0, limits[0]))
    box[2] = int(max(math.floor(min(y[0], y[1], y[2])), 0.0))
    box[3] = int(min(math.floor(max(y[0], y[1], y[2])) + 1.0, limits[1]))
    area = (x[1] - x[0]) * (y[2] - y[0]) - (x[2] - x[0]) * (y[1] - y[0])
    if box[0] >= box[1] or box[2] >= box[3] or area == 0.0:
        box[0], box[1], box[2], box[3] = 0, 0, 0, 0
        return
    numbers[9:] = 0.0
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        p = first if i == 0 else (second if i == 1 else third)
        for term in range(3):
            if term == 0:
                weight = (y[j] - y[k]) / area
            elif term == 1:
                weight = (x[k] - x[j]) / area
            else:
                weight = ((x[j] - box[0]) * (y[k] - box[2]) - (x[k] - box[0]) * (y[j] - box[2])) / area
            numbers[3 * i + term] = weight
            numbers[9 + term] += weight / points[p, 2]
            for c in range(3):
                numbers[12 + 3 * c + term] += weight * colors[p, c] / points[p, 2]


@kernel
def emit_triangles(draws, poses, faces, paints, materials, view, lights, lighting, numbers, boxes):
    # draws (I, 5) i64: node, first face, number of faces, first triangle, 2 where the near plane is crossed, else 1
    # poses (I, 12) f64; faces, paints (F, 3, 3) f32; materials (P, 2) f64; view: calibration (3, 3), limits: width,
    # height, near (3,) f64; lights (N, 3) f64 in the camera's frame; lighting (1 + N, 3)
    # -> numbers (T, 21) f32, boxes (T, 4) i64; two triangles a face where the near plane is crossed
    calibration, limits = view
    for i in prange(len(draws)):
        points, colors, kept, kept_colors = np.empty((3, 3)), np.empty((3, 3)), np.empty((4, 3)), np.empty((4, 3))
        light, normal = np.empty(3), np.empty(3)
        material, pose, step = materials[draws[i, 0]], poses[i], draws[i, 4]
        for n in range(draws[i, 2]):
            f, t = draws[i, 1] + n, draws[i, 3] + step * n
            for corner in range(3):
                x, y, z = faces[f, corner, 0], faces[f, corner, 1], faces[f, corner, 2]
                for c in range(3):
                    points[corner, c] = pose[4 * c] * x + pose[4 * c + 1] * y + pose[4 * c + 2] * z + pose[4 * c + 3]
            for part in range(step):
                boxes[t + part, :] = 0
            if not face_light(points, lights, lighting, light, normal):
                continue
            for corner in range(3):
                for c in range(3):
                    colors[corner, c] = paints[f, corner, c] * light[c]
                if material[0] > 0.0:
                    highlight(points[corner], normal, lights, lighting, material, colors[corner])
            if step == 1:
                set_up(points, colors, 0, 1, 2, calibration, limits, numbers[t], boxes[t])
            else:
                count = clip_near(points, colors, limits[2], kept, kept_colors)
                for part in range(count - 2):
                    set_up(
                        kept,
                        kept_colors,
                        0,
                        part + 1,
                        part + 2,
                        calibration,
                        limits,
                        numbers[t + part],
                        boxes[t + part],
                    )
