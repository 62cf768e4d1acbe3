"""Nearest hits of several rays in each of some pixels: those where one ray a pixel tells too little.

Patches are projected as in :mod:`ibrpipe.core.ldi.project`; each meets the rays inside its box of those asked pixels
that its area touches. Symbols and packed arguments as there.

``asked`` = (slots (H, W) i32: number of the pixel among those asked, -1 = not asked; tiles (h, w) u8: 1 where one of
the TILE x TILE pixels is asked; offsets (n,) f64: where the n x n rays of a pixel pass through it, along
either axis; whole 64ths, which float32 holds).
"""

from __future__ import annotations

import numpy as np
from numba import prange

from ibrpipe.core.jit import fused_exact, kernel, ordered
from ibrpipe.core.ldi.project import (
    BEHIND,
    BLOCK,
    CI,
    CJ,
    LIST,
    MASK,
    NEAR,
    NOTHING,
    PATCH,
    PIXEL,
    PX,
    PY,
    X0,
    X1,
    Y0,
    Y1,
    A,
    B,
    C,
    E,
    T,
    beyond_picture,
    bound_boxes,
    insert_hit,
    meet_pieces,
    skip_block,
)  # fmt: skip
from ibrpipe.core.ldi.project_heights import WIDEN

#: pixels along an edge of a tile
TILE = 8


@kernel
def number_pixels(asked, firsts, out_slots, out_tiles, out_rows):
    # asked (H, W) u8; firsts (H,) i64: pixels asked in the rows before -> slots, tiles and (N, 2) f64 column, row of
    # each
    for tile_row in prange(out_tiles.shape[0]):
        for y in range(TILE * tile_row, min(TILE * (tile_row + 1), asked.shape[0])):
            slot = firsts[y]
            for x in range(asked.shape[1]):
                out_slots[y, x] = -1
                if asked[y, x]:
                    out_slots[y, x], out_tiles[tile_row, x // TILE] = slot, 1
                    out_rows[slot, 0], out_rows[slot, 1] = x, y
                    slot += 1


@fused_exact
def project_point(pixels, field, u, v, d):
    # homogeneous pixel (x, y, w) of a point of a field
    return (
        pixels[field, 0, 0] * u + pixels[field, 0, 1] * v + pixels[field, 0, 2] * d + pixels[field, 0, 3],
        pixels[field, 1, 0] * u + pixels[field, 1, 1] * v + pixels[field, 1, 2] * d + pixels[field, 1, 3],
        pixels[field, 2, 0] * u + pixels[field, 2, 1] * v + pixels[field, 2, 2] * d + pixels[field, 2, 3],
    )


@ordered
def block_extent(block, field, bounds, pixels):
    # least and greatest x and y of a block's bounding box; everything if it reaches behind the eye
    left, right, top, bottom = np.inf, -np.inf, np.inf, -np.inf
    for k in range(8):
        u, v, d = bounds[block, k & 1], bounds[block, 2 + ((k >> 1) & 1)], bounds[block, 4 + (k >> 2)]
        x, y, w = project_point(pixels, field, u, v, d)
        if not w > 0.0:
            return -np.inf, np.inf, -np.inf, np.inf
        left, right, top, bottom = min(left, x / w), max(right, x / w), min(top, y / w), max(bottom, y / w)
    return left, right, top, bottom


@ordered
def is_asked(tiles, left, right, top, bottom):
    # does a box of the picture touch a tile with pixels that are asked?
    rows, columns = tiles.shape
    first = int(min(max((left - WIDEN) / TILE, 0.0), columns))
    last = int(min(max((right + WIDEN) / TILE, -1.0), columns - 1.0))
    for row in range(
        int(min(max((top - WIDEN) / TILE, 0.0), rows)), int(min(max((bottom + WIDEN) / TILE, -1.0), rows - 1.0)) + 1
    ):
        for column in range(first, last + 1):
            if tiles[row, column]:
                return True
    return False


@fused_exact
def patch_extent(block, k, field, cells, corners, pixels):
    # least and greatest x and y of a patch before the eye
    left, right, top, bottom = np.inf, -np.inf, np.inf, -np.inf
    for corner in range(4):
        u, v = cells[block, 0, k] + float(corner & 1), cells[block, 1, k] + float(corner >> 1)
        x, y, w = project_point(pixels, field, u, v, float(corners[block, corner, k]))
        scale = 1.0 / max(w, 1e-12)
        x, y = x * scale, y * scale
        left, right, top, bottom = min(left, x), max(right, x), min(top, y), max(bottom, y)
    return left, right, top, bottom


@fused_exact
def touches_asked(k, slots, boxes):
    # is a pixel in the patch's box asked?
    for y in range(int(boxes[Y0, k]), int(boxes[Y1, k]) + 1):
        for x in range(int(boxes[X0, k]), int(boxes[X1, k]) + 1):
            if slots[y, x] >= 0:
                return True
    return False


@fused_exact
def first_beyond(offsets, least):
    # number of the first of the ascending offsets that is at least `least`
    first = 0
    while first < len(offsets) and offsets[first] < least:
        first += 1
    return first


@fused_exact
def list_rays(block, k, field, patches, views, asked, boxes, lists, keys, floors, part):
    # list the rays of all asked pixels that pass through the extent of a patch; a list that is full is met
    corners, cells, masks, numbers = patches
    pixels, rays, eyes, _, _ = views
    slots, _, offsets = asked
    counts, listed, tags = lists
    left, right, top, bottom = -np.inf, np.inf, -np.inf, np.inf
    if not boxes[BEHIND, k] > 0.0:
        left, right, top, bottom = patch_extent(block, k, field, cells, corners, pixels)
    left, right, top, bottom, side = left - WIDEN, right + WIDEN, top - WIDEN, bottom + WIDEN, len(offsets)
    for y in range(int(boxes[Y0, k]), int(boxes[Y1, k]) + 1):
        j_first = first_beyond(offsets, top - y)
        for x in range(int(boxes[X0, k]), int(boxes[X1, k]) + 1):
            slot = np.int64(slots[y, x])
            if slot < 0:
                continue
            i_first = first_beyond(offsets, left - x)
            for j in range(j_first, side):
                if y + offsets[j] > bottom:
                    break
                for i in range(i_first, side):
                    if x + offsets[i] > right:
                        break
                    n = counts[0]
                    listed[0, PX, n], listed[0, PY, n] = x + offsets[i] - 0.5, y + offsets[j] - 0.5
                    listed[0, CI, n], listed[0, CJ, n] = cells[block, 0, k], cells[block, 1, k]
                    listed[0, A, n], listed[0, B, n] = corners[block, 0, k], corners[block, 1, k]
                    listed[0, C, n], listed[0, E, n] = corners[block, 2, k], corners[block, 3, k]
                    listed[0, T, n] = boxes[NEAR, k]
                    tags[0, PIXEL, n], tags[0, PATCH, n] = (slot * side + j) * side + i, numbers[block, k]
                    tags[0, MASK, n] = masks[block, k]
                    counts[0] = n + 1
                    if n + 1 == LIST:
                        meet_pieces(0, LIST, field, rays, eyes[field], 0, listed, tags, keys, floors, part)
                        counts[0] = 0


@kernel
def search_subsamples(patches, blocks, bounds, views, size, asked, keys):
    # keys (parts, ranks, N * n * n) i64: nearest hits of the asked pixels' rays, row by row within a pixel, per part
    corners, cells, _, _ = patches
    pixels, rays, eyes, signs, perspective = views
    columns, rows = size
    parts, tiles, reach = keys.shape[0], asked[1], 0.5 - asked[2][0]
    floors = np.full(keys.shape[2], -1, np.int64)  # every hit counts
    for each in prange(parts):
        part = np.int64(each)  # prange counts unsigned
        boxes, listed = np.empty((6, BLOCK)), np.empty((1, 9, LIST), np.float32)
        tags, counts = np.empty((1, 5, LIST), np.int64), np.zeros(1, np.int64)
        for rank in range(keys.shape[1]):
            for ray in range(keys.shape[2]):
                keys[part, rank, ray] = NOTHING
        for block in range(part, len(blocks), parts):
            field, count = blocks[block, 0], blocks[block, 1]
            if skip_block(block, field, bounds, pixels, rays, columns, rows):
                continue
            left, right, top, bottom = block_extent(block, field, bounds, pixels)
            if not is_asked(tiles, left, right, top, bottom):
                continue
            bound_boxes(
                block, count, field, corners, cells, pixels, perspective[field], signs[field], size, reach, boxes
            )
            for k in range(count):
                if boxes[X0, k] > boxes[X1, k]:
                    continue
                if boxes[BEHIND, k] > 0.0 and beyond_picture(block, k, field, cells, corners, pixels, columns, rows):
                    continue
                if touches_asked(k, asked[0], boxes):
                    list_rays(block, k, field, patches, views, asked, boxes, (counts, listed, tags), keys, floors, part)
            meet_pieces(0, counts[0], field, rays, eyes[field], 0, listed, tags, keys, floors, part)
            counts[0] = 0


@kernel
def merge_subsamples(keys, out_depth, out_ids):
    # keys as above, changed -> the nearest of all parts: depth (ranks, N, n * n) f32, ids (ranks, N, n * n) u32
    rays, last = out_depth.shape[2], keys.shape[1] - 1
    for slot in prange(out_depth.shape[1]):
        for ray in range(rays):
            at = np.int64(slot) * rays + ray
            for part in range(1, keys.shape[0]):
                for rank in range(keys.shape[1]):
                    if keys[part, rank, at] < keys[0, last, at]:
                        insert_hit(keys[part, rank, at], keys, 0, at)
            for rank in range(keys.shape[1]):
                out_depth[rank, slot, ray] = np.int32(keys[0, rank, at] >> 32).view(np.float32)
                out_ids[rank, slot, ray] = keys[0, rank, at] & 0xFFFFFFFF


@kernel
def mean_colors(colors, known, rows, out_color, out_known):
    # colors (N, S, 3) f32, known (N, S) f32 of the rays of the asked pixels; rows (N, 2) f64: these -> colour (H, W, 3)
    # f32, the mean of what covers them, and how much of them that is (H, W) f32
    rays = colors.shape[1]
    for pixel in prange(colors.shape[0]):
        red, green, blue, share = 0.0, 0.0, 0.0, 0.0
        for ray in range(rays):
            weight = known[pixel, ray]
            red += weight * colors[pixel, ray, 0]
            green += weight * colors[pixel, ray, 1]
            blue += weight * colors[pixel, ray, 2]
            share += weight
        y, x = np.int64(rows[pixel, 1]), np.int64(rows[pixel, 0])
        scale = 1.0 / share if share > 0.0 else 0.0
        out_color[y, x, 0], out_color[y, x, 1], out_color[y, x, 2] = red * scale, green * scale, blue * scale
        out_known[y, x] = share / rays
