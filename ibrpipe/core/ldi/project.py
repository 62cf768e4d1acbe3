"""Nearest hit of every pixel with the patches of layered images, by projecting the patches in vector loops.

As in :mod:`ibrpipe.core.ldi.project_heights`, every patch meets exactly the rays whose pixels it covers. Blocks of
patches that are out of view, or turned away as a whole, are left out. The boxes of the other patches are cut into
pieces of at most 2 x 2 pixels; pieces of one size are listed together, and all of one list are met in one loop without
branches.

A hit is one word: the bits of its camera depth (float32, positive, so they sort like the depth) above its patch's
number. The least words of a pixel above its floor win, whatever the order of the work and the number of threads: the
nearest hit, or so many one behind another.

Symbols: see :mod:`ibrpipe.core.ldi.project_heights`; kind = pixels of a piece: columns - 1 + 2 (rows - 1).

Packed arguments: ``patches`` (corners (B, 4, BLOCK) f32, cells (B, 2, BLOCK) f32 column and row, masks (B, BLOCK) u8,
numbers (B, BLOCK) u32), in blocks; ``views`` (pixels (F, 3, 4), rays (F, 16): start, then Q_of row by row, eyes (F,):
camera depth that still belongs to the eye, signs (F,): sign of the screen's turn where a front is seen, perspective
(F,) bool) of all fields; ``size`` (columns, rows) of the picture; ``lists`` (counts (4,), listed, tags) by kind.
"""

from __future__ import annotations

import numpy as np
from numba import prange

from ibrpipe.core.jit import kernel, ordered
from ibrpipe.core.ldi.project_heights import OVERLAP, WIDEN
from ibrpipe.core.rays import patch_quadratic

#: patches of a block of work
BLOCK = 256
#: pieces of one kind that are met together
LIST = 256
#: what the picture holds where nothing is hit: infinite depth
NOTHING = 0x7F800000 << 32
#: rows of `boxes` (6, BLOCK): first and last pixel along x and y, mean weight, does it reach behind the eye?
X0, X1, Y0, Y1, NEAR, BEHIND = range(6)
#: rows of `listed` (4, 9, LIST) by kind: first pixel, cell, corners, camera depth from where the ray is counted
PX, PY, CI, CJ, A, B, C, E, T = range(9)
#: rows of `tags` (4, 5, LIST) by kind: first pixel in the picture, patch, mask; and of what is met: pixel, hit
PIXEL, PATCH, MASK, AT, HIT = range(5)


@ordered
def skip_block(block, field, bounds, pixels, starts, columns, rows):
    # can no patch of the block be seen from the front? bounds (B, 10): least and greatest u, v, d, slope along u, along
    # v; pixels (F, 3, 4); starts (F, 4): the eye in homogeneous field coordinates
    left, right, above, below, behind = True, True, True, True, True
    for k in range(8):
        u, v, d = bounds[block, k & 1], bounds[block, 2 + ((k >> 1) & 1)], bounds[block, 4 + (k >> 2)]
        x = pixels[field, 0, 0] * u + pixels[field, 0, 1] * v + pixels[field, 0, 2] * d + pixels[field, 0, 3]
        y = pixels[field, 1, 0] * u + pixels[field, 1, 1] * v + pixels[field, 1, 2] * d + pixels[field, 1, 3]
        w = pixels[field, 2, 0] * u + pixels[field, 2, 1] * v + pixels[field, 2, 2] * d + pixels[field, 2, 3]
        left &= x < -WIDEN * w
        right &= x > (columns + WIDEN) * w
        above &= y < -WIDEN * w
        below &= y > (rows + WIDEN) * w
        behind &= w <= 0.0
    if left or right or above or below or behind:
        return True
    if not starts[field, 3] > 0.0:
        return False
    # the offset from the eye to a point of the block, less what the surface rises along it: never forward?
    most = bounds[block, 5] - starts[field, 2] / starts[field, 3]
    size = abs(bounds[block, 5]) + abs(starts[field, 2] / starts[field, 3])
    for axis in range(2):
        eye = starts[field, axis] / starts[field, 3]
        rise = -np.inf
        for k in range(4):
            offset = bounds[block, 2 * axis + (k & 1)] - eye
            slope = bounds[block, 6 + 2 * axis + (k >> 1)]
            rise = max(rise, -slope * offset)
            size = max(size, abs(slope) * (abs(eye) + abs(offset)))
        most += rise
    return most < -1e-6 * size


@ordered
def bound_boxes(block, count, field, corners, cells, pixels, perspective, sign, size, reach, boxes):
    # project the patches of a block -> boxes; first > last pixel where no pixel is covered within `reach` of its
    # centre, or no front is seen; a patch that reaches behind the eye may cover all pixels
    m00, m01, m02, m03 = pixels[field, 0, 0], pixels[field, 0, 1], pixels[field, 0, 2], pixels[field, 0, 3]
    m10, m11, m12, m13 = pixels[field, 1, 0], pixels[field, 1, 1], pixels[field, 1, 2], pixels[field, 1, 3]
    m20, m21, m22, m23 = pixels[field, 2, 0], pixels[field, 2, 1], pixels[field, 2, 2], pixels[field, 2, 3]
    last_x, last_y = size[0] - 1.0, size[1] - 1.0
    for k in range(count):
        u, v = float(cells[block, 0, k]), float(cells[block, 1, k])
        a, b = float(corners[block, 0, k]), float(corners[block, 1, k])
        c, e = float(corners[block, 2, k]), float(corners[block, 3, k])
        bx, by, bw = m00 * u + m01 * v + m03, m10 * u + m11 * v + m13, m20 * u + m21 * v + m23
        w0, w1, w2, w3 = bw + m22 * a, bw + m20 + m22 * b, bw + m21 + m22 * c, bw + m20 + m21 + m22 * e
        r0, r1 = 1.0 / (w0 if w0 > 1e-12 else 1e-12), 1.0 / (w1 if w1 > 1e-12 else 1e-12)
        r2, r3 = 1.0 / (w2 if w2 > 1e-12 else 1e-12), 1.0 / (w3 if w3 > 1e-12 else 1e-12)
        x0, x1 = (bx + m02 * a) * r0, (bx + m00 + m02 * b) * r1
        x2, x3 = (bx + m01 + m02 * c) * r2, (bx + m00 + m01 + m02 * e) * r3
        y0, y1 = (by + m12 * a) * r0, (by + m10 + m12 * b) * r1
        y2, y3 = (by + m11 + m12 * c) * r2, (by + m10 + m11 + m12 * e) * r3
        w01, w23, v01, v23 = w0 if w0 < w1 else w1, w2 if w2 < w3 else w3, w0 if w0 > w1 else w1, w2 if w2 > w3 else w3
        least, greatest = w01 if w01 < w23 else w23, v01 if v01 > v23 else v23
        p01, p23, q01, q23 = x0 if x0 < x1 else x1, x2 if x2 < x3 else x3, x0 if x0 > x1 else x1, x2 if x2 > x3 else x3
        left, right = (
            np.ceil((p01 if p01 < p23 else p23) - (0.5 + WIDEN) - reach),
            np.floor((q01 if q01 > q23 else q23) - (0.5 - WIDEN) + reach),
        )
        p01, p23, q01, q23 = y0 if y0 < y1 else y1, y2 if y2 < y3 else y3, y0 if y0 > y1 else y1, y2 if y2 > y3 else y3
        top, bottom = (
            np.ceil((p01 if p01 < p23 else p23) - (0.5 + WIDEN) - reach),
            np.floor((q01 if q01 > q23 else q23) - (0.5 - WIDEN) + reach),
        )
        # does the screen turn the wrong way, by a fifth of the patch's size at least, at all corners? A bilinear patch
        # whose corners are about equally far then shows no front anywhere
        k0 = sign * ((x1 - x0) * (y2 - y0) - (y1 - y0) * (x2 - x0))
        k1 = sign * ((x1 - x0) * (y3 - y1) - (y1 - y0) * (x3 - x1))
        k2 = sign * ((x3 - x2) * (y2 - y0) - (y3 - y2) * (x2 - x0))
        k3 = sign * ((x3 - x2) * (y3 - y1) - (y3 - y2) * (x3 - x1))
        p01, p23, q01, q23 = k0 if k0 < k1 else k1, k2 if k2 < k3 else k3, k0 if k0 > k1 else k1, k2 if k2 > k3 else k3
        worst, best = p01 if p01 < p23 else p23, q01 if q01 > q23 else q23
        away = (best < 0.2 * worst - 1e-3) & (greatest <= 1.05 * least)
        before = least > 1e-9 * greatest
        left, right = left if left > 0.0 else 0.0, right if right < last_x else last_x
        top, bottom = top if top > 0.0 else 0.0, bottom if bottom < last_y else last_y
        skip = (before & (away | (top > bottom))) | (greatest <= 0.0)
        boxes[X0, k] = (left if before else 0.0) if not skip else 1.0
        boxes[X1, k] = (right if before else last_x) if not skip else 0.0
        boxes[Y0, k] = top if before else 0.0
        boxes[Y1, k] = bottom if before else last_y
        # weights of a perspective frame are camera depth / own depth
        near = 0.25 * ((w0 + w1) + (w2 + w3))
        boxes[NEAR, k] = near * (4.0 / abs((a + b) + (c + e))) if perspective else near
        boxes[BEHIND, k] = 0.0 if before else 1.0


@ordered
def insert_hit(hit, keys, part, at):
    # put a hit among the nearest of a pixel, ascending; the farthest of them goes
    rank = keys.shape[1] - 1
    while rank > 0 and hit < keys[part, rank - 1, at]:
        keys[part, rank, at] = keys[part, rank - 1, at]
        rank -= 1
    keys[part, rank, at] = hit


@ordered
def meet_pieces(kind, count, field, rays, eye, columns, listed, tags, keys, floors, part):
    # meet the rays of all listed pieces of one kind and enter the hits beyond the floors into picture `part`
    r00, r01, r02, r10, r11, r12 = (
        rays[field, 4], rays[field, 5], rays[field, 6], rays[field, 7], rays[field, 8], rays[field, 9],
    )  # fmt: skip
    r20, r21, r22, r30, r31, r32 = (
        rays[field, 10], rays[field, 11], rays[field, 12], rays[field, 13], rays[field, 14], rays[field, 15],
    )  # fmt: skip
    s0, s1, s2, s3 = rays[field, 0], rays[field, 1], rays[field, 2], rays[field, 3]
    last = keys.shape[1] - 1
    for step in range(4):
        if (step & ~kind) != 0:
            continue
        right, below = (step & 1) + 0.5, (step >> 1) + 0.5
        shift = (step & 1) + (step >> 1) * columns
        for n in range(count):
            px, py = listed[kind, PX, n] + right, listed[kind, PY, n] + below
            i, j = float(listed[kind, CI, n]), float(listed[kind, CJ, n])
            a, b, c, e = (
                float(listed[kind, A, n]),
                float(listed[kind, B, n]),
                float(listed[kind, C, n]),
                float(listed[kind, E, n]),
            )
            near, mask = float(listed[kind, T, n]), tags[kind, MASK, n]
            direction = (
                r00 * px + r01 * py + r02,
                r10 * px + r11 * py + r12,
                r20 * px + r21 * py + r22,
                r30 * px + r31 * py + r32,
            )
            aa, bb, cc, u, v, q, du, dv, dq = patch_quadratic((s0, s1, s2, s3), direction, i, j, (a, b, c, e), near)
            square = bb * bb - 4.0 * aa * cc
            w = -0.5 * (bb + np.copysign(np.sqrt(square if square > 0.0 else 0.0), bb))
            one, two = cc / w, w / aa  # infinite or NaN where there is no such root: no comparison below then holds
            wide = q + one * dq
            p, r, slack = u + one * du, v + one * dv, OVERLAP * wide
            quadrant = (0 if p <= 0.5 * wide else 1) + (0 if r <= 0.5 * wide else 2)
            good = (-slack <= p) & (-slack <= r) & (p <= wide + slack) & (r <= wide + slack)
            good &= (near + one > eye) & (wide > 0.0) & (square >= 0.0) & (2.0 * aa * one + bb > 0.0)
            good &= ((mask >> quadrant) & 1) == 1
            one = one if good else np.inf
            wide = q + two * dq
            p, r, slack = u + two * du, v + two * dv, OVERLAP * wide
            quadrant = (0 if p <= 0.5 * wide else 1) + (0 if r <= 0.5 * wide else 2)
            good = (-slack <= p) & (-slack <= r) & (p <= wide + slack) & (r <= wide + slack)
            good &= (near + two > eye) & (wide > 0.0) & (square >= 0.0) & (2.0 * aa * two + bb > 0.0)
            good &= ((mask >> quadrant) & 1) == 1
            two = two if good else np.inf
            t = np.float32(near + (one if one < two else two))
            tags[kind, AT, n] = tags[kind, PIXEL, n] + shift
            tags[kind, HIT, n] = (np.int64(t.view(np.int32)) << 32) | tags[kind, PATCH, n]
        for n in range(count):
            at, hit = tags[kind, AT, n], tags[kind, HIT, n]
            if hit < keys[part, last, at] and hit > floors[at]:
                insert_hit(hit, keys, part, at)


@ordered
def list_pieces(block, count, field, patches, views, size, boxes, lists, keys, floors, part):
    # cut the boxes of a block's patches into pieces and list them; lists that are full are met
    corners, cells, masks, numbers = patches
    pixels, rays, eyes, _, _ = views
    columns, rows = size
    counts, listed, tags = lists
    for k in range(count):
        if boxes[X0, k] > boxes[X1, k]:
            continue
        if boxes[BEHIND, k] > 0.0 and beyond_picture(block, k, field, cells, corners, pixels, columns, rows):
            continue
        x0, x1, y0, y1 = int(boxes[X0, k]), int(boxes[X1, k]), int(boxes[Y0, k]), int(boxes[Y1, k])
        for y in range(y0, y1 + 1, 2):
            for x in range(x0, x1 + 1, 2):
                kind = (1 if x < x1 else 0) + (2 if y < y1 else 0)
                n = counts[kind]
                listed[kind, PX, n], listed[kind, PY, n] = x, y
                listed[kind, CI, n], listed[kind, CJ, n] = cells[block, 0, k], cells[block, 1, k]
                listed[kind, A, n], listed[kind, B, n] = corners[block, 0, k], corners[block, 1, k]
                listed[kind, C, n], listed[kind, E, n] = corners[block, 2, k], corners[block, 3, k]
                listed[kind, T, n] = boxes[NEAR, k]
                tags[kind, PIXEL, n], tags[kind, PATCH, n], tags[kind, MASK, n] = (
                    y * columns + x,
                    numbers[block, k],
                    masks[block, k],
                )
                counts[kind] += 1
                if n + 1 == LIST:
                    meet_pieces(kind, n + 1, field, rays, eyes[field], columns, listed, tags, keys, floors, part)
                    counts[kind] = 0


@ordered
def beyond_picture(block, k, field, cells, corners, pixels, columns, rows):
    # a patch that reaches behind the eye: is all of it beyond one side of the picture, or behind?
    left, right, above, below, behind = True, True, True, True, True
    for corner in range(4):
        u, v = cells[block, 0, k] + float(corner & 1), cells[block, 1, k] + float(corner >> 1)
        d = float(corners[block, corner, k])
        x = pixels[field, 0, 0] * u + pixels[field, 0, 1] * v + pixels[field, 0, 2] * d + pixels[field, 0, 3]
        y = pixels[field, 1, 0] * u + pixels[field, 1, 1] * v + pixels[field, 1, 2] * d + pixels[field, 1, 3]
        w = pixels[field, 2, 0] * u + pixels[field, 2, 1] * v + pixels[field, 2, 2] * d + pixels[field, 2, 3]
        left &= x < -WIDEN * w
        right &= x > (columns + WIDEN) * w
        above &= y < -WIDEN * w
        below &= y > (rows + WIDEN) * w
        behind &= w <= 0.0
    return left or right or above or below or behind


@kernel
def project_patches(patches, blocks, bounds, views, size, keys, floors):
    # blocks (B, 2) i64: field, count; bounds (B, 10) f64: see skip_block; keys (parts, ranks, rows * columns) i64: the
    # nearest hits of a picture per part; floors (rows * columns,) i64: hits count above them, -1 = all
    corners, cells, _, _ = patches
    pixels, rays, eyes, signs, perspective = views
    columns, rows = size
    parts = keys.shape[0]
    for each in prange(parts):
        part = np.int64(each)  # prange counts unsigned
        boxes, listed = np.empty((6, BLOCK)), np.empty((4, 9, LIST), np.float32)
        tags, counts = np.empty((4, 5, LIST), np.int64), np.zeros(4, np.int64)
        for rank in range(keys.shape[1]):
            for pixel in range(keys.shape[2]):
                keys[part, rank, pixel] = NOTHING
        for block in range(part, len(blocks), parts):
            field, count = blocks[block, 0], blocks[block, 1]
            if not skip_block(block, field, bounds, pixels, rays, columns, rows):
                bound_boxes(
                    block, count, field, corners, cells, pixels, perspective[field], signs[field], size, 0.0, boxes
                )
                list_pieces(
                    block, count, field, patches, views, size, boxes, (counts, listed, tags), keys, floors, part
                )
            if block + parts >= len(blocks) or blocks[block + parts, 0] != field:
                for kind in range(4):
                    meet_pieces(kind, counts[kind], field, rays, eyes[field], columns, listed, tags, keys, floors, part)
                    counts[kind] = 0


@kernel
def merge_pictures(keys, columns, depth, ids):
    # keys (parts, ranks, rows * columns) i64: the pictures of all parts, changed -> depth (ranks, rows, columns) f32,
    # ids (ranks, rows, columns) u32
    last = keys.shape[1] - 1
    for y in prange(depth.shape[1]):
        first = np.int64(y) * columns
        for x in range(columns):
            at = first + x
            for part in range(1, keys.shape[0]):
                for rank in range(keys.shape[1]):
                    if keys[part, rank, at] < keys[0, last, at]:
                        insert_hit(keys[part, rank, at], keys, np.int64(0), at)
            for rank in range(keys.shape[1]):
                depth[rank, y, x] = np.int32(keys[0, rank, at] >> 32).view(np.float32)
                ids[rank, y, x] = keys[0, rank, at] & 0xFFFFFFFF
