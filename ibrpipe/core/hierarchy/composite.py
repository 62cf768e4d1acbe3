"""Slices and polygons of a picture from front to back, tile by tile, until nothing behind shows.

Shaded texels are read in pairs of neighbours, 8 bits each of red, green, blue (premultiplied) and coverage, and blended
with weights of sixteenths in pairs of 16 bits. A slice is drawn in steps (places, texels, blending) over blocks of
lanes: what one step writes is read by the next one when it has long arrived.
"""

from __future__ import annotations

import numpy as np
from numba import prange

from ibrpipe.core.hierarchy import fragments as fr
from ibrpipe.core.hierarchy.order import TILE
from ibrpipe.core.jit import fused, helper, kernel

#: pixels of a row that are drawn at once, and lanes of a block
SPAN, LANES = 16, 256
_SPAN = np.uint64(SPAN)
#: coverage that is still worth drawing behind
_LEAST = 1.0 / 1024.0


@helper
def linearise(numbers, x, y, out):
    # affine map of pixels to texels at a place of the picture -> out (6,): u over x, y, 1, then v
    w = numbers[6] * x + numbers[7] * y + numbers[8]
    u = (numbers[0] * x + numbers[1] * y + numbers[2]) / w
    v = (numbers[3] * x + numbers[4] * y + numbers[5]) / w
    out[0], out[1] = (numbers[0] - u * numbers[6]) / w, (numbers[1] - u * numbers[7]) / w
    out[3], out[4] = (numbers[3] - v * numbers[6]) / w, (numbers[4] - v * numbers[7]) / w
    out[2], out[5] = u - out[0] * x - out[1] * y, v - out[3] * x - out[4] * y


@fused
def find_texels(affine, first, stride, wide, high, x, y, n, index, parts):
    # lanes n .. n + SPAN of a block: first texel and weights (u, v in sixteenths) of pixels x .. x + SPAN of row y
    du, dv = np.float32(affine[0]), np.float32(affine[3])
    at_u = np.float32(affine[0] * x + affine[1] * y + affine[2])
    at_v = np.float32(affine[3] * x + affine[4] * y + affine[5])
    for i in range(_SPAN):
        step = np.float32(np.int64(i))
        u = min(max(at_u + du * step, np.float32(0.0)), wide)
        v = min(max(at_v + dv * step, np.float32(0.0)), high)
        column, row = np.int32(u), np.int32(v)
        right = np.uint32(np.int32((u - np.float32(column)) * np.float32(16.0) + np.float32(0.5)))
        below = np.uint32(np.int32((v - np.float32(row)) * np.float32(16.0) + np.float32(0.5)))
        index[n + i] = first + np.uint32(row) * stride + np.uint32(column)
        parts[n + i] = right | (below << np.uint32(8))


@fused
def blend_texels(n, p, parts, upper, lower, gains, depth, planes, stopped):
    # lanes n .. n + SPAN of a block onto pixels p .. p + SPAN of the tile
    limit, red, green, blue, clear, _ = planes
    mask, whole = np.uint32(0x00FF00FF), np.uint32(16)
    for i in range(_SPAN):
        right, below = parts[n + i] & np.uint32(255), parts[n + i] >> np.uint32(8)
        a, b = upper[np.uint64(2) * (n + i)], upper[np.uint64(2) * (n + i) + np.uint64(1)]
        c, d = lower[np.uint64(2) * (n + i)], lower[np.uint64(2) * (n + i) + np.uint64(1)]
        wa, wb = (whole - right) * (whole - below), right * (whole - below)
        wc, wd = (whole - right) * below, right * below
        even = (a & mask) * wa + (b & mask) * wb + (c & mask) * wc + (d & mask) * wd
        a, b, c, d = a >> np.uint32(8), b >> np.uint32(8), c >> np.uint32(8), d >> np.uint32(8)
        odd = (a & mask) * wa + (b & mask) * wb + (c & mask) * wc + (d & mask) * wd
        through = clear[p + i] if limit[p + i] > depth else np.float32(0.0)
        cover = np.float32(np.int32(odd >> np.uint32(16)))
        through *= gains[4] - gains[5] * cover  # 1 - (1 - a) ** t, exact where t is 1 or 2
        red[p + i] += through * gains[0] * np.float32(np.int32(even & np.uint32(0xFFFF)))
        blue[p + i] += through * gains[2] * np.float32(np.int32(even >> np.uint32(16)))
        green[p + i] += through * gains[1] * np.float32(np.int32(odd & np.uint32(0xFFFF)))
        stop = through * gains[3] * cover
        stopped[i] = stop
        clear[p + i] -= stop


@fused
def note_depth(p, depth, clear, stopped, sums):
    # keeps the depth at which half of a pixel is covered, and the sum of depths by coverage
    for i in range(_SPAN):
        after = clear[p + i]
        before = after + stopped[i]
        crossed = sums[0, p + i]
        sums[0, p + i] = depth if (before > np.float32(0.5)) & (after <= np.float32(0.5)) else crossed
        sums[1, p + i] += stopped[i] * depth


@helper
def shown_part(at, slope, most, low, high):
    # first and last (exclusive) of the steps low .. high at which at + slope * step lies between 0 and most
    if abs(slope) < 1e-9:
        return (low, high) if 0.0 < at < most else (low, low)
    one, other = -at / slope, (most - at) / slope
    first, last = min(one, other), max(one, other)
    begin = low if first <= low else (high if first >= high else int(first))
    end = high if last >= high - 1.0 else (low if last <= low - 1.0 else int(last) + 1)
    return begin, end


@fused
def flush(n, depth, stride, texels, noted, block, planes):
    # blends the n lanes that wait in a block
    index, parts, spots, upper, lower, stopped, _, gains = block
    clear, sums = planes[4], planes[5]
    for i in range(n):
        upper[i] = texels[index[i]]
        lower[i] = texels[index[i] + stride]
    upper32, lower32 = upper.view(np.uint32), lower.view(np.uint32)
    for span in range(n // _SPAN):
        p = np.uint64(spots[span])
        blend_texels(span * _SPAN, p, parts, upper32, lower32, gains, depth, planes, stopped)
        if noted:
            note_depth(p, depth, clear, stopped, sums)


@fused
def draw_slice(numbers, pixels, depth, texels, left, top, noted, block, planes):
    # one slice in the tile at left, top; numbers (14,) f64 as in `slices`; texels (N,) u64: pairs of neighbours
    index, parts, spots, _, _, _, affine, gains = block
    x0, x1 = max(pixels[0] - left, 0), min(pixels[1] - left, TILE)
    y0, y1 = max(pixels[2] - top, 0), min(pixels[3] - top, TILE)
    linearise(numbers, left + 0.5 * (x0 + x1), top + 0.5 * (y0 + y1), affine)
    first, stride = np.uint32(pixels[4]), np.uint32(pixels[5] + 2)
    wide, high = np.float32(pixels[5] + 0.98), np.float32(pixels[6] + 0.98)
    for c in range(3):
        gains[c] = numbers[9 + c] / 65280.0
    gains[3] = numbers[12] / 65280.0
    gains[4], gains[5] = numbers[13], (numbers[13] - 1.0) / 65280.0
    n = np.uint64(0)
    for y in range(y0, y1):
        x, row = left + 0.5, top + y + 0.5
        at_u = affine[0] * x + affine[1] * row + affine[2]
        at_v = affine[3] * x + affine[4] * row + affine[5]
        begin, end = shown_part(at_u, affine[0], pixels[5] + 1.0, x0, x1)
        begin, end = shown_part(at_v, affine[3], pixels[6] + 1.0, begin, end)
        if begin < end:
            for span in range(begin // SPAN, (end - 1) // SPAN + 1):
                find_texels(affine, first, stride, wide, high, x + span * SPAN, row, n, index, parts)
                spots[n // _SPAN] = y * TILE + span * SPAN
                n += _SPAN
            if n > np.uint64(LANES - TILE):
                flush(n, depth, stride, texels, noted, block, planes)
                n = np.uint64(0)
    flush(n, depth, stride, texels, noted, block, planes)


@fused
def finish_tile(planes, back):
    # what is opaque comes behind the rest; colours become straight
    limit, red, green, blue, clear, sums = planes
    one, none, half, inf = np.float32(1.0), np.float32(0.0), np.float32(0.5), np.float32(np.inf)
    for p in range(np.uint64(TILE * TILE)):
        solid = limit[p] < inf
        through = clear[p] if solid else none
        behind = limit[p] if solid else none
        sums[0, p] = limit[p] if through > half else sums[0, p]
        sums[1, p] += through * behind
        clear[p] -= through
        cover = one - clear[p]
        share = one / max(cover, np.float32(1e-6))
        red[p] = (red[p] + through * back[0, p]) * share
        green[p] = (green[p] + through * back[1, p]) * share
        blue[p] = (blue[p] + through * back[2, p]) * share


@kernel
def draw_tiles(tiles, groups, size, slices, texels, triangles, captured, noted, color, alpha, depth):
    # tiles (T,) i64: numbers of tiles, dealt to `groups` in turn; size: columns of tiles, width, height
    # slices: starts (T + 1,) i64, items (E,) i64, numbers (J, 14) f64, pixels (J, 8) i64, depths (J,) f32
    # texels (N,) u64: pairs of shaded texels; triangles: starts, items, numbers (F, 21) f32, boxes (F, 4) i64
    # captured: color (H, W, 3), alpha, depth (H, W) f32 of what other renderers drew, or empty
    # noted: whether depth is asked for -> color (H, W, 3) f32, straight; alpha, depth (H, W) f32
    starts, items, numbers, pixels, depths = slices
    face_starts, face_items, face_numbers, face_boxes = triangles
    for group in prange(groups):
        area = TILE * TILE
        red, green, blue = np.empty(area, np.float32), np.empty(area, np.float32), np.empty(area, np.float32)
        clear, limit = np.empty(area, np.float32), np.empty(area, np.float32)
        back, sums = np.empty((3, area), np.float32), np.empty((2, area), np.float32)
        index, parts = np.empty(LANES, np.uint32), np.empty(LANES, np.uint32)
        spots = np.empty(LANES // SPAN, np.int64)
        upper, lower = np.empty(LANES, np.uint64), np.empty(LANES, np.uint64)
        stopped, affine, gains = np.empty(SPAN, np.float32), np.empty(6), np.empty(6, np.float32)
        near, face = np.empty(fr.SIDE * fr.SIDE, np.float32), np.empty(fr.SIDE * fr.SIDE, np.int32)
        listed, places = np.empty((fr.FRAGMENTS, 5), np.float32), np.empty(fr.FRAGMENTS, np.int32)
        buckets, order = np.empty(fr.FRAGMENTS, np.int32), np.empty(fr.FRAGMENTS, np.int32)
        state, box = np.zeros(1, np.int64), np.empty(4, np.int64)
        fronts, owners = np.empty(fr.GRID**2, np.float32), np.empty(fr.GRID**2, np.int32)
        work, partial = (state, fronts, owners, np.empty(4)), (listed, places)
        block = (index, parts, spots, upper, lower, stopped, affine, gains)
        planes = (limit, red, green, blue, clear, sums)
        for k in range(group, len(tiles), groups):
            tile = tiles[k]
            left, top = tile % size[0] * TILE, tile // size[0] * TILE
            right, bottom = min(left + TILE, size[1]), min(top + TILE, size[2])
            red[:] = 0.0
            green[:] = 0.0
            blue[:] = 0.0
            clear[:] = 1.0
            limit[:] = np.inf
            back[:] = 0.0
            sums[0, :] = np.inf
            sums[1, :] = 0.0
            state[0] = 0
            a, b = face_starts[tile], face_starts[tile + 1]
            kept = np.empty(b - a, np.int64)
            shown = fr.touching(a, b, face_items, face_numbers, face_boxes, left, top, kept)
            behind = fr.nearest_cover(shown, kept, face_numbers, face_boxes, left, top, right, bottom)
            if behind >= 0:
                fr.fill_tile(face_numbers[behind], face_boxes[behind], left, top, limit, back)
            fr.enclose(shown, kept, behind, face_boxes, left, top, box)
            for j in range(box[2] * fr.GRID, box[3] * fr.GRID):
                near[j * fr.SIDE + box[0] * fr.GRID : j * fr.SIDE + box[1] * fr.GRID] = 0.0
            for m in range(shown):
                f = kept[m]
                if f != behind:
                    fr.cast_triangle(face_numbers[f], face_boxes[f], left, top, f, near, face)
            for j in range(box[2], box[3]):
                for i in range(box[0], box[1]):
                    fr.resolve_pixel(
                        j, i, left, top, (near, face), (face_numbers, face_boxes), (limit, back), partial, work
                    )
            fr.add_captured(left, top, right, bottom, captured, (limit, back), partial, state)
            first, last = starts[tile], starts[tile + 1]
            ends = np.zeros(last - first + 2 if state[0] > 0 else 2, np.int64)
            done = 0
            if state[0] > 0:
                fr.bucket_fragments(state[0], listed, first, last, items, depths, ends, buckets)
                fr.place_fragments(state[0], buckets, ends, order)
            for m in range(first, last):
                s = items[m]
                if state[0] > 0 and ends[m - first] > done:
                    fr.blend(done, ends[m - first], order, listed, places, limit, red, green, blue, clear, sums)
                    done = ends[m - first]
                draw_slice(numbers[s], pixels[s], depths[s], texels, left, top, noted, block, planes)
                if (m - first) % 8 == 7 and fr.hidden(clear, limit, depths[s], _LEAST):
                    done = state[0]
                    break
            fr.blend(done, state[0], order, listed, places, limit, red, green, blue, clear, sums)
            finish_tile(planes, back)
            for j in range(bottom - top):
                for i in range(right - left):
                    p = j * TILE + i
                    color[top + j, left + i, 0] = red[p]
                    color[top + j, left + i, 1] = green[p]
                    color[top + j, left + i, 2] = blue[p]
                    alpha[top + j, left + i] = np.float32(1.0) - clear[p]
                    if noted:
                        depth[top + j, left + i] = fr.half_depth(alpha[top + j, left + i], sums[0, p], sums[1, p])
