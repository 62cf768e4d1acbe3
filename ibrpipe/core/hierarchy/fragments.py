"""Triangles in one tile of the picture: 4 x 4 samples a pixel, then fragments of pixels from front to back.

A pixel that triangles cover wholly has one last, opaque fragment: its depth is the tile's `limit` there, beyond which
slices are hidden. All fragments before it are kept as a list, each with the share of what reaches it that it stops.
"""

from __future__ import annotations

import math

import numpy as np

from ibrpipe.core.hierarchy.order import TILE
from ibrpipe.core.jit import fused, helper

#: samples along a side of a pixel, and of a tile
GRID = 4
SIDE = TILE * GRID
#: most fragments of a tile
FRAGMENTS = TILE * TILE * GRID * GRID


@fused
def cast_triangle(numbers, box, left, top, number, near, face):
    # near (SIDE * SIDE,) f32: greatest 1 / depth; face (SIDE * SIDE,) i32: its triangle; only of this tile's samples
    x0, x1 = max(box[0] - left, 0) * GRID, min(box[1] - left, TILE) * GRID
    y0, y1 = max(box[2] - top, 0) * GRID, min(box[3] - top, TILE) * GRID
    step = np.float32(1.0 / GRID)
    a0, a1, a2 = numbers[0] * step, numbers[3] * step, numbers[6] * step
    slope = a0 * numbers[9] + a1 * numbers[10] + a2 * numbers[11]
    x = np.float32(left - box[0]) + np.float32(0.5) * step
    for j in range(y0, y1):
        y = np.float32(top - box[2]) + (np.float32(j) + np.float32(0.5)) * step
        w0 = numbers[0] * x + numbers[1] * y + numbers[2]
        w1 = numbers[3] * x + numbers[4] * y + numbers[5]
        w2 = numbers[6] * x + numbers[7] * y + numbers[8]
        depth = w0 * numbers[9] + w1 * numbers[10] + w2 * numbers[11]
        row = j * SIDE
        for i in range(x0, x1):
            t = np.float32(i)
            inside = min(w0 + a0 * t, w1 + a1 * t, w2 + a2 * t)
            here = depth + slope * t
            k = np.uint64(row + i)
            hit = (inside >= np.float32(0.0)) & (here > near[k])
            near[k] = here if hit else near[k]
            face[k] = number if hit else face[k]


@helper
def paint(numbers, box, x, y, out):
    # -> out (4,): colour and depth of a triangle at a place of the picture; weights are kept inside it
    px, py = x - box[0], y - box[2]
    w0 = max(numbers[0] * px + numbers[1] * py + numbers[2], 0.0)
    w1 = max(numbers[3] * px + numbers[4] * py + numbers[5], 0.0)
    w2 = max(numbers[6] * px + numbers[7] * py + numbers[8], 0.0)
    total = w0 + w1 + w2
    w0, w1, w2 = w0 * numbers[9] / total, w1 * numbers[10] / total, w2 * numbers[11] / total
    over = w0 + w1 + w2
    for c in range(3):
        out[c] = (w0 * numbers[12 + c] + w1 * numbers[15 + c] + w2 * numbers[18 + c]) / over
    out[3] = 1.0 / over


@helper
def covers_tile(numbers, box, left, top, right, bottom):
    # whether a triangle covers all pixels from left, top to right, bottom (exclusive)
    if box[0] > left or box[1] < right or box[2] > top or box[3] < bottom:
        return False
    for i in range(3):
        a, b, c = numbers[3 * i], numbers[3 * i + 1], numbers[3 * i + 2]
        x = (left if a > 0 else right) - box[0]
        y = (top if b > 0 else bottom) - box[2]
        if a * x + b * y + c < 0.0:
            return False
    return True


@helper
def split_pixel(j, i, near, face, triangles, counts, depths):
    # the triangles of a pixel by depth -> triangles (16,) i32, counts, sums of x, sums of y (3, 16) i32, depths (16,):
    # greatest 1 / depth of each; their number
    found = 0
    for row in range(GRID):
        for column in range(GRID):
            k = (j * GRID + row) * SIDE + i * GRID + column
            if near[k] > 0.0:
                n = 0
                while n < found and triangles[n] != face[k]:
                    n += 1
                if n == found:
                    triangles[n], depths[n] = face[k], near[k]
                    counts[0, n], counts[1, n], counts[2, n] = 0, 0, 0
                    found += 1
                counts[0, n] += 1
                counts[1, n] += column
                counts[2, n] += row
                depths[n] = max(depths[n], near[k])
    for n in range(1, found):
        m = n
        while m > 0 and depths[m - 1] < depths[m]:
            depths[m - 1], depths[m] = depths[m], depths[m - 1]
            triangles[m - 1], triangles[m] = triangles[m], triangles[m - 1]
            for c in range(3):
                counts[c, m - 1], counts[c, m] = counts[c, m], counts[c, m - 1]
            m -= 1
    return found


@helper
def resolve_pixel(j, i, left, top, near, face, numbers, boxes, limit, back, listed, places, work):
    # one pixel of a tile: its opaque fragment to limit, back; the others to listed (FRAGMENTS, 5) f32: red, green,
    # blue, share, depth, and places (FRAGMENTS,) i32, from `work[0][0]` on, which counts on
    state, triangles, counts, depths, color = work
    found = split_pixel(j, i, near, face, triangles, counts, depths)
    remaining = GRID * GRID
    p = j * TILE + i
    for n in range(found):
        count = counts[0, n]
        x = left + i + (counts[1, n] / count + 0.5) / GRID
        y = top + j + (counts[2, n] / count + 0.5) / GRID
        t = triangles[n]
        paint(numbers[t], boxes[t], x, y, color)
        if count == remaining:
            limit[p] = color[3]
            for c in range(3):
                back[c, p] = color[c]
        else:
            at = state[0]
            for c in range(3):
                listed[at, c] = color[c]
            listed[at, 3], listed[at, 4], places[at] = count / remaining, color[3], p
            state[0] += 1
        remaining -= count


@helper
def fill_tile(numbers, box, left, top, right, bottom, limit, back, color):
    # a tile that one triangle covers
    for j in range(bottom - top):
        for i in range(right - left):
            paint(numbers, box, left + i + 0.5, top + j + 0.5, color)
            p = j * TILE + i
            limit[p] = color[3]
            for c in range(3):
                back[c, p] = color[c]


@helper
def bucket_fragments(count, listed, first, last, items, depths, starts, order):
    # the fragments of a tile by the first of its slices first .. last (exclusive) behind which they do not lie
    # -> starts (last - first + 2,) i64: fragments before slice n are order[starts[n] : starts[n + 1]]
    slices = last - first
    starts[: slices + 2] = 0
    for n in range(count):
        low, high = 0, slices
        while low < high:
            middle = (low + high) // 2
            if depths[items[first + middle]] < listed[n, 4]:
                low = middle + 1
            else:
                high = middle
        order[n] = low
        starts[low + 1] += 1
    for n in range(slices + 1):
        starts[n + 1] += starts[n]


@helper
def place_fragments(count, buckets, starts, order):
    # counting sort, stable: buckets (N,) i32, starts as above -> order (N,) i32
    for n in range(count):
        b = buckets[n]
        order[starts[b]] = n
        starts[b] += 1


@helper
def blend(first, last, order, listed, places, limit, red, green, blue, clear, sums):
    # blends fragments in their order; sums (2, P): depth where half of the pixel is covered, coverage times depth
    for m in range(first, last):
        n = order[m]
        p = places[n]
        depth = listed[n, 4]
        if depth < limit[p]:
            weight = clear[p] * listed[n, 3]
            red[p] += weight * listed[n, 0]
            green[p] += weight * listed[n, 1]
            blue[p] += weight * listed[n, 2]
            after = clear[p] - weight
            if clear[p] > 0.5 and after <= 0.5:
                sums[0, p] = depth
            sums[1, p] += weight * depth
            clear[p] = after


@helper
def hidden(clear, limit, depth, least):
    # whether nothing at or behind `depth` shows in a tile any more
    for p in range(len(clear)):
        if clear[p] > least and limit[p] > depth:
            return False
    return True


@helper
def half_depth(cover, crossed, mean):
    # depth of a pixel: where half of it is covered, else the mean of what covers it
    if math.isfinite(crossed):
        return crossed
    return mean / cover if cover > 0.0 else np.inf
