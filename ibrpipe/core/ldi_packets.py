"""The ray search for tiles of 8 x 8 pixels whose rays walk one field together. Source: gong-yang, sec. 5.1.

Where the rays go is decided in float32 for all of a tile's rays at a time (:mod:`ibrpipe.core.ldi_lanes`); what is hit
is decided in float64 by `meet_cell`. Bounds that float32 may round are padded; a ray that has not ended after many
steps is walked anew in float64, so none is lost. Tiles are independent: the thread count changes nothing.

Symbols: `exact` (10, 64) f64 per pixel of the tile: u, v, d, du, dv, dd of the clipped ray, then ta, tb, qa, qb (see
:mod:`ibrpipe.core.rays`). `corner` (4,): the tile's first pixel x, y, and the window's end x, y.
"""

from __future__ import annotations

import numpy as np
from numba import prange

from ibrpipe.core import ldi_lanes as lanes
from ibrpipe.core.jit import fused, helper, kernel
from ibrpipe.core.ldi_beam import walk_beam
from ibrpipe.core.ldi_search import OVERLAP, meet_cell, walk_ray
from ibrpipe.core.rays import clip_box, clip_tile, depth_at

SIDE = 8
#: least change of u or v along the whole ray, in cells, that counts as movement in float32
STILL = 1e-6

U0, V0, W0, DU, DV, DW, IU, IV = lanes.U0, lanes.V0, lanes.W0, lanes.DU, lanes.DV, lanes.DW, lanes.IU, lanes.IV
S, CI, CJ, LE, SZ, ID, EX = lanes.S, lanes.CI, lanes.CJ, lanes.LE, lanes.SZ, lanes.ID, lanes.EX
FLOATS, WAITING, DONE = lanes.FLOATS, lanes.WAITING, lanes.DONE


@helper
def clip_pixel(x, y, pixel, start, turn, box, far, out):
    # out (10, 64): the pixel's clipped ray; -> whether it can meet the field before depth `far`
    px, py = x + 0.5, y + 0.5
    r0 = turn[0, 0] * px + turn[0, 1] * py + turn[0, 2]
    r1 = turn[1, 0] * px + turn[1, 1] * py + turn[1, 2]
    r2 = turn[2, 0] * px + turn[2, 1] * py + turn[2, 2]
    r3 = turn[3, 0] * px + turn[3, 1] * py + turn[3, 2]
    near, far = clip_box(start, r0, r1, r2, r3, box, far)
    if not near <= far:
        return False
    qa, qb = start[3] + near * r3, start[3] + far * r3
    if not (qa > 0.0 and qb > 0.0):
        return False
    u, v, d = (start[0] + near * r0) / qa, (start[1] + near * r1) / qa, (start[2] + near * r2) / qa
    du = (start[0] + far * r0) / qb - u
    dv = (start[1] + far * r1) / qb - v
    dd = (start[2] + far * r2) / qb - d
    out[0, pixel], out[1, pixel], out[2, pixel], out[3, pixel], out[4, pixel], out[5, pixel] = u, v, d, du, dv, dd
    out[6, pixel], out[7, pixel], out[8, pixel], out[9, pixel] = near, far, qa, qb
    return True


@helper
def farthest(corner, best):
    # greatest depth found so far in the tile
    far = np.float32(0.0)
    for y in range(corner[1], min(corner[1] + SIDE, corner[3])):
        for x in range(corner[0], min(corner[0] + SIDE, corner[2])):
            far = best[y, x] if best[y, x] > far else far
    return float(far)


@fused
def shorten(exact, pixel, far):
    # end a parallel frame's clipped ray at depth `far` -> whether anything is left of it
    near, end = exact[6, pixel], exact[7, pixel]
    if not (near <= end and near <= far):
        return False
    if far < end:
        share = (far - near) / (end - near)
        exact[3, pixel] *= share
        exact[4, pixel] *= share
        exact[5, pixel] *= share
        exact[7, pixel] = far
    return True


@fused
def may_rise(exact, pixel, slopes):
    # whether the ray can pass any surface of the field from its front
    du, dv, dd = exact[3, pixel], exact[4, pixel], exact[5, pixel]
    return dd - min(slopes[0] * du, slopes[1] * du) - min(slopes[2] * dv, slopes[3] * dv) > 0.0


@fused
def set_lane(f, n, pixel, exact, columns, rows, grid, level, t):
    # lane n becomes `pixel`'s ray (10,), starting at camera depth t (parallel frames) and level `level`
    s = max((t - exact[6, pixel]) / (exact[7, pixel] - exact[6, pixel]), 0.0) if t > exact[6, pixel] else 0.0
    du, dv = exact[3, pixel], exact[4, pixel]
    f[U0 + n], f[V0 + n], f[W0 + n] = exact[0, pixel], exact[1, pixel], (exact[2, pixel] - grid[0]) * grid[1]
    still_u, still_v = abs(du) < STILL, abs(dv) < STILL
    f[DU + n], f[DV + n], f[DW + n] = (0.0 if still_u else du), (0.0 if still_v else dv), exact[5, pixel] * grid[1]
    f[IU + n], f[IV + n] = (1e30 if still_u else 1.0 / du), (1e30 if still_v else 1.0 / dv)
    f[CI + n] = min(max(int(exact[0, pixel] + s * du), 0), columns - 1)
    f[CJ + n] = min(max(int(exact[1, pixel] + s * dv), 0), rows - 1)
    f[S + n], f[LE + n], f[SZ + n], f[ID + n] = s, level, 1 << level, pixel


@fused
def record_hit(corner, hit, patch, i, j, exact, pixel, number, best, index, patches, places):
    # keep the hit at parameter `hit` of the pixel's ray in patch `patch`, cell (i, j), if it is the nearest so far
    x, y = corner[0] + (pixel & (SIDE - 1)), corner[1] + pixel // SIDE
    t = np.float32(
        depth_at(min(max(hit, 0.0), 1.0), exact[6, pixel], exact[7, pixel], exact[8, pixel], exact[9, pixel])
    )
    if not t < best[y, x]:
        return
    best[y, x] = t
    if index.shape[0] > 0:
        index[y, x] = number
        patches[y, x] = patch
        places[y, x, 0] = min(max(exact[0, pixel] + hit * exact[3, pixel] - i, 0.0), 1.0)
        places[y, x, 1] = min(max(exact[1, pixel] + hit * exact[4, pixel] - j, 0.0), 1.0)


@helper
def walk_exactly(
    pixel, exact, corner, grid, height, cells, corners, masks, nodes, meta, columns, rows, front,
    number, best, index, patches, places,
):  # fmt: skip
    # walk one pixel's ray in float64
    hit, patch, i, j = walk_ray(
        nodes, meta, height, cells, corners, masks, columns, rows, grid,
        exact[0, pixel], exact[1, pixel], exact[2, pixel], exact[3, pixel], exact[4, pixel], exact[5, pixel],
        exact[6, pixel], front,
    )  # fmt: skip
    if hit < np.inf:
        record_hit(corner, hit, patch, i, j, exact, pixel, number, best, index, patches, places)


@fused
def meet_waiting(
    f, n, exact, corner, grid, height, cells, corners, masks, nodes, meta, columns, rows, front,
    number, best, index, patches, places,
):  # fmt: skip
    # the lanes that wait before a cell meet its surface or step over it; a hit so near the cell's border that float32
    # cannot tell on which side it lies is left to the exact walk
    top, last_u, last_v = np.float32(len(meta) - 1), np.float32(columns - 1), np.float32(rows - 1)
    doubt = STILL + 3e-7 * max(columns, rows)
    for k in range(n):
        if f[LE + k] != WAITING:
            continue
        pixel, i, j = int(f[ID + k]), int(f[CI + k]), int(f[CJ + k])
        hit, patch = meet_cell(
            height, cells, corners, masks, i, j, columns,
            exact[0, pixel], exact[1, pixel], exact[2, pixel], exact[3, pixel], exact[4, pixel], exact[5, pixel],
            exact[6, pixel], front, doubt,
        )  # fmt: skip
        if not hit < np.inf:
            lanes.pass_cell(f, k, top, last_u, last_v)
            continue
        f[LE + k] = DONE
        p, q = exact[0, pixel] + hit * exact[3, pixel] - i, exact[1, pixel] + hit * exact[4, pixel] - j
        if min(p, q) < -OVERLAP or max(p, q) > 1.0 + OVERLAP:
            walk_exactly(
                pixel, exact, corner, grid, height, cells, corners, masks, nodes, meta, columns, rows, front,
                number, best, index, patches, places,
            )  # fmt: skip
        else:
            record_hit(corner, hit, patch, i, j, exact, pixel, number, best, index, patches, places)


@helper
def search_tile(
    f,
    exact,
    corner,
    start,
    turn,
    box,
    grid,
    front,
    slopes,
    nodes,
    meta,
    height,
    cells,
    corners,
    masks,
    best,
    index,
    number,
    patches,
    places,
):
    columns, rows, top = int(box[0]), int(box[1]), len(meta) - 1
    t, level = 0.0, top
    parallel = start[3] == 1.0 and turn[3, 0] == 0.0 and turn[3, 1] == 0.0 and turn[3, 2] == 0.0
    if parallel:
        t, level = walk_beam(corner, SIDE, start, turn, box, grid, nodes, meta, farthest(corner, best))
        if t == np.inf:
            return
    if parallel:
        clip_tile(corner[0], corner[1], SIDE, start, turn, box, exact)
    n = 0
    for pixel in range(SIDE * SIDE):
        x, y = corner[0] + (pixel & (SIDE - 1)), corner[1] + pixel // SIDE
        if x < corner[2] and y < corner[3]:
            far = float(best[y, x])
            alive = shorten(exact, pixel, far) if parallel else clip_pixel(x, y, pixel, start, turn, box, far, exact)
            if alive and t <= exact[7, pixel] and (not front or may_rise(exact, pixel, slopes)):
                set_lane(f, n, pixel, exact, columns, rows, grid, level, t)
                n += 1
    lanes.close_group(f, n)
    highest, patience = np.float32(top), 64 + 8 * (columns + rows)
    last_u, last_v = np.float32(columns - 1), np.float32(rows - 1)
    while n > 0 and patience > 0:
        lanes.find_exits(f, n)
        lanes.fetch_bounds(f, n, nodes, meta)
        lanes.choose_moves(f, n, highest, last_u, last_v)
        if lanes.count_level(f, n, WAITING) > 0:
            meet_waiting(
                f, n, exact, corner, grid, height, cells, corners, masks, nodes, meta, columns, rows, front,
                number, best, index, patches, places,
            )  # fmt: skip
        if 2 * lanes.count_level(f, n, DONE) >= n:
            n = lanes.drop_done(f, n)
        patience -= 1
    for k in range(lanes.drop_done(f, n)):
        walk_exactly(
            int(f[ID + k]), exact, corner, grid, height, cells, corners, masks, nodes, meta, columns, rows, front,
            number, best, index, patches, places,
        )  # fmt: skip


@kernel
def search_tiles(
    start,
    turn,
    box,
    grid,
    front,
    slopes,
    nodes,
    meta,
    height,
    cells,
    corners,
    masks,
    window,
    best,
    index,
    number,
    patches,
    places,
):
    # start (4,), turn (4, 3): see rays; slopes (4,): least and greatest change of depth per cell along u, along v;
    # window (x0, x1, y0, y1) pixels; best (H, W) f32 camera depth so far, lowered in place; where it was, index (H, W)
    # i16 becomes `number`, patches (H, W) i32 and places (H, W, 2) f32 say where (not kept when `index` is empty)
    tile_rows = (window[3] - window[2] + SIDE - 1) // SIDE
    for tile_row in prange(tile_rows):
        f = np.zeros(FLOATS, np.float32)
        exact = np.empty((10, SIDE * SIDE), np.float64)
        corner = np.empty(4, np.int64)
        corner[1] = window[2] + np.int64(tile_row) * SIDE
        corner[2], corner[3] = window[1], window[3]
        for x in range(window[0], window[1], SIDE):
            corner[0] = x
            search_tile(
                f, exact, corner, start, turn, box, grid, front, slopes, nodes, meta, height, cells, corners, masks,
                best, index, number, patches, places,
            )  # fmt: skip
