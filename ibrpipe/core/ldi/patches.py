"""Which samples of a layered depth image are neighbours, and the bilinear patches that they span.

A cell lies between four texel centres; cell (r, c) has the corners (r - 1, c - 1), (r - 1, c), (r, c - 1), (r, c),
named 0, 1, 2, 3, so cells run from half a texel outside the image on every side. Samples of adjacent texels are
*linked* when the step between them is one that their own slopes predict; linked samples of one cell form a group, and
every group spans one patch. Corners that a group lacks are extrapolated, and the patch is then valid only in the
quadrants of the corners that it has. Round a cell, ring positions 0, 1, 2, 3 are the corners 0, 1, 3, 2.

Symbols: links (4, S) i32: sample to the right, below, to the left, above, -1 = none; step (2, S) f32: predicted change
of depth per texel along u and v, NaN where the normal is unknown; margin (2, 2): texel size = margin[axis, 0] +
depth * margin[axis, 1].
"""

from __future__ import annotations

import numpy as np
from numba import prange

from ibrpipe.core.jit import helper, kernel
from ibrpipe.core.ldi.quadtree import EMPTY, pack_bounds

#: no literals, for each of which functions are compiled anew
ALONG_U, ALONG_V = np.int64(0), np.int64(1)


@helper
def mismatch(depth_p, depth_q, step_p, step_q, texel, gap):
    # -> how far the step from p to q lies from the mean prediction, or inf if it is outside the permitted range
    jump = depth_q - depth_p
    if step_p != step_p or step_q != step_q:
        return abs(jump) if abs(jump) <= gap * texel else np.inf
    if jump < min(step_p, step_q) - texel or jump > max(step_p, step_q) + texel:
        return np.inf
    return abs(jump - 0.5 * (step_p + step_q))


@helper
def best_partner(sample, first, last, forward, depth, step, texel, gap):
    # texel = (constant, per depth); forward, 1 or 0: `sample` is the left (upper) one -> index in [first, last) or -1
    best, least = -1, np.inf
    for other in range(first, last):
        p, q = (sample, other) if forward else (other, sample)
        size = texel[0] + texel[1] * max(depth[p], depth[q])
        cost = mismatch(float(depth[p]), float(depth[q]), step[p], step[q], size, gap)
        if cost < least:
            best, least = other, cost
    return best


@kernel
def link_samples(offsets, depth, step, margin, gap, out):
    # offsets (H, W + 1) i64, depth (S,) f32 -> out (4, S) i32, filled with -1 by the caller
    rows, columns = offsets.shape[0], offsets.shape[1] - 1
    for j in prange(rows):
        for i in range(columns):
            for axis in range(2):
                y, x = j + axis, i + 1 - axis
                if y >= rows or x >= columns:
                    continue
                first, last = offsets[j, i], offsets[j, i + 1]
                first_q, last_q = offsets[y, x], offsets[y, x + 1]
                for p in range(first, last):
                    q = best_partner(p, first_q, last_q, np.int64(1), depth, step[axis], margin[axis], gap)
                    back = np.int64(-1)
                    if q >= 0:
                        back = best_partner(q, first, last, np.int64(0), depth, step[axis], margin[axis], gap)
                    if back == p:
                        out[axis, p], out[axis + 2, q] = q, p


@helper
def walk_on(links, sample, ring, members):
    # members[ring:] become the chain from `sample` on along the edges 0-1, 1-3, 3-2 -> last ring position reached
    members[ring] = sample
    while ring < 3 and links[ring, members[ring]] >= 0:
        members[ring + 1] = links[ring, members[ring]]
        ring += 1
    return ring


@helper
def walk_back(links, sample, members):
    # members[:4] become the chain that ends with `sample` at ring position 3 -> first ring position reached
    ring = 3
    members[ring] = sample
    while ring > 0 and links[(ring + 1) % 4, members[ring]] >= 0:
        members[ring - 1] = links[(ring + 1) % 4, members[ring]]
        ring -= 1
    return ring


@helper
def find_group(links, sample, ring, members, other):
    # members (4,) i32 by ring position: the group that begins with `sample`, -1 = none; False if none begins there.
    # Chains run along the edges 0-1, 1-3, 3-2; the edge 0-2 joins two chains unless both have a sample of one corner
    for n in range(4):
        members[n] = -1
    if ring > 0 and links[(ring + 1) % 4, sample] >= 0:
        return False
    last = walk_on(links, sample, ring, members)
    if ring == 0 and last < 3 and links[1, sample] >= 0:
        first = walk_back(links, links[1, sample], other)
        if first > last:
            for n in range(first, 4):  # assigning slices compiles numba's string functions
                members[n] = other[n]
    if ring > 0 and last == 3 and links[3, members[3]] >= 0:
        return walk_on(links, np.int64(links[3, members[3]]), np.int64(0), other) >= ring
    return True


@kernel
def group_cells(offsets, links, starts, out_counts, out_samples):
    # out_counts (H + 1, W + 1) i32 patches per cell; out_samples (P, 4) i32 by corner, filled from starts (cells + 1,)
    # i64 on unless it is empty
    rows, columns = offsets.shape[0], offsets.shape[1] - 1
    for cell_row in prange(rows + 1):
        r = np.int64(cell_row)  # prange counts unsigned
        members, other = np.empty(4, np.int32), np.empty(4, np.int32)
        for c in range(columns + 1):
            count = 0
            for ring in range(4):
                y = r - 1 if ring < 2 else r
                x = c if ring == 1 or ring == 2 else c - 1
                if y < 0 or x < 0 or y >= rows or x >= columns:
                    continue
                for sample in range(offsets[y, x], offsets[y, x + 1]):
                    if not find_group(links, sample, ring, members, other):
                        continue
                    if out_samples.shape[0] > 0:
                        patch = starts[r * (columns + 1) + c] + count
                        out_samples[patch, 0], out_samples[patch, 1] = members[0], members[1]
                        out_samples[patch, 2], out_samples[patch, 3] = members[3], members[2]
                    count += 1
            out_counts[r, c] = count


@helper
def predict(sample, axis, sign, depth, step):
    # depth one texel away along an axis, by the sample's own slope (level where that is unknown)
    slope = step[axis, sample]
    return depth[sample] + (sign * slope if slope == slope else np.float32(0.0))


@helper
def predict_missing(corner, samples, depth, step):
    # mean of the predictions of the two corners beside `corner`; of the opposite corner where neither exists
    beside_u, beside_v, opposite = samples[corner ^ 1], samples[corner ^ 2], samples[corner ^ 3]
    sign_u = np.float32(1.0 if corner & 1 else -1.0)
    sign_v = np.float32(1.0 if corner & 2 else -1.0)
    if beside_u >= 0 and beside_v >= 0:
        along_u = predict(beside_u, ALONG_U, sign_u, depth, step)
        along_v = predict(beside_v, ALONG_V, sign_v, depth, step)
        return np.float32(0.5) * (along_u + along_v)
    if beside_u >= 0:
        return predict(beside_u, ALONG_U, sign_u, depth, step)
    if beside_v >= 0:
        return predict(beside_v, ALONG_V, sign_v, depth, step)
    along_u, along_v = predict(opposite, ALONG_U, sign_u, depth, step), predict(opposite, ALONG_V, sign_v, depth, step)
    return along_u + along_v - depth[opposite]


@kernel
def fill_corners(samples, depth, step, out_corners, out_masks):
    # samples (P, 4) i32 -> out_corners (P, 4) f32 depths, out_masks (P,) u8: bit c = corner c is a sample
    for patch in prange(samples.shape[0]):
        mask = 0
        for corner in range(4):
            sample = samples[patch, corner]
            if sample >= 0:
                out_corners[patch, corner] = depth[sample]
                mask |= 1 << corner
            else:
                out_corners[patch, corner] = predict_missing(corner, samples[patch], depth, step)
        out_masks[patch] = mask


@helper
def patch_range(corners, mask):
    # least and greatest depth over the valid quadrants: a bilinear patch has its extremes at a rectangle's corners
    near, far = np.inf, -np.inf
    for corner in range(4):
        if mask & (1 << corner):
            left, top = 0.5 * (corner & 1), 0.5 * (corner >> 1)
            for k in range(4):
                p, q = left + 0.5 * (k & 1), top + 0.5 * (k >> 1)
                upper = corners[0] * (1.0 - p) + corners[1] * p
                lower = corners[2] * (1.0 - p) + corners[3] * p
                value = upper * (1.0 - q) + lower * q
                near, far = min(near, value), max(far, value)
    return near, far


@kernel
def measure_patches(corners, masks, out_near, out_far):
    # corners (P, 4) f32, masks (P,) u8 -> out_near, out_far (P,) f64
    for patch in prange(corners.shape[0]):
        out_near[patch], out_far[patch] = patch_range(corners[patch], masks[patch])


@kernel
def pack_patches(cells, near, far, low, scale, out):
    # cells (N,) i32 patch of each cell, -1 = none; near, far (P,) f64 -> out (N,) u32 bounds
    for cell in prange(cells.shape[0]):
        patch = cells[cell]
        out[cell] = pack_bounds(near[patch], far[patch], low, scale) if patch >= 0 else np.uint32(EMPTY)
