"""Diffuse colour of a surface point from all photos that see it. Source: gong-yang, sec. 4.1.

Each channel's observations, in display code (so that bins are about equally visible), go into a histogram; the median
is found by adding up bins and then taken from the values inside the bin of the middle, so that one or two observations
give their own value and their mean, and bins cost little precision.

Departure: a photo's say is how many of its pixels show a unit of the surface (`pixels_per_area`), not one each. Photos
from far away or along the surface blur it; equal votes let many of them outvote the few that show it sharply.
"""

import numpy as np
from numba import prange

from ibrpipe.core.appearance.photo_blend import BLOCK, CLEAN, HIDDEN, fetch, focal_length, see
from ibrpipe.core.jit import helper, kernel

MEDIAN, MEAN, MODE = 0, 1, 2
#: share of all votes that rounding may lack at the middle
ROUNDING = 1e-9


@helper
def pixels_per_area(point, normal, photo, projection, centers):
    """Return how many (square) pixels of a photo show a unit of area of the surface; `see` has found it in front."""
    (px, py, pz), (nx, ny, nz) = point, normal
    facing = nx * (centers[photo, 0] - px) + ny * (centers[photo, 1] - py) + nz * (centers[photo, 2] - pz)
    across, down, along = projection[photo, 2, 0], projection[photo, 2, 1], projection[photo, 2, 2]
    z = across * px + down * py + along * pz + projection[photo, 2, 3]
    focal = focal_length(projection, photo)
    return focal * focal * facing / (z * z * z)


@helper
def fill(values, votes, count, top, bins):
    """Add up votes (count,) f64 of values (count,) f64 in bins (B,) f64 over [0, top]."""
    bins[:] = 0.0
    for i in range(count):
        bins[bin_of(values[i], top, len(bins))] += votes[i]


@helper
def bin_of(value, top, size):
    """Return the bin of a value; values above `top` go into the last bin."""
    return min(max(int(value / top * size), 0), size - 1)


@helper
def mean_of_bin(values, votes, count, which, top, size):
    """Mean of the values that fall into bin `which`, by their votes."""
    total, members = 0.0, 0.0
    for i in range(count):
        if bin_of(values[i], top, size) == which:
            total += votes[i] * values[i]
            members += votes[i]
    return total / members


@helper
def bin_reaching(bins, share):
    """Return the first bin up to which there are as many votes as `share`."""
    below = 0.0
    for which in range(len(bins)):
        below += bins[which]
        if below >= share:
            return which
    return len(bins) - 1


@helper
def reduce_channel(values, votes, count, top, bins, statistic):
    """Return median, mean or mode of values (count,) f64 of one channel by votes (count,) f64 > 0; count >= 1."""
    total = 0.0
    for i in range(count):
        total += votes[i]
    if statistic == MEAN:
        mean = 0.0
        for i in range(count):
            mean += votes[i] * values[i]
        return mean / total
    fill(values, votes, count, top, bins)
    if statistic == MODE:
        return mean_of_bin(values, votes, count, int(np.argmax(bins)), top, len(bins))
    low = bin_reaching(bins, (0.5 - ROUNDING) * total)
    high = bin_reaching(bins, (0.5 + ROUNDING) * total)
    low_value = mean_of_bin(values, votes, count, low, top, len(bins))
    if high == low:
        return low_value
    return 0.5 * (low_value + mean_of_bin(values, votes, count, high, top, len(bins)))


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
        seen, votes = np.empty((2, 3, len(centers))), np.empty((2, len(centers)))
        bins, corners = np.empty(bin_count), np.empty((1, 4, 2))
        for i in range(block * BLOCK, min((block + 1) * BLOCK, len(points))):
            clean, usable = 0, 0
            point, normal = (points[i, 0], points[i, 1], points[i, 2]), (normals[i, 0], normals[i, 1], normals[i, 2])
            for p in range(len(centers)):
                quality = see(point, normal, p, views, cos_min, slack, corners, 0)
                if quality == HIDDEN:
                    continue
                kind, number = (0, clean) if quality == CLEAN else (1, usable)
                seen[kind, 0, number], seen[kind, 1, number], seen[kind, 2, number] = fetch(color, corners, 0)
                votes[kind, number] = pixels_per_area(point, normal, p, projection, centers)
                clean, usable = (clean + 1, usable) if quality == CLEAN else (clean, usable + 1)
            kind, count = (0, clean) if clean > 0 else (1, usable)
            out_count[i] = count
            out_spread[i] = 0.0
            if count == 0:
                out_color[i] = np.nan
                continue
            spread = 0.0
            for c in range(3):
                value = reduce_channel(seen[kind, c], votes[kind], count, top, bins, statistic)
                out_color[i, c] = value
                for j in range(count):
                    spread += abs(seen[kind, c, j] - value)
            out_spread[i] = spread / (3 * count)
