"""Nearest hit of every pixel by projecting patches: each patch meets exactly the rays whose pixels it covers.

The search of gong-yang (sec. 5.1) asks of every ray which patches it meets; here every patch asks which rays may meet
it, and those are intersected exactly, so both find the same hits. It costs a projection per patch and an intersection
per covered pixel, whatever the number of layers and textures. Coordinates: :mod:`ibrpipe.core.rays`.

Symbols: ``pixel`` (3, 4) takes (u, v, d, 1) to homogeneous pixels (x w, y w, w); i, j cell of a patch, a b c e its
corner depths; on a ray all of u q - i q, v q - j q and d q - a q are linear in t, so the bilinear patch is met where a
quadratic in t vanishes. A hit (t, id) replaces another when t is less, or equal with a lesser id: whatever the order
of patches and the number of threads, the same one wins.

Packed arguments: ``view`` (pixel (3, 4), rays (16,) f64: start (4,), then Q_of (4, 3) row by row, eye: camera depth
that still belongs to the eye itself); ``corners`` (a, b, c, e) depths at (0, 0), (1, 0), (0, 1), (1, 1); ``cells`` (j,
i0, i1): row, and columns i0 .. i1 - 1; ``vertices`` (xs, ys, ws): pixels and weights of two rows of a block's
vertices, the upper from ``ends[0]`` on and the lower from ``ends[1]`` on; ``out`` (depth (h, w) f32, ids (h, w) u32).
"""

from __future__ import annotations

import math

import numpy as np
from numba import prange

from ibrpipe.core.jit import fused, helper, inlined, kernel, ordered
from ibrpipe.core.rays import patch_quadratic

#: how far, in cells, a hit may lie outside its cell, so that none falls between two
OVERLAP = 1e-9
#: pixels by which a projected patch is widened, so that rounding loses no ray
WIDEN = 0.02
#: cells of a block of a height field along v and u
BLOCK_ROWS, BLOCK_COLUMNS = 16, 64
#: rays on the list of those to be met together
LIST = 1024
#: patches that are projected together
BLOCK = 256


@fused
def list_rays(window, least, i, j, corners, near, number, listed, count, view, out):
    # put the rays of all pixels between (x0, y0) and (x1, y1), both included, on the list of those to be met with the
    # patch of cell (i, j) -> how many are listed now. No hit is nearer than camera depth `least`; near: camera depth of
    # the patch, roughly, from where ray parameters are counted
    x0, y0, x1, y1 = window
    a, b, c, e = corners
    _, rays, eye = view
    depth, ids = out
    for y in range(y0, y1 + 1):
        for x in range(x0, x1 + 1):
            if least > depth[y, x]:
                continue
            listed[count], listed[LIST + count] = x, y
            listed[2 * LIST + count], listed[3 * LIST + count] = i, j
            listed[4 * LIST + count], listed[5 * LIST + count] = a, b
            listed[6 * LIST + count], listed[7 * LIST + count] = c, e
            listed[8 * LIST + count], listed[9 * LIST + count] = near, number
            count += 1
            if count == LIST:
                meet_listed(listed, count, rays, eye, depth, ids)
                count = 0
    return count


@ordered
def meet_listed(listed, count, rays, eye, depth, ids):
    # meet all listed rays in one loop without branches, then enter the hits
    r00, r01, r02, r10, r11, r12 = rays[4], rays[5], rays[6], rays[7], rays[8], rays[9]
    r20, r21, r22, r30, r31, r32 = rays[10], rays[11], rays[12], rays[13], rays[14], rays[15]
    s0, s1, s2, s3 = rays[0], rays[1], rays[2], rays[3]
    for n in range(count):
        px, py = listed[n] + 0.5, listed[LIST + n] + 0.5
        i, j = listed[2 * LIST + n], listed[3 * LIST + n]
        a, b, c, e = listed[4 * LIST + n], listed[5 * LIST + n], listed[6 * LIST + n], listed[7 * LIST + n]
        near = listed[8 * LIST + n]
        direction = (
            r00 * px + r01 * py + r02, r10 * px + r11 * py + r12, r20 * px + r21 * py + r22, r30 * px + r31 * py + r32
        )  # fmt: skip
        A, B, C, u, v, q, du, dv, dq = patch_quadratic((s0, s1, s2, s3), direction, i, j, (a, b, c, e), near)
        square = B * B - 4.0 * A * C
        w = -0.5 * (B + math.copysign(math.sqrt(square if square > 0.0 else 0.0), B))
        one, two = C / w, w / A  # infinite or NaN where there is no such root: no comparison below then holds
        wide_one, wide_two = q + one * dq, q + two * dq
        p, r, slack = u + one * du, v + one * dv, OVERLAP * wide_one
        good_one = (-slack <= p) & (-slack <= r) & (p <= wide_one + slack) & (r <= wide_one + slack)
        good_one &= (near + one > eye) & (wide_one > 0.0) & (square >= 0.0)
        p, r, slack = u + two * du, v + two * dv, OVERLAP * wide_two
        good_two = (-slack <= p) & (-slack <= r) & (p <= wide_two + slack) & (r <= wide_two + slack)
        good_two &= (near + two > eye) & (wide_two > 0.0) & (square >= 0.0)
        one = one if good_one else np.inf
        two = two if good_two else np.inf
        listed[10 * LIST + n] = near + (one if one < two else two)
    for n in range(count):
        t = listed[10 * LIST + n]
        if t < np.inf:
            improve(depth, ids, int(listed[LIST + n]), int(listed[n]), t, np.uint32(listed[9 * LIST + n]))


@inlined
def improve(depth, ids, y, x, t, number):
    # enter a hit into one thread's picture
    t32 = np.float32(t)
    if t32 < depth[y, x] or (t32 == depth[y, x] and number < ids[y, x]):
        depth[y, x], ids[y, x] = t32, number


@helper
def outside(x, y, w, width, height):
    # homogeneous corners (n,): are they all beyond one side of the picture, or behind the eye?
    left, right, above, below, behind = True, True, True, True, True
    for k in range(len(w)):
        if not x[k] < -WIDEN * w[k]:
            left = False
        if not x[k] > (width + WIDEN) * w[k]:
            right = False
        if not y[k] < -WIDEN * w[k]:
            above = False
        if not y[k] > (height + WIDEN) * w[k]:
            below = False
        if w[k] > 0.0:
            behind = False
    return left or right or above or below or behind


@helper
def hidden(x, y, w, least, depth):
    # is every pixel that a block (8 corners, all before the eye) can cover nearer already than `least`?
    height, width = depth.shape
    x0, x1, y0, y1 = np.inf, -np.inf, np.inf, -np.inf
    for k in range(8):
        x0, x1 = min(x0, x[k] / w[k]), max(x1, x[k] / w[k])
        y0, y1 = min(y0, y[k] / w[k]), max(y1, y[k] / w[k])
    x0, x1 = max(math.ceil(x0 - 0.5 - WIDEN), 0), min(math.floor(x1 - 0.5 + WIDEN), width - 1)
    y0, y1 = max(math.ceil(y0 - 0.5 - WIDEN), 0), min(math.floor(y1 - 0.5 + WIDEN), height - 1)
    for row in range(int(y0), int(y1) + 1):
        for column in range(int(x0), int(x1) + 1):
            if depth[row, column] >= least:
                return False
    return True


@helper
def skip_block(pixel, u0, u1, v0, v1, low, high, x, y, w, depth):
    # can no cell between (u0, v0) and (u1, v1) with depths in [low, high] be seen? x, y, w (8,) are scratch
    least, before = np.inf, True
    for k in range(8):
        u, v, d = u1 if k & 1 else u0, v1 if k & 2 else v0, high if k & 4 else low
        x[k] = pixel[0, 0] * u + pixel[0, 1] * v + pixel[0, 2] * d + pixel[0, 3]
        y[k] = pixel[1, 0] * u + pixel[1, 1] * v + pixel[1, 2] * d + pixel[1, 3]
        w[k] = pixel[2, 0] * u + pixel[2, 1] * v + pixel[2, 2] * d + pixel[2, 3]
        least = min(least, w[k])
        before = before and w[k] > 1e-12
    if outside(x, y, w, depth.shape[1], depth.shape[0]):
        return True
    return before and hidden(x, y, w, least * (1.0 - 1e-6), depth)


@kernel
def bound_blocks(height, out_low, out_high):
    # height (H, W) f32 -> out_low, out_high (rows, columns of blocks) f32; low > high where a block has no whole cell
    rows, columns = height.shape[0] - 1, height.shape[1] - 1
    for block in prange(out_low.shape[0]):
        for part in range(out_low.shape[1]):
            low, high = np.float32(np.inf), np.float32(-np.inf)
            first, last = part * BLOCK_COLUMNS, min((part + 1) * BLOCK_COLUMNS, columns)
            for j in range(block * BLOCK_ROWS, min((block + 1) * BLOCK_ROWS, rows) + 1):
                for i in range(first, last + 1):
                    value = height[j, i]
                    low = value if value < low else low
                    high = value if value > high else high
            out_low[block, part], out_high[block, part] = low, high


@kernel
def project_heights(height, low, high, view, descending, base, depth, ids):
    # height (H, W) f32, NaN = hole; low, high: see bound_blocks; descending: (bool, bool) walk rows and columns of
    # blocks from the far end, so that near ones come first; depth (C, h, w) f32 and ids (C, h, w) u32: one picture
    # per chunk of the work, lowered in place
    pixel, rays, eye = view
    chunks, block_rows, block_columns = depth.shape[0], low.shape[0], low.shape[1]
    rows, columns = height.shape[0] - 1, height.shape[1] - 1
    m00, m01, m02, m03, m10, m11 = pixel[0, 0], pixel[0, 1], pixel[0, 2], pixel[0, 3], pixel[1, 0], pixel[1, 1]
    m12, m13, m20, m21, m22, m23 = pixel[1, 2], pixel[1, 3], pixel[2, 0], pixel[2, 1], pixel[2, 2], pixel[2, 3]
    for chunk in prange(chunks):
        x, y, w = np.empty(8), np.empty(8), np.empty(8)
        xs, ys, ws = np.empty(256), np.empty(256), np.empty(256)
        boxes, listed, count = np.empty(6 * BLOCK), np.empty(11 * LIST), 0
        own_depth, own_ids = depth[chunk], ids[chunk]
        for step in range(np.int64(chunk), block_rows, chunks):
            block = block_rows - 1 - step if descending[0] else step
            j0, j1 = block * BLOCK_ROWS, min((block + 1) * BLOCK_ROWS, rows)
            for along in range(block_columns):
                part = block_columns - 1 - along if descending[1] else along
                i0, i1 = part * BLOCK_COLUMNS, min((part + 1) * BLOCK_COLUMNS, columns)
                if not low[block, part] <= high[block, part] or skip_block(
                    pixel, float(i0), float(i1), float(j0), float(j1), low[block, part], high[block, part], x, y, w,
                    own_depth,
                ):  # fmt: skip
                    continue
                for j in range(j0, j1 + 1):
                    old, new = ((j - 1) & 1) * 128, (j & 1) * 128
                    ax, ay, aw = m01 * j + m03, m11 * j + m13, m21 * j + m23
                    for k in range(i1 - i0 + 1):
                        d, u = height[j, i0 + k], float(i0 + k)
                        wide = aw + m20 * u + m22 * d
                        scale = 1.0 / (wide if wide > 1e-12 else 1e-12)
                        xs[new + k] = (ax + m00 * u + m02 * d) * scale
                        ys[new + k] = (ay + m10 * u + m12 * d) * scale
                        ws[new + k] = wide
                    if j > j0:
                        count = list_row(
                            height, (j - 1, i0, i1), view, base, (xs, ys, ws), (old, new), boxes, listed, count,
                            (own_depth, own_ids),
                        )  # fmt: skip
        meet_listed(listed, count, rays, eye, own_depth, own_ids)


@fused
def list_row(height, cells, view, base, vertices, ends, boxes, listed, count, out):
    # list the rays of a row of cells -> how many are listed now
    j, i0, i1 = cells
    xs, ys, ws = vertices
    old, new = ends
    rows, columns = out[0].shape
    for k in range(i1 - i0):
        x0, x1, x2, x3 = xs[old + k], xs[old + k + 1], xs[new + k], xs[new + k + 1]
        y0, y1, y2, y3 = ys[old + k], ys[old + k + 1], ys[new + k], ys[new + k + 1]
        w0, w1, w2, w3 = ws[old + k], ws[old + k + 1], ws[new + k], ws[new + k + 1]
        boxes[k] = max(np.ceil(min(min(x0, x1), min(x2, x3)) - (0.5 + WIDEN)), 0.0)
        boxes[BLOCK + k] = min(np.floor(max(max(x0, x1), max(x2, x3)) - (0.5 - WIDEN)), columns - 1.0)
        boxes[2 * BLOCK + k] = max(np.ceil(min(min(y0, y1), min(y2, y3)) - (0.5 + WIDEN)), 0.0)
        boxes[3 * BLOCK + k] = min(np.floor(max(max(y0, y1), max(y2, y3)) - (0.5 - WIDEN)), rows - 1.0)
        boxes[4 * BLOCK + k] = min(min(w0, w1), min(w2, w3))
        boxes[5 * BLOCK + k] = 0.25 * ((w0 + w1) + (w2 + w3))
    for k in range(i1 - i0):
        least, near = boxes[4 * BLOCK + k], boxes[5 * BLOCK + k]
        whole = near < np.inf  # else a corner is a hole
        if whole and least > 1e-9:
            if not (boxes[k] <= boxes[BLOCK + k] and boxes[2 * BLOCK + k] <= boxes[3 * BLOCK + k]):
                continue
            left, right = int(boxes[k]), int(boxes[BLOCK + k])
            top, bottom = int(boxes[2 * BLOCK + k]), int(boxes[3 * BLOCK + k])
        elif whole:
            left, right, top, bottom = window_of_cell(height, j, i0 + k, view[0], rows, columns)
            least = 0.0
        else:
            continue
        i = i0 + k
        a, b = float(height[j, i]), float(height[j, i + 1])
        c, e = float(height[j + 1, i]), float(height[j + 1, i + 1])
        number = np.uint32(base + j * (height.shape[1] - 1) + i)
        count = list_rays(
            (left, top, right, bottom), least * (1.0 - 1e-6), float(i), float(j), (a, b, c, e), near, number, listed,
            count, view, out,
        )  # fmt: skip
    return count


@helper
def window_of_cell(height, j, i, pixel, rows, columns):
    # a cell that reaches behind the eye: nothing, or the whole picture
    x, y, w = np.empty(4), np.empty(4), np.empty(4)
    for k in range(4):
        u, v = float(i + (k & 1)), float(j + (k >> 1))
        d = height[j + (k >> 1), i + (k & 1)]
        x[k] = pixel[0, 0] * u + pixel[0, 1] * v + pixel[0, 2] * d + pixel[0, 3]
        y[k] = pixel[1, 0] * u + pixel[1, 1] * v + pixel[1, 2] * d + pixel[1, 3]
        w[k] = pixel[2, 0] * u + pixel[2, 1] * v + pixel[2, 2] * d + pixel[2, 3]
    if outside(x, y, w, columns, rows):
        return 0, -1, 0, -1
    return 0, columns - 1, 0, rows - 1


@kernel
def merge(depth, ids):
    # pictures (C, h, w) of all chunks -> the nearest of each pixel, in the first
    for y in prange(depth.shape[1]):
        for c in range(1, depth.shape[0]):
            for x in range(depth.shape[2]):
                nearer = depth[c, y, x] < depth[0, y, x]
                if nearer or (depth[c, y, x] == depth[0, y, x] and ids[c, y, x] < ids[0, y, x]):
                    depth[0, y, x], ids[0, y, x] = depth[c, y, x], ids[c, y, x]
