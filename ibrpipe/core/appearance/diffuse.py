"""Diffuse colour of a surface point from all photos that see it. Source: gong-yang, sec. 4.1.

Each channel's observations, in display code (so that bins are about equally visible), go into a histogram; the median
is found by counting bins and then taken from the values inside the bin of the middle rank, so one or two observations
give their own value and their mean, and bins cost little precision.
"""

import numpy as np
from numba import prange

from ibrpipe.core.appearance.photo_blend import BLOCK, CLEAN, USABLE, fetch, see
from ibrpipe.core.jit import helper, kernel

MEDIAN, MEAN, MODE = 0, 1, 2


@helper
def fill(values, count, top, bins):
    """Count values (count,) f64 into bins (B,) i32 over [0, top]."""
    bins[:] = 0
    for i in range(count):
        bins[bin_of(values[i], top, len(bins))] += 1


@helper
def bin_of(value, top, size):
    """Return the bin of a value; values above `top` go into the last bin."""
    return min(max(int(value / top * size), 0), size - 1)


@helper
def mean_of_bin(values, count, which, top, size):
    """Mean of the values that fall into bin `which`."""
    total, members = 0.0, 0
    for i in range(count):
        if bin_of(values[i], top, size) == which:
            total += values[i]
            members += 1
    return total / members


@helper
def bin_of_rank(bins, rank):
    """Return the bin that holds the value of the given rank, counted from 0."""
    below = 0
    for which in range(len(bins)):
        below += bins[which]
        if below > rank:
            return which
    return len(bins) - 1


@helper
def reduce_channel(values, count, top, bins, statistic):
    """Return median, mean or mode of values (count,) f64 of one channel; count >= 1."""
    if statistic == MEAN:
        total = 0.0
        for i in range(count):
            total += values[i]
        return total / count
    fill(values, count, top, bins)
    if statistic == MODE:
        return mean_of_bin(values, count, int(np.argmax(bins)), top, len(bins))
    low, high = bin_of_rank(bins, (count - 1) // 2), bin_of_rank(bins, count // 2)
    low_value = mean_of_bin(values, count, low, top, len(bins))
    if high == low:
        return low_value
    return 0.5 * (low_value + mean_of_bin(values, count, high, top, len(bins)))


@kernel
def diffuse_colors(
    points, normals, photos, cos_min, slack, top, bin_count, statistic, out_color, out_spread, out_count
):  # fmt: skip
    """Reduce the colours of all photos that see each point to one diffuse colour."""
    # points (N, 3) f64, normals (N, 3) f32; photos: see photo_blend
    # top f64: largest colour; bin_count i64; statistic MEDIAN, MEAN or MODE
    # out_color (N, 3) f32 display code, NaN where unseen; out_spread (N,) f32: mean over photos and channels of
    # |colour - diffuse|; out_count (N,) i32 photos used
    projection, centers, sizes, starts, color, depth, mask = photos
    for block in prange((len(points) + BLOCK - 1) // BLOCK):
        views = projection, centers, sizes, starts, depth, mask
        seen = np.empty((2, 3, len(centers)))
        bins, corners = np.empty(bin_count, np.int32), np.empty((1, 4, 2))
        for i in range(block * BLOCK, min((block + 1) * BLOCK, len(points))):
            clean, usable = 0, 0
            point, normal = (points[i, 0], points[i, 1], points[i, 2]), (normals[i, 0], normals[i, 1], normals[i, 2])
            for p in range(len(centers)):
                quality = see(point, normal, p, views, cos_min, slack, corners, 0)
                if quality == CLEAN:
                    red, green, blue = fetch(color, corners, 0)
                    seen[0, 0, clean], seen[0, 1, clean], seen[0, 2, clean] = red, green, blue
                    clean += 1
                elif quality == USABLE:
                    red, green, blue = fetch(color, corners, 0)
                    seen[1, 0, usable], seen[1, 1, usable], seen[1, 2, usable] = red, green, blue
                    usable += 1
            kind, count = (0, clean) if clean > 0 else (1, usable)
            out_count[i] = count
            out_spread[i] = 0.0
            if count == 0:
                out_color[i] = np.nan
                continue
            spread = 0.0
            for c in range(3):
                value = reduce_channel(seen[kind, c], count, top, bins, statistic)
                out_color[i, c] = value
                for j in range(count):
                    spread += abs(seen[kind, c, j] - value)
            out_spread[i] = spread / (3 * count)
