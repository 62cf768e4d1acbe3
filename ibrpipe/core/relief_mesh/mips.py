"""Mip pyramids of textures with four channels, and their anisotropic reading. Source: policarpo2005, sec. 5.

Symbols: ``table`` (levels, 3) int64: first texel, rows, columns of each level; a footprint is the parallelogram of
texture coordinates that a pixel covers, ``(ux, vx)`` per pixel along x, ``(uy, vy)`` along y.
"""

from __future__ import annotations

import math

import numpy as np
from numba import prange

from ibrpipe.core.jit import helper, kernel


def halve_axis(image: np.ndarray, axis: int) -> np.ndarray:
    """Return the image with an axis of n texels averaged to max(1, n // 2), each counting by how much it covers."""
    size = image.shape[axis]
    if size == 1:
        return image
    moved = np.moveaxis(image, axis, 0)
    count = size // 2
    if size % 2 == 0:
        halved = 0.5 * (moved[0::2] + moved[1::2])
    else:  # each new texel covers size / count = 2 + 1 / count old ones
        k = np.arange(count).reshape(-1, *[1] * (image.ndim - 1))
        first, last = (count - k) / size, (k + 1) / size
        halved = first * moved[0:-2:2] + (count / size) * moved[1:-1:2] + last * moved[2::2]
    return np.moveaxis(halved, 0, axis)


def build_mips(image: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return (texels (M, 4) float32, table) of an image (H, W, 4), from its own size down to one texel."""
    level = np.asarray(image, np.float64)
    parts, table, first = [], [], 0
    while True:
        parts.append(level.reshape(-1, 4).astype(np.float32))
        table.append((first, level.shape[0], level.shape[1]))
        first += level.shape[0] * level.shape[1]
        if level.shape[0] == level.shape[1] == 1:
            return np.concatenate(parts), np.array(table, np.int64)
        level = halve_axis(halve_axis(level, 0), 1)


@helper
def add_level(texels, table, level, wraps, u, v, share, out):
    # out (4,) += share * bilinear texel at texture coordinates (u, v) of one level
    first, rows, columns = table[level, 0], table[level, 1], table[level, 2]
    if not wraps:
        u, v = min(max(u, 0.0), 1.0), min(max(v, 0.0), 1.0)
    x, y = u * columns - 0.5, v * rows - 0.5
    i, j = np.int64(math.floor(x)), np.int64(math.floor(y))
    p, q = x - i, y - j
    for corner in range(4):
        c, r = i + (corner & 1), j + (corner >> 1)
        if wraps:
            c, r = c % columns, r % rows
        else:
            c, r = min(max(c, 0), columns - 1), min(max(r, 0), rows - 1)
        weight = share * (p if corner & 1 else 1.0 - p) * (q if corner >> 1 else 1.0 - q)
        at = first + r * columns + c
        for k in range(4):
            out[k] += weight * texels[at, k]


@helper
def read_footprint(texels, table, wraps, u, v, foot, most, out):
    # foot: (ux, vx, uy, vy); most: probes along the longer axis, 0 = the finest level alone -> out (4,)
    for k in range(4):
        out[k] = 0.0
    if most == 0:
        add_level(texels, table, 0, wraps, u, v, 1.0, out)
        return
    across, down = float(table[0, 2]), float(table[0, 1])
    ax, ay, bx, by = foot[0] * across, foot[1] * down, foot[2] * across, foot[3] * down
    xx, xy, yy = ax * ax + bx * bx, ax * ay + bx * by, ay * ay + by * by
    if not xx + yy < 1e18:
        add_level(texels, table, table.shape[0] - 1, wraps, u, v, 1.0, out)
        return
    middle, half = 0.5 * (xx + yy), math.sqrt(0.25 * (xx - yy) * (xx - yy) + xy * xy)
    longer, shorter = math.sqrt(middle + half), math.sqrt(max(middle - half, 0.0))
    frame = 0.5 * math.atan2(2.0 * xy, xx - yy)
    step_u, step_v = longer * math.cos(frame) / across, longer * math.sin(frame) / down
    probes = np.int64(min(max(math.ceil(min(longer / max(shorter, 1.0), 1e6) - 1e-6), 1.0), float(most)))
    size = max(longer / probes, shorter)
    level = min(max(math.log2(max(size, 1e-9)), 0.0), float(table.shape[0] - 1))
    fine = np.int64(math.floor(level))
    rest = level - fine
    for k in range(probes):
        along = (k + 0.5) / probes - 0.5
        at_u, at_v, share = u + along * step_u, v + along * step_v, 1.0 / probes
        add_level(texels, table, fine, wraps, at_u, at_v, share * (1.0 - rest), out)
        if rest > 0.0:
            add_level(texels, table, fine + 1, wraps, at_u, at_v, share * rest, out)


@kernel
def read_points(texels, table, wraps, places, feet, most, out):
    # places (N, 2), feet (N, 4) -> out (N, 4) float64, as read_footprint reads each
    for n in prange(places.shape[0]):
        read_footprint(texels, table, wraps, places[n, 0], places[n, 1], feet[n], most, out[n])
