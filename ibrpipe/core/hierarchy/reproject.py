"""Samples of orthogonal views put into a new one, nearest first, and lit where they are seen.

Source: max1999, sec. 2 (all copies of a view at once, depth buffer) and sec. 3 (light after reprojection). A sample is
drawn as a square as wide as its texel is in the picture, which closes the gaps between samples.
"""

from __future__ import annotations

import math

import numpy as np
from numba import prange

from ibrpipe.core.jit import helper, kernel

#: no sample
NOTHING = -1


@helper
def splat(x, y, z, half, number, depth, ids):
    # a square of 2 half pixels about x, y at depth z; equal depths go to the lesser number
    left, right = max(int(math.floor(x - half + 0.5)), 0), min(int(math.floor(x + half + 0.5)), depth.shape[1])
    top, bottom = max(int(math.floor(y - half + 0.5)), 0), min(int(math.floor(y + half + 0.5)), depth.shape[0])
    for row in range(top, bottom):
        for column in range(left, right):
            before = depth[row, column]
            if z < before or (z == before and number < ids[row, column]):
                depth[row, column] = z
                ids[row, column] = number


@kernel
def reproject(draws, poses, widths, places, calibration, near, depth, ids):
    # draws (I, 3) i64: first sample, number of samples, number of the first one; poses (I, 12) f64; widths (I,) f64:
    # width of a sample in the scene; places (S, 3) f32 in the part's coordinates
    # depth (C, H, W) f32, inf; ids (C, H, W) i64, NOTHING: every part of the work has a picture of its own
    chunks = len(depth)
    focal = max(calibration[0, 0], calibration[1, 1])
    for chunk in prange(chunks):
        for i in range(chunk, len(draws), chunks):
            pose = poses[i]
            for n in range(draws[i, 1]):
                p = places[draws[i, 0] + n]
                z = pose[8] * p[0] + pose[9] * p[1] + pose[10] * p[2] + pose[11]
                if z > near:
                    x = (pose[0] * p[0] + pose[1] * p[1] + pose[2] * p[2] + pose[3]) / z
                    y = (pose[4] * p[0] + pose[5] * p[1] + pose[6] * p[2] + pose[7]) / z
                    column = calibration[0, 0] * x + calibration[0, 1] * y + calibration[0, 2]
                    row = calibration[1, 1] * y + calibration[1, 2]
                    half = max(0.5 * widths[i] * focal / z, 0.5)
                    if -half < column < depth.shape[2] + half and -half < row < depth.shape[1] + half:
                        splat(column, row, np.float32(z), half, draws[i, 2] + n, depth[chunk], ids[chunk])


@kernel
def merge(depth, ids):
    # the nearest of all pictures, to the first; equal depths go to the lesser number
    for row in prange(depth.shape[1]):
        for chunk in range(1, len(depth)):
            for column in range(depth.shape[2]):
                z, number = depth[chunk, row, column], ids[chunk, row, column]
                if z < depth[0, row, column] or (z == depth[0, row, column] and number < ids[0, row, column]):
                    depth[0, row, column], ids[0, row, column] = z, number


@helper
def turned_normal(pose, normal, out):
    # a normal under the inverse transpose of the left 3 x 3 (its cofactors), unit
    for i in range(3):
        j, k = 4 * ((i + 1) % 3), 4 * ((i + 2) % 3)
        cx = pose[j + 1] * pose[k + 2] - pose[j + 2] * pose[k + 1]
        cy = pose[j + 2] * pose[k] - pose[j] * pose[k + 2]
        cz = pose[j] * pose[k + 1] - pose[j + 1] * pose[k]
        out[i] = cx * normal[0] + cy * normal[1] + cz * normal[2]
    length = math.sqrt(out[0] * out[0] + out[1] * out[1] + out[2] * out[2])
    for i in range(3):
        out[i] = out[i] / length if length > 0.0 else 0.0


@kernel
def shade_samples(ids, draws, poses, samples, lights, lighting, rays, color):
    # ids (H, W) i64; samples: albedo (S, 3), normal (S, 3) f32; lights (N, 3), lighting (1 + N, 3) as in `View`
    # rays (3, 3) f64: camera from pixel -> color (H, W, 3) f32, where there is a sample
    albedo, normals = samples
    for row in prange(ids.shape[0]):
        normal = np.empty(3)
        for column in range(ids.shape[1]):
            number = ids[row, column]
            if number == NOTHING:
                continue
            i = np.searchsorted(draws[:, 2], number, side="right") - 1
            s = draws[i, 0] + number - draws[i, 2]
            turned_normal(poses[i], normals[s], normal)
            x, y = column + 0.5, row + 0.5
            toward = 0.0
            for c in range(3):
                toward += normal[c] * (rays[c, 0] * x + rays[c, 1] * y + rays[c, 2])
            side = -1.0 if toward > 0.0 else 1.0
            for c in range(3):
                color[row, column, c] = lighting[0, c]
            for n in range(len(lights)):
                cosine = normal[0] * lights[n, 0] + normal[1] * lights[n, 1] + normal[2] * lights[n, 2]
                for c in range(3):
                    color[row, column, c] += lighting[1 + n, c] * max(side * cosine, 0.0)
            for c in range(3):
                color[row, column, c] *= albedo[s, c]
