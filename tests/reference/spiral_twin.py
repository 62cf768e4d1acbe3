"""Slow plain twins of the spiral and its look-up: quadrature for elliptic integrals, all turns and pairs tried."""

from __future__ import annotations

import math

import numpy as np
from scipy.integrate import quad

TURN = 2 * math.pi


def arc_length(alpha, k):
    """Length of (sin k a cos a, sin k a sin a, cos k a) from 0 to alpha: its speed integrated over p = k a."""
    return quad(lambda p: math.hypot(1.0, math.sin(p) / k), 0.0, k * alpha, epsabs=0.0, epsrel=1e-12, limit=400)[0]


def direction_of(alpha, k, limit):
    pitch = min(k * alpha, limit)
    return np.array([math.sin(pitch) * math.cos(alpha), math.sin(pitch) * math.sin(alpha), math.cos(pitch)])


def bracket(alphas, closing, alpha):
    """(N, n) weights of the two samples around each alpha (N,), found by trying every pair of successive samples."""
    count = len(alphas)
    first = count - closing
    if closing:  # the last turn is a circle
        alpha = np.where(alpha >= alphas[first], alphas[first] + np.fmod(alpha - alphas[first], TURN), alpha)
    weights = np.zeros((len(alpha), count))
    pairs = [(i, i + 1, alphas[i], alphas[i + 1]) for i in range(count - 1)]
    pairs.append((count - 1, first if closing else 0, alphas[-1], alphas[first] + TURN if closing else np.inf))
    for one, other, start, end in pairs:
        here = (alpha >= start) & ((alpha < end) | (one == count - 1))
        share = (alpha[here] - start) / (end - start)
        weights[here, one] += 1 - share
        weights[here, other] += share
    return weights


def lookup(ways, alphas, k, limit, closing):
    """(N, n) weights of all samples for directions (N, 3): every turn below is counted, the two around it blended."""
    x, y, z = np.asarray(ways, float).T
    pitch, yaw = np.arctan2(np.hypot(x, y), z), np.arctan2(y, x)
    yaw = np.where(yaw < 0, yaw + TURN, yaw)
    yaw = np.where(yaw >= TURN, 0.0, yaw)
    turns = np.zeros(len(pitch))
    for turn in range(math.ceil(1 / k) + 2):
        turns += k * (TURN * turn + yaw) <= pitch
    inner = TURN * (turns - 1) + yaw  # the turn just below; before the first one the pole stands in
    outer = TURN * turns + yaw
    low, high = np.where(turns > 0, k * inner, 0.0), k * outer
    if closing:
        high = np.minimum(high, limit)
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.where(high > low, np.clip((pitch - low) / (high - low), 0, 1), 1.0)
    if closing:
        share = np.where((turns > 0) & (low >= limit), 0.0, share)
    below = bracket(alphas, closing, np.maximum(inner, 0.0))
    below[turns == 0] = np.eye(len(alphas))[0]
    return (1 - share)[:, None] * below + share[:, None] * bracket(alphas, closing, outer)


def residual_at(point, weights, images, scale):
    """(R, G, B, weight) of weighted residual images at a point of the rectangle, depth corrected.

    images : list of (direction, zero, texels (H, W, 4)); the last channel of a texel says whether it is valid.
    """
    total = np.zeros(4)
    for weight, (direction, zero, texels) in zip(weights, images):
        if weight <= 0:
            continue
        height, width = texels.shape[:2]
        u = point[0] + point[2] * direction[0] / direction[2] * scale[0]
        v = point[1] + point[2] * direction[1] / direction[2] * scale[1]
        x, y = u * width - 0.5, v * height - 0.5
        for row in range(height):
            for column in range(width):
                share = max(0.0, 1 - abs(x - column)) * max(0.0, 1 - abs(y - row))
                if share > 0 and texels[row, column, 3]:
                    total[:3] += weight * share * (texels[row, column, :3].astype(float) - zero)
                    total[3] += weight * share
    return total
