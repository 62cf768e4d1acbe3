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


def turns_around(ways, k, limit, closing):
    """(alpha below, alpha above, share of the turn above, turns below) for directions (N, 3); every turn is counted."""
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
    return np.maximum(inner, 0.0), outer, share, turns


def lookup(ways, alphas, k, limit, closing):
    """(N, n) weights of all samples for directions (N, 3): the two turns around each blended."""
    inner, outer, share, turns = turns_around(ways, k, limit, closing)
    below = bracket(alphas, closing, inner)
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


def shaded(color, depth, camera, members, coded):
    """(colour with residuals, hit pixels without any), pixel by pixel; members: SpiralResiduals of all textures."""
    out, lost = color.astype(float), 0
    for row, column in zip(*np.nonzero(np.isfinite(depth))):
        way = camera.world_from_pixel @ (column + 0.5, row + 0.5, 1.0)
        point = camera.center + depth[row, column] * way
        total = np.zeros(4)
        places = [_place(point, -way / np.linalg.norm(way), member) for member in members]
        for score, which in sorted(((-place[0], i) for i, place in enumerate(places))):
            if -score <= -1 or total[3] > 0.98:
                break
            member, (_, local, view, scale) = members[which], places[which]
            closing = _closing(member)
            limit = math.radians(87) if member.closed else math.pi / 2
            weights = lookup(view[None], member.alphas, member.k, limit, closing)[0]
            total += residual_at(local, weights, _images(member), scale)
        if total[3] < 1e-3:
            lost += 1
            continue
        change = total[:3] / total[3]
        if coded:
            out[row, column] = _decode(np.maximum(_encode(out[row, column]) + change / 255, 0))
        else:
            out[row, column] = np.maximum(out[row, column] + change, 0)
    return out, lost


def _place(point, view, member):
    """(preference, place in the rectangle, direction in its frame, 1 / edge lengths)."""
    frame = member.rectangle
    edges = np.array([np.linalg.norm(frame.a), np.linalg.norm(frame.b)])
    basis = np.stack([frame.a / edges[0], frame.b / edges[1], -frame.f])
    local, view = basis @ (point - frame.origin), basis @ view
    local = np.array([local[0] / edges[0], local[1] / edges[1], -local[2]])
    if view[2] <= 0.02:
        return -1.0, local, view, 1 / edges
    leaves = local[:2] + local[2] * view[:2] / view[2] / edges
    outside = max(-leaves.min(), leaves.max() - 1)
    return (1 + view[2] if outside <= 0 else view[2] / (1 + outside) - 0.5), local, view, 1 / edges


def _images(member):
    packed = np.concatenate([member.texels.astype(float), member.valid[:, None]], axis=1)
    parts = np.split(packed, member.starts[1:-1])
    return [
        (way, member.zero, part.reshape(*size, 4)) for way, part, size in zip(member.directions, parts, member.sizes)
    ]


def _closing(member):
    return max(math.ceil(1 / member.k), 4) if member.closed else 0


def _encode(linear):
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * np.power(linear, 1 / 2.4) - 0.055)


def _decode(code):
    return np.where(code <= 0.04045, code / 12.92, np.power((code + 0.055) / 1.055, 2.4))
