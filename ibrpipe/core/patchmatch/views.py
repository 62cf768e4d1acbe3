"""Which neighbours a pixel trusts, and how far their own depth disagrees with its.

Source: xu2019, sec. 3.3 and 4.1 (joint view selection, geometric consistency). Departure: the best `keep` views are
taken, by their weights, instead of all that pass a count.

Symbols: m_ij cost of plane i in view j. A neighbour is a row of 32 numbers: 0-8 M and 9-11 m (pixel of a reference
pixel p with inverse depth q: M p + m q), 12 width, 13 height, 14 row length, 16-24 and 25-27 M and m from there back.
"""

from __future__ import annotations

import math

import numpy as np

from ibrpipe.core.jit import fused_exact
from ibrpipe.core.patchmatch.cost import ONE, TINY, UNSEEN, ZERO

#: numbers that describe a neighbour
ROW = 32


@fused_exact
def choose_views(costs, count, limit, keep, weights):
    # costs (planes, V) -> weights (V,), sum 1: views that agree with many planes; at most `keep` are not 0
    views = costs.shape[1]
    for j in range(views):
        score, least = ZERO, UNSEEN
        for i in range(count):
            m = costs[i, j]
            least = min(least, m)
            if m < limit:
                score += np.float32(math.exp(-m * m / np.float32(0.18)))
        weights[j] = score + np.float32(1e-4) * (np.float32(2.001) - least)
    total = ZERO
    for j in range(views):
        better = 0
        for k in range(views):
            mine, other = abs(weights[j]), abs(weights[k])
            better += other > mine or (other == mine and k < j)
        if better >= keep:
            weights[j] = -weights[j]
        else:
            total += weights[j]
    for j in range(views):
        weights[j] = weights[j] / total if weights[j] > ZERO else ZERO


@fused_exact
def disagreement(views, others, n, x, y, q, most):
    # pixels between (x, y) and where it comes back to through the neighbour's own depth; `most` where unknown
    w = views[n, 6] * x + views[n, 7] * y + views[n, 8] + views[n, 11] * q
    if not w > TINY:
        return most
    u = (views[n, 0] * x + views[n, 1] * y + views[n, 2] + views[n, 9] * q) / w
    v = (views[n, 3] * x + views[n, 4] * y + views[n, 5] + views[n, 10] * q) / w
    if not (u >= ZERO and v >= ZERO and u < views[n, 12] and v < views[n, 13]):
        return most
    back = others[n, np.int64(v) * np.int64(views[n, 14]) + np.int64(u)]
    if not back > ZERO:
        return most
    r = views[n, 22] * u + views[n, 23] * v + views[n, 24] + views[n, 27] * back
    if not r > TINY:
        return most
    s = (views[n, 16] * u + views[n, 17] * v + views[n, 18] + views[n, 25] * back) * (ONE / r) - x
    t = (views[n, 19] * u + views[n, 20] * v + views[n, 21] + views[n, 26] * back) * (ONE / r) - y
    return min(np.float32(math.sqrt(s * s + t * t)), most)
