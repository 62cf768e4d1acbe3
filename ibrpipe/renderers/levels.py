"""Levels of pyramids of height fields: which one suits a view, and how heights and colours are halved."""

from __future__ import annotations

import math

import numpy as np

from ibrpipe.types import Array

#: coarsest level that a view chooses
COARSEST = 12


def level_of(corners: Array, rows: int, columns: int) -> int:
    """Level by the projected area, with no texel side longer than a pixel (oliveira2000, sec. 4.3 and 6).

    Parameters
    ----------
    corners : (3, 4) float64
        Homogeneous pixels of the corners, in order round the texture; what is not before the eye gives level 0.
    rows, columns : int
        Texels.
    """
    x, y, z = corners.tolist()
    if min(z) <= 1e-6 * max(abs(each) for each in z):
        return 0
    x, y = [p / w for p, w in zip(x, z, strict=True)], [p / w for p, w in zip(y, z, strict=True)]
    area, sparest = 0.0, np.inf
    for k, texels in enumerate((columns, rows, columns, rows)):
        area += 0.5 * (x[k - 1] * y[k] - x[k] * y[k - 1])
        side = math.hypot(x[(k + 1) % 4] - x[k], y[(k + 1) % 4] - y[k])
        sparest = min(sparest, (texels / max(side, 1e-9)) ** 2)
    sparest = min(sparest, rows * columns / max(abs(area), 1.0))
    return int(min(max(math.floor(0.5 * math.log2(sparest)), 0), COARSEST))


def halved(values: Array, height: Array) -> Array:
    """Average 2 x 2 texels of values (H, W, C) where `height` (H, W) is no hole; holes only where all four are."""
    rows, columns = -(-height.shape[0] // 2), -(-height.shape[1] // 2)
    padded = np.full((2 * rows, 2 * columns, values.shape[2]), np.nan)
    padded[: height.shape[0], : height.shape[1]] = np.where(np.isnan(height)[..., None], np.nan, values)
    blocks = padded.reshape(rows, 2, columns, 2, -1).transpose(0, 2, 1, 3, 4).reshape(rows, columns, 4, -1)
    known = np.isfinite(blocks)
    total = np.where(known, blocks, 0.0).sum(axis=2)
    count = known.sum(axis=2)
    empty = np.nan if values.shape[2] == 1 else 0.0
    return np.where(count > 0, total / np.maximum(count, 1), empty).astype(np.float32)
