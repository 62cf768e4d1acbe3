"""Prefiltered slices of a part: what parallel rays meet in each of several slabs, averaged over texels.

Source: max1999, sec. 2 (slabs between clipping planes, unshaded colour, normals); the average over a texel and the
moments of the normal go beyond it.

Symbols: a, b, d: axes of a view, d towards the viewer; R texels and K slabs across the part's sphere of `radius`;
q x q rays a texel; u along a, v along b. A texel is 12 bytes: coverage; square roots of the mean albedo (3); mean n of
the normal turned to the viewer (3); mean of xx, yy, xy, xz, yz of n n^T (zz is 1 - xx - yy).
"""

from __future__ import annotations

import numpy as np
from numba import prange

from ibrpipe.core.jit import helper, kernel

#: bytes of a texel
TEXEL = 12
_X_STEP, _Y_STEP = 0.6180339887, 0.7548776662


@helper
def cast_face(corners, axes, per_unit, half, near, face, far, number):
    # one triangle (3, 3) from the part's centre -> nearest height and face number of every ray in every slab
    # near (K, S, S) f32, height along d; face (K, S, S) i32; far (S, S) f32: lowest height of all
    # per_unit: rays per unit of length; half: S / 2
    slabs, size = near.shape[0], near.shape[1]
    x = np.empty(3)
    y = np.empty(3)
    z = np.empty(3)
    for c in range(3):
        x[c] = per_unit * (corners[c, 0] * axes[0, 0] + corners[c, 1] * axes[0, 1] + corners[c, 2] * axes[0, 2]) + half
        y[c] = per_unit * (corners[c, 0] * axes[1, 0] + corners[c, 1] * axes[1, 1] + corners[c, 2] * axes[1, 2]) + half
        z[c] = per_unit * (corners[c, 0] * axes[2, 0] + corners[c, 1] * axes[2, 1] + corners[c, 2] * axes[2, 2])
    area = (x[1] - x[0]) * (y[2] - y[0]) - (x[2] - x[0]) * (y[1] - y[0])
    if area == 0.0:
        return
    left = max(int(np.floor(min(x[0], x[1], x[2]))), 0)
    right = min(int(np.floor(max(x[0], x[1], x[2]))), size - 1)
    top = max(int(np.floor(min(y[0], y[1], y[2]))), 0)
    bottom = min(int(np.floor(max(y[0], y[1], y[2]))), size - 1)
    slab = slabs / (2.0 * half)
    for j in range(top, bottom + 1):
        along = 0.5 + _X_STEP * j
        shift = along - np.floor(along)
        for i in range(left, right + 1):
            across = 0.5 + _Y_STEP * i
            px, py = i + shift, j + across - np.floor(across)
            w1 = ((px - x[0]) * (y[2] - y[0]) - (x[2] - x[0]) * (py - y[0])) / area
            w2 = ((x[1] - x[0]) * (py - y[0]) - (px - x[0]) * (y[1] - y[0])) / area
            if w1 >= 0.0 and w2 >= 0.0 and w1 + w2 <= 1.0:
                height = z[0] + w1 * (z[1] - z[0]) + w2 * (z[2] - z[0])
                far[j, i] = min(far[j, i], height)
                k = min(max(int((half - height) * slab), 0), slabs - 1)
                if height > near[k, j, i]:
                    near[k, j, i] = height
                    face[k, j, i] = number


@helper
def dilate_line(marked, reach, out):
    # out: whether something within `reach` entries of a line is marked
    last = -reach - 1
    for i in range(len(marked)):
        last = i if marked[i] else last
        out[i] = i - last <= reach
    last = len(marked) + reach
    for i in range(len(marked) - 1, -1, -1):
        last = i if marked[i] else last
        out[i] |= last - i <= reach


@helper
def extend_slabs(near, face, reach):
    # every slab takes from the one behind it what is within `reach` rays, along rows and columns, of what it holds
    slabs, size = near.shape[0], near.shape[1]
    wide, tall = np.empty((size, size), np.bool_), np.empty((size, size), np.bool_)
    for k in range(slabs - 1):
        for j in range(size):
            dilate_line(face[k, j] >= 0, reach, wide[j])
        for i in range(size):
            dilate_line(wide[:, i], reach, tall[:, i])
        for j in range(size):
            for i in range(size):
                if tall[j, i] and face[k, j, i] < 0:
                    near[k, j, i], face[k, j, i] = near[k + 1, j, i], face[k + 1, j, i]


@helper
def keep_first(face, rays, rims):
    # texels that some rays pass through, missing all slabs, keep of the others the first hit -> rims (R, R): which
    slabs, resolution = face.shape[0], rims.shape[0]
    for v in range(resolution):
        for u in range(resolution):
            misses = 0
            for j in range(v * rays, (v + 1) * rays):
                for i in range(u * rays, (u + 1) * rays):
                    hits = 0
                    for k in range(slabs):
                        hits += face[k, j, i] >= 0
                    misses += hits == 0
            rims[v, u] = misses > 0
            if misses > 0:
                for j in range(v * rays, (v + 1) * rays):
                    for i in range(u * rays, (u + 1) * rays):
                        met = False
                        for k in range(slabs):
                            if met:
                                face[k, j, i] = -1
                            met |= face[k, j, i] >= 0


@helper
def drop_other_sides(near, face, thickness):
    # what a ray hits within `thickness` rays behind its hit in the slab before is the other side of the same thin
    # thing: slabs hide each other as if by chance, and would count it twice
    slabs, size = near.shape[0], near.shape[1]
    for k in range(slabs - 1, 0, -1):
        for j in range(size):
            for i in range(size):
                both = face[k - 1, j, i] >= 0 and face[k, j, i] >= 0
                if both and near[k - 1, j, i] - near[k, j, i] < thickness:
                    face[k, j, i] = -1


@helper
def at_rim(far, j, i):
    # whether a ray has a neighbour that meets nothing, in its row or column
    last = len(far) - 1
    if j == 0 or i == 0 or j == last or i == last:
        return True
    return max(far[j - 1, i], far[j + 1, i], far[j, i - 1], far[j, i + 1]) == np.inf


@helper
def rim_height(near, face, far, thickness):
    # mean height of a slab's outline, NaN where it has none: of rays at the rim of the part, halfway to the last that
    # they meet where that is less than `thickness` behind, as on the two sides of something round
    total, count = 0.0, 0
    for j in range(len(far)):
        for i in range(len(far)):
            if face[j, i] >= 0 and at_rim(far, j, i):
                through = near[j, i] - far[j, i]
                total += near[j, i] - (0.5 * through if through < thickness else 0.0)
                count += 1
    return total / count if count > 0 else np.nan


@helper
def mean_texel(samples, count, rays, scale, out):
    # samples (10,) sums of albedo (3), n (3), xx, yy, xy, xz, yz less one -> out (12,) u8
    out[0] = min(int(255.0 * count / rays + 0.5), 255)
    for c in range(3):
        out[1 + c] = min(int(255.0 * np.sqrt(scale * samples[c] / count) + 0.5), 255)
        out[4 + c] = int(127.0 * samples[3 + c] / count + 128.5)
    for c in range(2):
        out[7 + c] = min(int(255.0 * samples[6 + c] / count + 0.5), 255)
    for c in range(3):
        out[9 + c] = min(max(int(254.0 * samples[8 + c] / count + 128.5), 0), 255)


@helper
def add_sample(corners, colors, normal, axes, per_unit, half, i, j, samples):
    # adds albedo and normal of the place where ray (i, j) meets a face to the sums
    x = np.empty(3)
    y = np.empty(3)
    for c in range(3):
        x[c] = per_unit * (corners[c, 0] * axes[0, 0] + corners[c, 1] * axes[0, 1] + corners[c, 2] * axes[0, 2]) + half
        y[c] = per_unit * (corners[c, 0] * axes[1, 0] + corners[c, 1] * axes[1, 1] + corners[c, 2] * axes[1, 2]) + half
    along, across = 0.5 + _X_STEP * j, 0.5 + _Y_STEP * i
    px, py = i + along - np.floor(along), j + across - np.floor(across)
    area = (x[1] - x[0]) * (y[2] - y[0]) - (x[2] - x[0]) * (y[1] - y[0])
    w1 = ((px - x[0]) * (y[2] - y[0]) - (x[2] - x[0]) * (py - y[0])) / area
    w2 = ((x[1] - x[0]) * (py - y[0]) - (px - x[0]) * (y[1] - y[0])) / area
    for c in range(3):
        samples[c] += colors[0, c] + w1 * (colors[1, c] - colors[0, c]) + w2 * (colors[2, c] - colors[0, c])
    side = 1.0
    if normal[0] * axes[2, 0] + normal[1] * axes[2, 1] + normal[2] * axes[2, 2] < 0.0:
        side = -1.0
    for c in range(3):
        samples[3 + c] += side * normal[c]
    samples[6] += normal[0] * normal[0]
    samples[7] += normal[1] * normal[1]
    samples[8] += normal[0] * normal[1]
    samples[9] += normal[0] * normal[2]
    samples[10] += normal[1] * normal[2]


@kernel
def prefilter(corners, colors, normals, axes, radius, rays, scale, reach, thin, out, heights, tops):
    # corners, colors (F, 3, 3) f32, corners from the centre of the sphere; normals (F, 3) f32 unit; axes (D, 3, 3) f64
    # rows a, b, d; rays = q; scale: 1 / greatest albedo; reach: texels by which a slab goes on into the next one
    # thin: texels; where slabs do not overlap, what is thinner counts in one slab alone
    # where slabs overlap, a ray at the rim of what is seen counts in the first slab that it hits, and coverage is the
    # share of the rays that slabs before it let through: rims would be too wide if slabs hid each other by chance
    # out (D, K, R, R, 12) u8, rows along b; heights (D, K, 2) f32: mean along d of what the slab holds, NaN = nothing,
    # and the height at which it is drawn: of its outline, where it has one
    # tops (D, K, R, R) f32: the same of every texel, or empty where that is not asked for
    slabs, resolution = out.shape[1], out.shape[2]
    size = resolution * rays
    half = 0.5 * size
    per_unit = half / radius
    for direction in prange(len(axes)):
        near = np.full((slabs, size, size), -np.inf, np.float32)
        face = np.full((slabs, size, size), -1, np.int32)
        far = np.full((size, size), np.inf, np.float32)
        for number in range(len(corners)):
            cast_face(corners[number], axes[direction], per_unit, half, near, face, far, number)
        rims, stopped = np.zeros((resolution, resolution), np.bool_), np.zeros((resolution, resolution), np.int64)
        if reach > 0.0:
            extend_slabs(near, face, int(reach * rays))
            keep_first(face, rays, rims)
        else:
            drop_other_sides(near, face, thin * rays)
        sums = np.empty(11)
        for k in range(slabs):
            total, weight = 0.0, 0
            for v in range(resolution):
                for u in range(resolution):
                    sums[:] = 0.0
                    count, before = 0, total
                    for j in range(v * rays, (v + 1) * rays):
                        for i in range(u * rays, (u + 1) * rays):
                            f = face[k, j, i]
                            if f >= 0:
                                count += 1
                                total += near[k, j, i]
                                add_sample(
                                    corners[f], colors[f], normals[f], axes[direction], per_unit, half, i, j, sums
                                )
                    weight += count
                    if count > 0:
                        mean_texel(sums, count, rays * rays - stopped[v, u], scale, out[direction, k, v, u])
                        stopped[v, u] += count if rims[v, u] else 0
                        if tops.size > 0:
                            tops[direction, k, v, u] = (total - before) / count / per_unit
            heights[direction, k, 0] = total / weight / per_unit if weight > 0 else np.nan
            outline = rim_height(near[k], face[k], far, size / slabs) / per_unit
            heights[direction, k, 1] = outline if outline == outline else heights[direction, k, 0]


@kernel
def trim(dense, boxes):
    # dense (D, K, R, R, 12) u8 -> boxes (D, K, 4) i32: u, v, width, height of the texels that cover something
    for direction in prange(dense.shape[0]):
        for k in range(dense.shape[1]):
            left, top, right, bottom = dense.shape[3], dense.shape[2], -1, -1
            for v in range(dense.shape[2]):
                for u in range(dense.shape[3]):
                    if dense[direction, k, v, u, 0] > 0:
                        left, right = min(left, u), max(right, u)
                        top, bottom = min(top, v), max(bottom, v)
            boxes[direction, k, 0], boxes[direction, k, 1] = left, top
            boxes[direction, k, 2], boxes[direction, k, 3] = max(right + 1 - left, 0), max(bottom + 1 - top, 0)


@kernel
def pack(dense, boxes, offsets, texels, means):
    # -> texels (N, 12) u8 of all boxes from offsets (D, K) i64 on, row by row; means (D, K, 12) f32 weighted by
    # coverage: share of the box that is covered, albedo (3) linear over `scale`, n (3), xx, yy, xy, xz, yz
    for direction in prange(dense.shape[0]):
        sums = np.empty(12)
        for k in range(dense.shape[1]):
            left, top = boxes[direction, k, 0], boxes[direction, k, 1]
            width, height = boxes[direction, k, 2], boxes[direction, k, 3]
            at = offsets[direction, k]
            sums[:] = 0.0
            for v in range(height):
                for u in range(width):
                    for c in range(12):
                        texels[at, c] = dense[direction, k, top + v, left + u, c]
                    unpack_texel(texels, at, sums)
                    at += 1
            for c in range(1, 12):
                means[direction, k, c] = sums[c] / sums[0] if sums[0] > 0 else 0.0
            means[direction, k, 0] = sums[0] / max(width * height, 1)


@helper
def unpack_texel(texels, at, sums):
    # adds one texel, weighted by its coverage, to sums (12,) f64
    cover = texels[at, 0] / 255.0
    sums[0] += cover
    for c in range(3):
        root = texels[at, 1 + c] / 255.0
        sums[1 + c] += cover * root * root
        sums[4 + c] += cover * (texels[at, 4 + c] - 128.0) / 127.0
        sums[9 + c] += cover * (texels[at, 9 + c] - 128.0) / 254.0
    for c in range(2):
        sums[7 + c] += cover * texels[at, 7 + c] / 255.0
