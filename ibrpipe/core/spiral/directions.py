"""Spiral of view directions over a hemisphere. Source: gong-yang, sec. 3.

Symbols: alpha spiral parameter (its yaw, unwrapped), k density (pitch = k * alpha, turns are 2 k pi apart),
L arc length, n number of samples, (x, y, z) unit direction with z along the outward normal of the support rectangle.

The published spiral ends where it meets the horizon (alpha = pi / 2k), which leaves up to one pitch uncovered on the
other side of the last turn. `table` can close it with one more turn along the horizon itself (pitch held at `limit`),
sampled at the same spacing.
"""

import math

import numpy as np

from ibrpipe.core.jit import helper

#: pitch of the closing turn: just under pi/2, because a direction on the horizon never meets the support rectangle
LIMIT = math.radians(87.0)


def arc_length(alpha, k):
    """Length of the spiral from the pole to alpha: E(k alpha | m = -1/k^2) (gong-yang, eq. 2)."""
    from scipy.special import ellipeinc  # here, so that what renders without residuals starts without scipy

    return float(ellipeinc(k * alpha, -1.0 / (k * k)))


def sample_count(k):
    """Number of samples of the published spiral (gong-yang, eq. 4)."""
    return int(arc_length(math.pi / (2 * k), k) / (2 * math.pi * k)) + 1


def two_plane_ratio(k):
    """How many times more samples a two-plane light field needs (gong-yang, sec. 3.3)."""
    root = math.sqrt(1 + k * k)
    return math.pi / (root + k * k * math.atanh(1 / root))


def _missing_length(alpha, k, wanted):
    return arc_length(alpha, k) - wanted


def published_table(k):
    """(n,) f64 ascending: alpha of every sample, L(alpha_f) = f * 2 k pi (gong-yang, eq. 5)."""
    from scipy.optimize import brentq

    spacing, end = 2 * math.pi * k, math.pi / (2 * k)
    alphas = [0.0]
    for f in range(1, sample_count(k)):
        alphas.append(brentq(_missing_length, alphas[-1], end, args=(k, f * spacing), xtol=1e-13))
    return np.array(alphas)


def table(k, closed=True, limit=LIMIT):
    """Return (n,) f64 alphas, ascending; `closed` adds the turn along the horizon.

    limit : pitch at which the closing turn runs, radians.
    """
    alphas = published_table(k)
    if not closed:
        return alphas
    alphas = alphas[k * alphas < limit]
    horizon = limit / k
    steps = closing_count(k)
    return np.concatenate([alphas, horizon + 2 * math.pi * np.arange(steps) / steps])


def closing_count(k):
    """Number of samples of the closing turn: length 2 pi in steps of at most 2 pi k."""
    return max(math.ceil(1.0 / k), 4)


def directions(alphas, k, limit=LIMIT):
    """(n, 3) f64 unit directions of the samples (gong-yang, eq. 1); pitch never exceeds `limit`."""
    alphas = np.asarray(alphas, np.float64)
    pitch = np.minimum(k * alphas, limit)
    return np.stack([np.sin(pitch) * np.cos(alphas), np.sin(pitch) * np.sin(alphas), np.cos(pitch)], axis=1)


def scale_factors(direction):
    """(Rx, Ry) of an image along `direction` (x, y, z); Rx * Ry = z (gong-yang, eq. 6 with its outer root restored)."""
    x, y, z = direction
    if z <= 0.0:
        return 0.0, 0.0
    s = math.sqrt(z * z + x * x * y * y)
    return math.sqrt(z / s * (1 - x * x)), math.sqrt(z / s * (1 - y * y))


@helper
def lower_bound(alphas, first, last, value):
    """Index of the last of alphas[first:last], ascending, that is <= value; first - 1 if there is none."""
    low, high = first - 1, last
    while high - low > 1:
        middle = (low + high) // 2
        if alphas[middle] <= value:
            low = middle
        else:
            high = middle
    return low
