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
#: samples of a row that a triangle is tried on at once
LANES = 16
#: most fragments of a tile: of triangles, and one a pixel of what other renderers drew
FRAGMENTS = TILE * TILE * (GRID * GRID + 1)


@fused
def cast_triangle(numbers, box, left, top, number, near, face):
    # near (SIDE * SIDE,) f32: greatest 1 / depth; face (SIDE * SIDE,) i32: its triangle; only of this tile's samples
    x0, x1 = max(box[0] - left, 0) * GRID, min(box[1] - left, TILE) * GRID
    y0, y1 = max(box[2] - top, 0) * GRID, min(box[3] - top, TILE) * GRID
    step = np.float32(1.0 / GRID)
    a0, a1, a2 = numbers[0] * step, numbers[3] * step, numbers[6] * step
    slope = numbers[9] * step
    x = np.float32(left - box[0]) + np.float32(0.5) * step
    for j in range(y0, y1):
        y = np.float32(top - box[2]) + (np.float32(j) + np.float32(0.5)) * step
        w0 = numbers[0] * x + numbers[1] * y + numbers[2]
        w1 = numbers[3] * x + numbers[4] * y + numbers[5]
        w2 = numbers[6] * x + numbers[7] * y + numbers[8]
        depth = numbers[9] * x + numbers[10] * y + numbers[11]
        for block in range(x0 // LANES, (x1 - 1) // LANES + 1):
            k = np.uint64(j * SIDE + block * LANES)
            for i in range(np.uint64(LANES)):
                t = np.float32(block * LANES + np.int64(i))
                inside = min(w0 + a0 * t, w1 + a1 * t, w2 + a2 * t)
                here = depth + slope * t
                hit = (inside >= np.float32(0.0)) & (here > near[k + i])
                near[k + i] = here if hit else near[k + i]
                face[k + i] = number if hit else face[k + i]


@helper
def paint(numbers, box, x, y, out):
    # -> out (4,): colour and depth of a triangle at a place of the picture
    px, py = x - box[0], y - box[2]
    depth = 1.0 / (numbers[9] * px + numbers[10] * py + numbers[11])
    for c in range(3):
        over = numbers[12 + 3 * c] * px + numbers[13 + 3 * c] * py + numbers[14 + 3 * c]
        out[c] = max(over * depth, 0.0)
    out[3] = depth


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
def nearest_cover(count, kept, numbers, boxes, left, top, right, bottom):
    # of the triangles that cover a whole tile the one that is nearest in its middle, -1 where none does
    best, over = -1, 0.0
    for m in range(count):
        f = kept[m]
        if covers_tile(numbers[f], boxes[f], left, top, right, bottom):
            x, y = 0.5 * (left + right) - boxes[f, 0], 0.5 * (top + bottom) - boxes[f, 2]
            here = numbers[f, 9] * x + numbers[f, 10] * y + numbers[f, 11]
            if here > over:
                best, over = f, here
    return best


@helper
def enclose(count, kept, left_out, boxes, left, top, out):
    # -> out (4,) i64: x0, x1, y0, y1 within the tile of all triangles but one; empty where there is none
    out[0], out[1], out[2], out[3] = TILE, 0, TILE, 0
    for m in range(count):
        f = kept[m]
        if f != left_out:
            out[0] = min(out[0], max(boxes[f, 0] - left, 0))
            out[1] = max(out[1], min(boxes[f, 1] - left, TILE))
            out[2] = min(out[2], max(boxes[f, 2] - top, 0))
            out[3] = max(out[3], min(boxes[f, 3] - top, TILE))


@helper
def touching(first, last, items, numbers, boxes, left, top, kept):
    # triangles items[first:last] that may cover something of a tile, to kept; their number
    count = 0
    for m in range(first, last):
        f = items[m]
        out = False
        for i in range(3):
            a, b, c = numbers[f, 3 * i], numbers[f, 3 * i + 1], numbers[f, 3 * i + 2]
            x = (left + TILE if a > 0 else left) - boxes[f, 0]
            y = (top + TILE if b > 0 else top) - boxes[f, 2]
            out |= a * x + b * y + c < 0.0
        if not out:
            kept[count] = f
            count += 1
    return count


@helper
def load_pixel(j, i, near, face, fronts, owners):
    # samples of a pixel -> fronts (16,) f32: 1 / depth, 0 = nothing; owners (16,) i32: their triangles
    for row in range(GRID):
        k = (j * GRID + row) * SIDE + i * GRID
        for column in range(GRID):
            n = row * GRID + column
            fronts[n], owners[n] = near[k + column], face[k + column]


@helper
def take_nearest(fronts, owners):
    # takes from a pixel's samples those of the triangle of the nearest one
    # -> the triangle, -1 where none is left; number, sum of columns, sum of rows of its samples
    lane = 0
    for n in range(1, GRID * GRID):
        lane = n if fronts[n] > fronts[lane] else lane
    if not fronts[lane] > 0.0:
        return -1, 0, 0, 0
    triangle = owners[lane]
    count, columns, rows = 0, 0, 0
    for n in range(GRID * GRID):
        same = (owners[n] == triangle) & (fronts[n] > np.float32(0.0))
        count += same
        columns += (n % GRID) * same
        rows += (n // GRID) * same
        fronts[n] = np.float32(0.0) if same else fronts[n]
    return triangle, count, columns, rows


@fused
def sole_triangle(j, i, near, face):
    # the triangle that all samples of a pixel show, -1 where there are several or it is not covered wholly, -2: nothing
    k = j * GRID * SIDE + i * GRID
    first, same, covered = face[k], 0, 0
    for row in range(GRID):
        for column in range(GRID):
            at = k + row * SIDE + column
            seen = near[at] > 0.0
            covered += seen
            same += seen & (face[at] == first)
    if covered == 0:
        return -2
    return first if same == GRID * GRID else -1


@fused
def resolve_pixel(j, i, left, top, samples, triangles, solid, partial, work):
    # one pixel of a tile: of samples near, face and triangles numbers, boxes its opaque fragment to limit, back; the
    # others to listed (FRAGMENTS, 5) f32: red, green, blue, share, depth, and places (FRAGMENTS,) i32, from state[0] on
    near, face = samples
    numbers, boxes = triangles
    limit, back = solid
    listed, places = partial
    state, fronts, owners, color = work
    p = j * TILE + i
    sole = sole_triangle(j, i, near, face)
    if sole >= 0:
        paint(numbers[sole], boxes[sole], left + i + 0.5, top + j + 0.5, color)
        if color[3] < limit[p]:
            limit[p] = color[3]
            for c in range(3):
                back[c, p] = color[c]
    if sole != -1:
        return
    load_pixel(j, i, near, face, fronts, owners)
    remaining = GRID * GRID
    while remaining > 0:
        t, count, columns, rows = take_nearest(fronts, owners)
        if t < 0:
            return
        x = left + i + (columns / count + 0.5) / GRID
        y = top + j + (rows / count + 0.5) / GRID
        paint(numbers[t], boxes[t], x, y, color)
        if color[3] < limit[p] and count == remaining:
            limit[p] = color[3]
            for c in range(3):
                back[c, p] = color[c]
        elif color[3] < limit[p]:
            at = state[0]
            for c in range(3):
                listed[at, c] = color[c]
            listed[at, 3], listed[at, 4], places[at] = count / remaining, color[3], p
            state[0] += 1
        remaining -= count


@helper
def move_forward(count, at, listed, places):
    # fragment `at` changes places with the farther ones of its pixel among the first `count`, whose places ascend
    low, high = 0, count
    while low < high:
        middle = (low + high) // 2
        if places[middle] <= places[at]:
            low = middle + 1
        else:
            high = middle
    n = low - 1
    while n >= 0 and places[n] == places[at] and listed[n, 4] > listed[at, 4]:
        for c in range(5):
            listed[n, c], listed[at, c] = listed[at, c], listed[n, c]
        at = n
        n -= 1


@helper
def add_captured(left, top, right, bottom, captured, solid, partial, state):
    # what other renderers drew: color (H, W, 3), alpha, depth (H, W) f32, or empty arrays. Pixels that it covers wholly
    # go to limit, back, others to listed, places as in resolve_pixel, before what is farther of the same pixel
    color, alpha, depth = captured
    limit, back = solid
    listed, places = partial
    if alpha.size == 0:
        return
    count = state[0]
    for y in range(top, bottom):
        for x in range(left, right):
            p = (y - top) * TILE + x - left
            if alpha[y, x] > 0.0 and depth[y, x] < limit[p]:
                if alpha[y, x] >= 1.0:
                    limit[p] = depth[y, x]
                    for c in range(3):
                        back[c, p] = color[y, x, c]
                else:
                    at = state[0]
                    for c in range(3):
                        listed[at, c] = color[y, x, c]
                    listed[at, 3], listed[at, 4], places[at] = alpha[y, x], depth[y, x], p
                    move_forward(count, at, listed, places)
                    state[0] += 1


@fused
def fill_tile(numbers, box, left, top, limit, back):
    # a tile that one triangle covers
    x = np.float32(left - box[0]) + np.float32(0.5)
    one = np.float32(1.0)
    for j in range(TILE):
        y = np.float32(top - box[2] + j) + np.float32(0.5)
        over = numbers[9] * x + numbers[10] * y + numbers[11]
        red = numbers[12] * x + numbers[13] * y + numbers[14]
        green = numbers[15] * x + numbers[16] * y + numbers[17]
        blue = numbers[18] * x + numbers[19] * y + numbers[20]
        row = np.uint64(j * TILE)
        for i in range(np.uint64(TILE)):
            t = np.float32(np.int64(i))
            depth = one / (over + numbers[9] * t)
            limit[row + i] = depth
            back[0, row + i] = (red + numbers[12] * t) * depth
            back[1, row + i] = (green + numbers[15] * t) * depth
            back[2, row + i] = (blue + numbers[18] * t) * depth


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
    seen = 0
    for p in range(len(clear)):
        seen += (clear[p] > least) & (limit[p] > depth)
    return seen == 0


@helper
def half_depth(cover, crossed, mean):
    # depth of a pixel: where half of it is covered, else the mean of what covers it
    if math.isfinite(crossed):
        return crossed
    return mean / cover if cover > 0.0 else np.inf
