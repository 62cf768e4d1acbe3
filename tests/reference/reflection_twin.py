"""Shared reflection as plain Python and float64: one look at a time, tables read by direction."""

from __future__ import annotations

import numpy as np

DARK = 1e-6


def place_of(direction, size):
    """Octahedral place (u, v) of a direction in a table, cells as units, the first cell's centre at (0.5, 0.5)."""
    x, y, z = np.asarray(direction, float) / np.abs(direction).sum()
    if z < 0:
        x, y = (1 - abs(y)) * (1 if x >= 0 else -1), (1 - abs(x)) * (1 if y >= 0 else -1)
    return (x + 1) / 2 * size, (y + 1) / 2 * size


def direction_of(u, v, size):
    """Unit direction of a place."""
    x, y = 2 * u / size - 1, 2 * v / size - 1
    z = 1 - abs(x) - abs(y)
    if z < 0:
        x, y = (1 - abs(y)) * (1 if x >= 0 else -1), (1 - abs(x)) * (1 if y >= 0 else -1)
    return np.array([x, y, z]) / np.linalg.norm([x, y, z])


def across(i, j, size):
    """Cell of a table that lies at (i, j), which may be one step outside: over an edge the table goes on mirrored."""
    if not 0 <= i < size:
        i, j = min(max(i, 0), size - 1), size - 1 - j
    if not 0 <= j < size:
        i, j = size - 1 - i, min(max(j, 0), size - 1)
    return i, j


def table_light(table, direction):
    """Bilinear light (3,) of a table of square roots (n, n, 3)."""
    size = len(table)
    u, v = (at - 0.5 for at in place_of(direction, size))
    i, j = int(np.floor(u)), int(np.floor(v))
    light = np.zeros(3)
    for di in (0, 1):
        for dj in (0, 1):
            weight = (u - i if di else 1 - (u - i)) * (v - j if dj else 1 - (v - j))
            column, row = across(i + di, j + dj, size)
            light += weight * table[row, column] ** 2
    return light


def corner_weights(samples, p, q):
    """Bilinear weights (4,) over the corners that are samples, summing to 1; None where there is none."""
    weights = np.array([(1 - p) * (1 - q), p * (1 - q), (1 - p) * q, p * q]) * (np.asarray(samples) >= 0)
    return weights / weights.sum() if weights.sum() > 0 else None


def color(samples, place, normal, toward, mirrored, texels, tables, law):
    """Light (3,) of one look; None where nothing is known. law: damping, bend, reflectances."""
    weights = corner_weights(samples, *place)
    if weights is None:
        return None
    cosine = min(max(float(np.dot(normal, toward)), 0.0), 1.0)
    s, reflected = (1 - cosine) ** 5, 2 * cosine * np.asarray(normal) - np.asarray(toward)
    known = [(w, texels[i]) for w, i in zip(weights, samples) if w > 0]
    light = (1 - law[0] * s) * sum(w * texel[:3] ** 2 for w, texel in known)
    for number, table in enumerate(tables):
        share = sum(w * texel[3 + number] for w, texel in known) if texels.shape[1] > 3 else 1.0
        f = law[2 + number]
        own = table_light(table, reflected) if mirrored is None else np.asarray(mirrored, float)
        light = light + share * (f + (1 - f) * s) * own
    return light


def loss(light, root, weight, bend):
    """Huber's loss of one look in square roots; channels with a negative root are clipped in the photo."""
    total = 0.0
    for channel in range(3):
        error = np.sqrt(light[channel] + DARK) - abs(root[channel])
        if root[channel] < 0 and error > 0:
            continue
        total += 0.5 * error**2 if abs(error) <= bend else bend * (abs(error) - 0.5 * bend)
    return weight * total
