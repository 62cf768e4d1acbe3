"""PatchMatch multi-view stereo: one half of a checkerboard sweep over a view.

Every pixel holds a plane (`patchmatch_planes`). A sweep visits the pixels of one colour, which read only pixels of the
other, so that threads never see each other's work: a pixel tries the planes of eight regions around it
(`patchmatch_propose`), chooses the neighbours that agree with most of them (`patchmatch_views`), keeps the plane that
is best over those (`patchmatch_cost`), and tries some changes of it.

Source: xu2019, sec. 3 and 4.
Departures: planes are inverse depth and its gradient; see the modules named above.
"""

from __future__ import annotations

import math

import numpy as np
from numba import prange

from ibrpipe.core.jit import exact_kernel, fused_exact
from ibrpipe.core.patchmatch.cost import HALF, UNSEEN, WORK, ZERO, lay_window, plane_cost, weigh
from ibrpipe.core.patchmatch.propose import COST, PLANES, change, propose
from ibrpipe.core.patchmatch.views import choose_views, disagreement


@fused_exact
def add_up(costs, weights, count, totals):
    # totals[k]: mean cost of plane k over the chosen views
    for k in range(count):
        total = ZERO
        for n in range(weights.shape[0]):
            total += weights[n] * costs[k, n] if weights[n] > ZERO else ZERO
        totals[k] = total


@exact_kernel
def sweep(step, softness, consistency, ranges, lens, window, reference, valid, neighbours, state):
    # step: colour 0 or 1, number of the sweep, seed, reach in pixels, views kept; softness: 1 / (32 sigma^2) of grey
    # levels
    # consistency (2,) f32: weight of a pixel of disagreement (0 = photometric), most pixels
    # ranges (3,): low, high, inverse depth that moves a pixel by one; lens (4,); window (3, LANES) f32: see weigh
    # reference (H + 2 R, W + 2 R) f32 grey 0..255, below 0 = not valid; valid (H, W) u8
    # neighbours: views (V, 32) f32; pictures (V, N) u32: four grey bytes; others (V, N) f32: their inverse depth, 0 =
    # unknown
    # state (4, H, W) f32: planes and their cost, updated in place
    (colour, sweep_number, seed, reach, keep), (views, pictures, others) = step, neighbours
    rows, columns = valid.shape
    margin = (reference.shape[0] - rows) // 2
    limit = np.float32(0.8 * math.exp(-sweep_number * sweep_number / 90.0))
    for i in prange(rows):
        work = np.empty(WORK, np.float32)
        lay_window(window, work)
        candidates, costs = np.empty((PLANES, 3), np.float32), np.empty((PLANES, views.shape[0]), np.float32)
        totals, weights = np.empty(PLANES, np.float32), np.empty(views.shape[0], np.float32)
        best = np.empty(3, np.float32)
        for j in range((i + colour) & 1, columns, 2):
            if valid[i, j] == 0:
                continue
            variance = weigh(reference, i + margin, j + margin, softness, work)
            x, y = np.float32(j) + HALF, np.float32(i) + HALF
            for phase in range(2):
                if phase == 0:
                    count = propose(state, valid, i, j, candidates)
                else:
                    count = change(best, ranges, reach, lens, i, j, seed, i * columns + j, sweep_number, candidates)
                for n in range(views.shape[0]):
                    if phase == 1 and weights[n] == ZERO:
                        continue
                    p0 = views[n, 0] * x + views[n, 1] * y + views[n, 2]
                    p1 = views[n, 3] * x + views[n, 4] * y + views[n, 5]
                    p2 = views[n, 6] * x + views[n, 7] * y + views[n, 8]
                    for k in range(count):
                        q, a, b = candidates[k, 0], candidates[k, 1], candidates[k, 2]
                        cost = plane_cost(views, pictures, n, p0, p1, p2, q, a, b, variance, work)
                        if consistency[0] > ZERO and cost < UNSEEN:
                            cost += consistency[0] * disagreement(views, others, n, x, y, q, consistency[1])
                        costs[k, n] = cost
                if phase == 0:
                    choose_views(costs, count, limit, keep, weights)
                add_up(costs, weights, count, totals)
                least, chosen = np.float32(np.inf) if phase == 0 else state[COST, i, j], -1
                for k in range(count):
                    if totals[k] < least:
                        least, chosen = totals[k], k
                if chosen >= 0:
                    for c in range(3):
                        best[c] = candidates[chosen, c]
                        state[c, i, j] = best[c]
                    state[COST, i, j] = least
