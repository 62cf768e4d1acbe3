"""Walk of a tile's rays from cell to cell in float32, up to the cells in which they may be hit.

Cells are bilinear patches of the heights at their corners. Along a ray the height above a patch is a quadratic, of
which the walk needs its two ends and its bend. A ray stops at the first cell in which it comes as near to the surface
as `doubt`, which is more than the rounding of float32 can amount to over PATIENCE cells; whether it is hit there is
decided in float64 (:mod:`ibrpipe.core.epipolar_cast`). So no hit is passed over, and loops have no branches.

Symbols: s way along the ray since its start, in cells; (u, v, d) = (U0, V0, D0) + s (DU, DV, DD), u and v from the
start's cell (I0, J0) on; f0, f1 d - height at the ends of a cell's way; bend coefficient of the square when the way
is counted from 0 to 1.
"""

from __future__ import annotations

import numpy as np

from ibrpipe.core.jit import fused

#: pixels of a tile along x and y, and together
TILE_X, TILE_Y = 32, 8
LANES = TILE_X * TILE_Y
#: cells that rays are taken through before those that are done are left behind, and cells before they go one by one
STRIDE, PATIENCE = 3, 24
#: rows of the working memory, LANES numbers each: ray, its place, the cell it is in and the one it started in
DU, DV, DD, AU, AV, U0, V0, D0, END, S, I, J, I0, J0, STATE = (LANES * n for n in range(15))
#: corners of its cell, which lane of the tile it is
A, B, C, E, LANE = (LANES * n for n in range(15, 20))
WORK = LANES * 20
#: states of a ray
GOES_ON, STOPS, ENDS = 0.0, 1.0, 2.0


@fused
def gather_heights(count, flat, stride, work):
    # flat: heights; the four at the corners of every ray's cell
    for n in range(count):
        cell = np.uint32(np.int32(work[J + n]) * np.int32(stride) + np.int32(work[I + n]))
        work[A + n], work[B + n] = flat[cell], flat[cell + np.uint32(1)]
    for n in range(count):
        cell = np.uint32((np.int32(work[J + n]) + np.int32(1)) * np.int32(stride) + np.int32(work[I + n]))
        work[C + n], work[E + n] = flat[cell], flat[cell + np.uint32(1)]


@fused
def cross_cells(count, columns, rows, doubt, work):
    # see whether rays may be hit in their cells; those that cannot enter the next ones
    zero, one, two, four = np.float32(0.0), np.float32(1.0), np.float32(2.0), np.float32(4.0)
    for n in range(count):
        du, dv, dd, au, av = work[DU + n], work[DV + n], work[DD + n], work[AU + n], work[AV + n]
        i, j, s0, u0, v0, d0 = work[I + n], work[J + n], work[S + n], work[U0 + n], work[V0 + n], work[D0 + n]
        a, b, c, e = work[A + n], work[B + n], work[C + n], work[E + n]
        u0, v0 = u0 - (i - work[I0 + n]), v0 - (j - work[J0 + n])
        su, sv = ((one if au > zero else zero) - u0) * au, ((one if av > zero else zero) - v0) * av
        s1 = su if su < sv else sv
        end = work[END + n]
        s1 = s1 if s1 < end else end
        across, down, twist = b - a, c - a, (a - b) - (c - e)
        p, q = u0 + s0 * du, v0 + s0 * dv
        f0 = d0 + s0 * dd - (a + p * across + q * (down + p * twist))
        p, q = u0 + s1 * du, v0 + s1 * dv
        f1 = d0 + s1 * dd - (a + p * across + q * (down + p * twist))
        way = s1 - s0
        bend = -twist * (du * way) * (dv * way)
        slope = f1 - f0 - bend
        least, greatest = f0 if f0 < f1 else f1, f1 if f0 < f1 else f0
        dips = (bend * f0 > zero) & (slope * f0 < zero) & (abs(slope) < two * abs(bend))
        dips &= slope * slope + four * doubt * abs(bend) >= four * bend * f0
        stops = ((least <= doubt) & (greatest >= -doubt)) | dips
        next_i, next_j = i + (one if au > zero else -one), j + (one if av > zero else -one)
        next_i, next_j = next_i if su < sv else i, j if su < sv else next_j
        ends = (s1 >= end) | (next_i < zero) | (next_j < zero) | (next_i >= columns) | (next_j >= rows)
        state = np.float32(STOPS) if stops else (np.float32(ENDS) if ends else zero)
        going, before = work[STATE + n] == zero, work[STATE + n]
        work[STATE + n] = state if going else before
        going &= state == zero
        work[S + n] = s1 if going else s0
        work[I + n] = next_i if going else i
        work[J + n] = next_j if going else j


@fused
def advance(count, flat, stride, columns, rows, doubt, work):
    # take rays through some cells
    for _ in range(STRIDE):
        gather_heights(count, flat, stride, work)
        cross_cells(count, columns, rows, doubt, work)


@fused
def leave_behind(count, work, late):
    # copy the rays of a tile that go on to the late ones -> how many they are
    kept = 0
    for n in range(count):
        late[LANE + kept] = n
        kept += 1 if work[STATE + n] == GOES_ON else 0
    for k in range(kept):
        n = np.uint32(late[LANE + k])
        late[DU + k], late[DV + k], late[DD + k] = work[DU + n], work[DV + n], work[DD + n]
        late[AU + k], late[AV + k], late[END + k] = work[AU + n], work[AV + n], work[END + n]
        late[U0 + k], late[V0 + k], late[D0 + k] = work[U0 + n], work[V0 + n], work[D0 + n]
        late[I + k], late[J + k], late[S + k] = work[I + n], work[J + n], work[S + n]
        late[I0 + k], late[J0 + k] = work[I0 + n], work[J0 + n]
        late[STATE + k] = GOES_ON
    return kept


@fused
def bring_back(count, late, work):
    # tell the tile where its late rays are; those that go on move up -> how many they are
    kept = 0
    for n in range(count):
        state, lane = late[STATE + n], np.uint32(late[LANE + n])
        work[STATE + lane], work[I + lane], work[J + lane] = state, late[I + n], late[J + n]
        late[DU + kept], late[DV + kept], late[DD + kept] = late[DU + n], late[DV + n], late[DD + n]
        late[AU + kept], late[AV + kept], late[END + kept] = late[AU + n], late[AV + n], late[END + n]
        late[U0 + kept], late[V0 + kept], late[D0 + kept] = late[U0 + n], late[V0 + n], late[D0 + n]
        late[I + kept], late[J + kept], late[S + kept] = late[I + n], late[J + n], late[S + n]
        late[I0 + kept], late[J0 + kept], late[LANE + kept] = late[I0 + n], late[J0 + n], late[LANE + n]
        late[STATE + kept] = state
        kept += 1 if state == GOES_ON else 0
    return kept
