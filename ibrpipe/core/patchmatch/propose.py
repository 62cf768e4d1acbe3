"""Planes that a pixel tries: those of eight regions of the checkerboard around it, and changes of the best.

Source: xu2019, sec. 3.2, fig. 3.
Departures: changes are measured in pixels of motion in the neighbours, and one of them is small.
"""

from __future__ import annotations

import numpy as np

from ibrpipe.core.jit import fused_exact
from ibrpipe.core.patchmatch.planes import facing, random_normal, tilted, towards, uniform

#: planes tried at once at most: the pixel's own and eight regions'
PLANES = 9
#: changes tried
CHANGES = 6
#: plane q, a, b and cost of a pixel: the rows of the state (4, H, W)
COST = 3


@fused_exact
def best_of_region(state, valid, i, j, step_i, step_j, far):
    # the cheapest pixel of the near V or of the far strip along (step_i, step_j): flat index, -1 = none
    rows, columns = valid.shape
    best, found = np.float32(np.inf), -1
    for k in range(11 if far else 7):
        if far:
            along, across = 3 + 2 * k, 0
        else:
            along = (k + 1) // 2 + 1
            across = ((k + 1) // 2) * (1 if k % 2 else -1)
        y = i + step_i * along + (across if step_i == 0 else 0)
        x = j + step_j * along + (across if step_j == 0 else 0)
        if 0 <= y < rows and 0 <= x < columns and valid[y, x] and state[COST, y, x] < best:
            best, found = state[COST, y, x], y * columns + x
    return found


@fused_exact
def propose(state, valid, i, j, candidates):
    # candidates (PLANES, 3) filled: the pixel's own plane, then those of the regions; returns how many
    columns = valid.shape[1]
    for c in range(3):
        candidates[0, c] = state[c, i, j]
    count = 1
    for direction in range(8):
        step_i = (direction % 4 == 0) - (direction % 4 == 1)
        step_j = (direction % 4 == 2) - (direction % 4 == 3)
        found = best_of_region(state, valid, i, j, step_i, step_j, direction >= 4)
        if found >= 0:
            y, x = found // columns, found % columns
            a, b = state[1, y, x], state[2, y, x]
            candidates[count, 0] = state[0, y, x] + a * np.float32(j - x) + b * np.float32(i - y)
            candidates[count, 1], candidates[count, 2] = a, b
            count += 1
    return count


@fused_exact
def change(best, ranges, reach, lens, i, j, seed, pixel, sweep_number, candidates):
    # candidates filled with changes of the plane `best`; ranges: low, high, inverse depth that moves it by a pixel;
    # reach: pixels; returns how many
    x, y, low, high = j + 0.5, i + 0.5, ranges[0], ranges[1]
    q = float(best[0])
    nx, ny, nz = facing(q, float(best[1]), float(best[2]), x, y, lens)
    for k in range(CHANGES):
        salt = 8 * (k + 1)
        new_q, mx, my, mz = q, nx, ny, nz
        if k == 0 or k == 2:
            new_q = q + (2.0 * uniform(seed, pixel, sweep_number, salt) - 1.0) * reach * ranges[2]
        elif k == 1:
            new_q = q + (2.0 * uniform(seed, pixel, sweep_number, salt) - 1.0) * 0.15 * reach * ranges[2]
        elif k == 4:
            new_q = low + (high - low) * uniform(seed, pixel, sweep_number, salt)
        if k == 2 or k == 3:
            spread = min(0.3 * reach, 0.6)
            mx += spread * (2.0 * uniform(seed, pixel, sweep_number, salt + 1) - 1.0)
            my += spread * (2.0 * uniform(seed, pixel, sweep_number, salt + 2) - 1.0)
            mz += spread * (2.0 * uniform(seed, pixel, sweep_number, salt + 3) - 1.0)
        elif k >= 4:
            mx, my, mz = random_normal(seed, pixel, sweep_number, salt + 4, x, y, lens)
        new_q = min(max(new_q, low), high)
        mx, my, mz = towards(mx, my, mz, x, y, lens)
        a, b = tilted(new_q, mx, my, mz, x, y, lens)
        candidates[k, 0], candidates[k, 1], candidates[k, 2] = new_q, a, b
    return CHANGES
