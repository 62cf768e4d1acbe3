"""Where the rays of a tile of pixels start: in the box, or as far on as their epipolar lines were swept.

Symbols and packed arguments: :mod:`ibrpipe.core.epipolar.cast`.
"""

from __future__ import annotations

import numpy as np

from ibrpipe.core.epipolar import cells as ec
from ibrpipe.core.epipolar import lines as el
from ibrpipe.core.jit import fused

#: how far beyond an edge a ray is taken to be in the next cell, in cells
NUDGE = 1e-9
#: rows of the working memory, LANES numbers each: 1 / Q, where a ray starts and ends, where its table begins and its
#: camera depth per column
INV0, INV1, NEAR, FAR, ALONG, PACE = (ec.LANES * n for n in range(6))
RAYS = ec.LANES * 6
#: bounds of float32 directions, and by how much the end of a ray is moved out
STEEP, INVERSE, BEYOND, LEAST = 1e20, 1e30, 1.000001, 1e-19


@fused
def set_out(x0, y0, P0, P1, P2, Q_of, box, eye, rays):
    # where the rays of the pixels of a tile pass the box
    q00, q01, q02, q10, q11, q12 = Q_of[0, 0], Q_of[0, 1], Q_of[0, 2], Q_of[1, 0], Q_of[1, 1], Q_of[1, 2]
    q20, q21, q22, columns, rows, low, high = Q_of[2, 0], Q_of[2, 1], Q_of[2, 2], box[0], box[1], box[2], box[3]
    for row in range(ec.TILE_Y):
        py, first = y0 + row + 0.5, row * ec.TILE_X
        a0, a1, a2 = q01 * py + q02, q11 * py + q12, q21 * py + q22
        for k in range(ec.TILE_X):
            px = x0 + k + 0.5
            r0, r1, r2 = q00 * px + a0, q10 * px + a1, q20 * px + a2
            r0 = r0 if abs(r0) > 1e-290 else 1e-290
            r1 = r1 if abs(r1) > 1e-290 else 1e-290
            r2 = r2 if abs(r2) > 1e-290 else 1e-290
            i0, i1, i2 = 1.0 / r0, 1.0 / r1, 1.0 / r2
            n0, f0, n1, f1 = -P0 * i0, (columns - P0) * i0, -P1 * i1, (rows - P1) * i1
            n2, f2 = (low - P2) * i2, (high - P2) * i2
            m0, g0 = (n0, f0) if n0 < f0 else (f0, n0)
            m1, g1 = (n1, f1) if n1 < f1 else (f1, n1)
            m2, g2 = (n2, f2) if n2 < f2 else (f2, n2)
            near = m0 if m0 > m1 else m1
            near = near if near > m2 else m2
            near = near if near > eye else eye
            far = g0 if g0 < g1 else g1
            far = far if far < g2 else g2
            n = first + k
            rays[INV0 + n], rays[INV1 + n], rays[NEAR + n], rays[FAR + n] = i0, i1, near, far


@fused
def find_entries(number, sectors, along, x0, y0, rays, entries):
    # entries: entry of the table of the rays of one sector; along: position of the eye along the sector's rays
    l0, l1, l2, lines = sectors[number, 0], sectors[number, 1], sectors[number, 2], sectors[number, el.LINES]
    b0, b1, b2, bins = sectors[number, 6], sectors[number, 7], sectors[number, 8], sectors[number, el.BINS]
    first, line_step, bin_step = sectors[number, el.FIRST], sectors[number, el.LINE_STEP], sectors[number, el.BIN_STEP]
    inverse, other = (INV0, INV1) if number < 2 else (INV1, INV0)
    sign = -1.0 if number & 1 else 1.0
    for row in range(ec.TILE_Y):
        py, start = y0 + row + 0.5, row * ec.TILE_X
        line_y, bin_y = l1 * py + l2, b1 * py + b2
        for k in range(ec.TILE_X):
            px, n = x0 + k + 0.5, start + k
            pace, across = rays[inverse + n], abs(rays[other + n])
            turned = pace * sign
            line = np.floor((l0 * px + line_y) * turned)
            bin_idx = np.floor(b0 * px + bin_y)
            known = (line >= 0.0) & (line < lines) & (bin_idx >= 0.0) & (bin_idx < bins)
            known &= (turned > 0.0) & ((turned <= across) if number < 2 else (turned < across))
            entry = first + line * line_step + bin_idx * bin_step
            entries[n] = np.int32(entry if known else np.float64(entries[n]))
            rays[ALONG + n] = along if known else rays[ALONG + n]
            rays[PACE + n] = turned if known else rays[PACE + n]


@fused
def clear_entries(rays, entries):
    # rays of no sector start where they enter the box
    for n in range(ec.LANES):
        entries[n], rays[ALONG + n], rays[PACE + n] = 0, 0.0, 1.0


@fused
def look_up(table, rays, entries):
    # let rays start where the table says
    for n in range(ec.LANES):
        t = (table[np.uint32(entries[n])] - rays[ALONG + n]) * rays[PACE + n]
        rays[NEAR + n] = t if t > rays[NEAR + n] else rays[NEAR + n]


@fused
def enter_cells(x0, y0, P0, P1, P2, Q_of, columns, rows, steepest, rays, work):
    # lay every ray from its start on in float32, in cells -> how many have some length before them
    q00, q01, q02, q10, q11, q12 = Q_of[0, 0], Q_of[0, 1], Q_of[0, 2], Q_of[1, 0], Q_of[1, 1], Q_of[1, 2]
    q20, q21, q22 = Q_of[2, 0], Q_of[2, 1], Q_of[2, 2]
    going = 0
    for row in range(ec.TILE_Y):
        py, start = y0 + row + 0.5, row * ec.TILE_X
        a0, a1, a2 = q01 * py + q02, q11 * py + q12, q21 * py + q22
        for k in range(ec.TILE_X):
            px, n = x0 + k + 0.5, start + k
            q0, q1, q2, i0, i1 = q00 * px + a0, q10 * px + a1, q20 * px + a2, rays[INV0 + n], rays[INV1 + n]
            t, far = rays[NEAR + n], rays[FAR + n]
            u, v = P0 + t * q0, P1 + t * q1
            i = np.floor(u + (NUDGE if i0 > 0.0 else -NUDGE))
            j = np.floor(v + (NUDGE if i1 > 0.0 else -NUDGE))
            i = i if i > 0.0 else 0.0
            j = j if j > 0.0 else 0.0
            i = i if i < columns - 1.0 else columns - 1.0
            j = j if j < rows - 1.0 else rows - 1.0
            across, down = abs(q0), abs(q1)
            speed = across if across > down else down
            speed = speed if speed > 1e-290 else 1e-290
            wide0, wide1 = abs(i0), abs(i1)
            scale = wide0 if wide0 < wide1 else wide1
            dd, au, av = q2 * scale, i0 * speed, i1 * speed
            dd = dd if dd < steepest else steepest
            dd = dd if dd > -steepest else -steepest
            au = au if au < INVERSE else INVERSE
            au = au if au > -INVERSE else -INVERSE
            av = av if av < INVERSE else INVERSE
            av = av if av > -INVERSE else -INVERSE
            work[ec.DU + n], work[ec.DV + n], work[ec.DD + n] = q0 * scale, q1 * scale, dd
            work[ec.AU + n], work[ec.AV + n] = au, av
            work[ec.U0 + n], work[ec.V0 + n], work[ec.D0 + n] = u - i, v - j, P2 + t * q2
            work[ec.END + n], work[ec.S + n] = (far - t) * speed * BEYOND + LEAST, 0.0
            work[ec.CI + n], work[ec.CJ + n], work[ec.BI + n], work[ec.BJ + n] = i, j, i, j
            work[ec.STATE + n] = ec.GOES_ON if t <= far else ec.ENDS
            going += 1 if t <= far else 0
    return going
