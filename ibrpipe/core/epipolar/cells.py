"""Walk of a tile's rays from cell to cell in float32, up to the cells in which they may be hit.

Cells are bilinear patches of the heights at their corners. Along a ray the height above a patch is a quadratic, of
which the walk needs its two ends and its bend. A ray stops at the first cell in which it comes as near to the surface
as `tolerance`, which is more than the rounding of float32 can amount to over PATIENCE cells and the blocks between
them; whether it is hit there is decided in float64 (:mod:`ibrpipe.core.epipolar.cast`). So no hit is passed over, and
loops have no branches.

Symbols: s distance along the ray since its start, in cells; (u, v, d) = (U0, V0, D0) + s (DU, DV, DD), u and v from the
start's cell (I0, J0) on; f0, f1 d - height at the ends of the ray's stretch in a cell; bend coefficient of the square
when that is counted from 0 to 1.
"""

from __future__ import annotations

import numpy as np

from ibrpipe.core.jit import fused

#: pixels of a tile along x and y, and together
TILE_X, TILE_Y = 32, 8
LANES = TILE_X * TILE_Y
#: cells that rays are taken through before those that are done are left behind, and cells before they go one by one
STRIDE, PATIENCE = 4, 48
#: rows of the working memory, LANES numbers each: ray, its position, the cell it is in and the one it started in
DU, DV, DD, AU, AV, U0, V0, D0, END, S, CI, CJ, BI, BJ, STATE = (LANES * n for n in range(15))
#: corners of its cell, which lane of the tile it is
A, B, C, E, LANE = (LANES * n for n in range(15, 20))
WORK = LANES * 20
#: states of a ray
GOES_ON, STOPS, ENDS = 0.0, 1.0, 2.0
#: rays are walked in whole vectors of this many; the last one is filled up with rays whose walk has ended
VECTOR = 16
#: share of late rays that go on, below which they move up
CROWDED = 0.75


@fused
def gather_heights(count, flat, stride, work, indices):
    # flat: heights; the four at the corners of every ray's cell; indices (LANES,) i32 working memory
    for n in range(count):
        indices[n] = np.int32(work[CJ + n]) * np.int32(stride) + np.int32(work[CI + n])
    for n in range(count):
        cell = np.uint32(indices[n])
        work[A + n], work[B + n] = flat[cell], flat[cell + np.uint32(1)]
        cell += np.uint32(stride)
        work[C + n], work[E + n] = flat[cell], flat[cell + np.uint32(1)]


@fused
def cross_cells(count, columns, rows, tolerance, work):
    # see whether rays may be hit in their cells; those that cannot enter the next ones
    zero, one, two, four = np.float32(0.0), np.float32(1.0), np.float32(2.0), np.float32(4.0)
    for n in range(count):
        du, dv, dd, au, av = work[DU + n], work[DV + n], work[DD + n], work[AU + n], work[AV + n]
        i, j, s0, u0, v0, d0 = work[CI + n], work[CJ + n], work[S + n], work[U0 + n], work[V0 + n], work[D0 + n]
        a, b, c, e = work[A + n], work[B + n], work[C + n], work[E + n]
        u0, v0 = u0 - (i - work[BI + n]), v0 - (j - work[BJ + n])
        su, sv = ((one if au > zero else zero) - u0) * au, ((one if av > zero else zero) - v0) * av
        s1 = su if su < sv else sv
        end = work[END + n]
        s1 = s1 if s1 < end else end
        across, down, twist = b - a, c - a, (a - b) - (c - e)
        p, q = u0 + s0 * du, v0 + s0 * dv
        f0 = d0 + s0 * dd - (a + p * across + q * (down + p * twist))
        p, q = u0 + s1 * du, v0 + s1 * dv
        f1 = d0 + s1 * dd - (a + p * across + q * (down + p * twist))
        length = s1 - s0
        bend = -twist * (du * length) * (dv * length)
        slope = f1 - f0 - bend
        least, greatest = f0 if f0 < f1 else f1, f1 if f0 < f1 else f0
        dips = (bend * f0 > zero) & (slope * f0 < zero) & (abs(slope) < two * abs(bend))
        dips &= slope * slope + four * tolerance * abs(bend) >= four * bend * f0
        stops = ((least <= tolerance) & (greatest >= -tolerance)) | dips
        next_i, next_j = i + (one if au > zero else -one), j + (one if av > zero else -one)
        next_i, next_j = next_i if su < sv else i, j if su < sv else next_j
        ends = (s1 >= end) | (next_i < zero) | (next_j < zero) | (next_i >= columns) | (next_j >= rows)
        state = np.float32(STOPS) if stops else (np.float32(ENDS) if ends else zero)
        going, before = work[STATE + n] == zero, work[STATE + n]
        work[STATE + n] = state if going else before
        going &= state == zero
        work[S + n] = s1 if going else s0
        work[CI + n] = next_i if going else i
        work[CJ + n] = next_j if going else j


@fused
def cross_blocks(count, nodes, first, stride, size, low, step, columns, rows, tolerance, work, indices):
    # rays that pass above or below the block that they are in go on to where they leave it
    # nodes: see quadtree, from `first` on, `stride` to a row; size (cells) of blocks; low, step: depths of their bounds
    zero, one = np.float32(0.0), np.float32(1.0)
    share = one / size
    for n in range(count):
        bi, bj = np.floor(work[CI + n] * share), np.floor(work[CJ + n] * share)
        indices[n] = np.int32(bj) * np.int32(stride) + np.int32(bi) + np.int32(first)
    for n in range(count):
        indices[n] = np.int32(nodes[np.uint32(indices[n])])
    for n in range(count):
        du, dv, dd, au, av = work[DU + n], work[DV + n], work[DD + n], work[AU + n], work[AV + n]
        i, j, s0, u0, v0, d0 = work[CI + n], work[CJ + n], work[S + n], work[U0 + n], work[V0 + n], work[D0 + n]
        i0, j0, node = work[BI + n], work[BJ + n], np.uint32(indices[n])
        least = low + np.float32(np.int32(node & np.uint32(65535))) * step
        greatest = low + np.float32(np.int32(node >> np.uint32(16))) * step
        left, upper = np.floor(i * share) * size, np.floor(j * share) * size
        edge_i, edge_j = left + (size if au > zero else zero), upper + (size if av > zero else zero)
        su, sv, end = (edge_i - i0 - u0) * au, (edge_j - j0 - v0) * av, work[END + n]
        s1 = su if su < sv else sv
        s1 = s1 if s1 < end else end
        da, db = d0 + s0 * dd, d0 + s1 * dd
        near, far = da if da < db else db, db if da < db else da
        passes = (near > greatest + tolerance) | (far < least - tolerance) | (least > greatest)
        passes &= work[STATE + n] == zero
        in_i, in_j = np.floor(u0 + s1 * du) + i0, np.floor(v0 + s1 * dv) + j0
        right, lower = left + size - one, upper + size - one
        right, lower = right if right < columns - one else columns - one, lower if lower < rows - one else rows - one
        in_i, in_j = in_i if in_i > left else left, in_j if in_j > upper else upper
        in_i, in_j = in_i if in_i < right else right, in_j if in_j < lower else lower
        next_i = (edge_i if au > zero else edge_i - one) if su < sv else in_i
        next_j = in_j if su < sv else (edge_j if av > zero else edge_j - one)
        ends = (s1 >= end) | (next_i < zero) | (next_j < zero) | (next_i >= columns) | (next_j >= rows)
        work[STATE + n] = np.float32(ENDS) if passes & ends else work[STATE + n]
        passes &= not ends
        work[S + n] = s1 if passes else s0
        work[CI + n] = next_i if passes else i
        work[CJ + n] = next_j if passes else j


@fused
def advance(count, flat, stride, columns, rows, tolerance, work, indices):
    # take rays through some cells -> how many go on
    for _ in range(STRIDE):
        gather_heights(count, flat, stride, work, indices)
        cross_cells(count, columns, rows, tolerance, work)
    return count_rays(count, np.float32(GOES_ON), work)


@fused
def count_rays(count, state, work):
    # -> how many rays are in a state
    found = np.float32(0.0)
    for n in range(count):
        found += np.float32(1.0) if work[STATE + n] == state else np.float32(0.0)
    return int(found)


@fused
def leave_behind(left, work, late):
    # copy the `left` rays of a tile that go on to the late ones -> how many they are
    kept = 0
    for n in range(LANES if left > 0 else 0):
        late[LANE + kept] = n
        kept += 1 if work[STATE + n] == GOES_ON else 0
    for k in range(kept):
        n = np.uint32(late[LANE + k])
        late[DU + k], late[DV + k], late[DD + k] = work[DU + n], work[DV + n], work[DD + n]
        late[AU + k], late[AV + k], late[END + k] = work[AU + n], work[AV + n], work[END + n]
        late[U0 + k], late[V0 + k], late[D0 + k] = work[U0 + n], work[V0 + n], work[D0 + n]
        late[CI + k], late[CJ + k], late[S + k] = work[CI + n], work[CJ + n], work[S + n]
        late[BI + k], late[BJ + k] = work[BI + n], work[BJ + n]
        late[STATE + k] = GOES_ON
    fill_vector(kept, late)
    return kept


@fused
def bring_back(count, late, work):
    # tell the tile where its late rays are; those that go on move up -> how many they are
    kept = 0
    for n in range(count):
        state, lane = late[STATE + n], np.uint32(late[LANE + n])
        work[STATE + lane], work[CI + lane], work[CJ + lane] = state, late[CI + n], late[CJ + n]
        work[A + lane], work[B + lane] = late[A + n], late[B + n]
        work[C + lane], work[E + lane] = late[C + n], late[E + n]
        late[DU + kept], late[DV + kept], late[DD + kept] = late[DU + n], late[DV + n], late[DD + n]
        late[AU + kept], late[AV + kept], late[END + kept] = late[AU + n], late[AV + n], late[END + n]
        late[U0 + kept], late[V0 + kept], late[D0 + kept] = late[U0 + n], late[V0 + n], late[D0 + n]
        late[CI + kept], late[CJ + kept], late[S + kept] = late[CI + n], late[CJ + n], late[S + n]
        late[BI + kept], late[BJ + kept], late[LANE + kept] = late[BI + n], late[BJ + n], late[LANE + n]
        late[STATE + kept] = state
        kept += 1 if state == GOES_ON else 0
    fill_vector(kept, late)
    return kept


@fused
def fill_vector(count, late):
    # rays that have ended, at a position in the field, after the first `count`
    for n in range(count, whole_vectors(count)):
        late[STATE + n], late[CI + n], late[CJ + n] = ENDS, 0.0, 0.0


@fused
def whole_vectors(count):
    return (count + VECTOR - 1) // VECTOR * VECTOR
