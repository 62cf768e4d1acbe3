"""Surfaces within one texel: rays through several places of it, put together by the surface that they meet.

Places of a texel are numbered row by row; the middle one leads, then those next to it.
"""

from __future__ import annotations

import numpy as np
from numba import prange

from ibrpipe.core.jit import helper, kernel

#: places along an edge of a texel
ALONG = 3
#: places in the order in which they lead
LEAD = np.array([4, 1, 3, 5, 7, 0, 2, 6, 8], np.int64)
BLOCK = 64


@helper
def off_plane(points, normals, i, j):
    # least distance of either point from the other's tangent plane
    x, y, z = points[j, 0] - points[i, 0], points[j, 1] - points[i, 1], points[j, 2] - points[i, 2]
    one = abs(x * normals[i, 0] + y * normals[i, 1] + z * normals[i, 2])
    two = abs(x * normals[j, 0] + y * normals[j, 1] + z * normals[j, 2])
    return min(one, two)


@helper
def gather(first, last, lead, place, points, normals, gap, group, out):
    # of every other place the free hit nearest to the leader's tangent plane joins its group
    out[lead] = group
    for other in range(ALONG * ALONG):
        if other == place[lead]:
            continue
        best, least = -1, gap
        for j in range(first, last):
            if place[j] == other and out[j] < 0:
                off = off_plane(points, normals, lead, j)
                if off <= least:
                    best, least = j, off
        if best >= 0:
            out[best] = group


@kernel
def group_hits(starts, place, points, normals, gap, out):
    # starts (T + 1,) i64 hits of every texel; place (N,) i64; points, normals (N, 3) f64; gap: scene units
    # out (N,) i64, -1 on entry: leader of every hit's group, which is the group's own hit that leads
    for block in prange((len(starts) + BLOCK - 2) // BLOCK):
        for texel in range(block * BLOCK, min(block * BLOCK + BLOCK, len(starts) - 1)):
            first, last = starts[texel], starts[texel + 1]
            for turn in range(ALONG * ALONG):
                for lead in range(first, last):
                    if place[lead] == LEAD[turn] and out[lead] < 0:
                        gather(first, last, lead, place, points, normals, gap, np.int64(lead), out)
