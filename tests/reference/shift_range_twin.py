"""Slow plain twin of the range of colours that a small shift could bring to a pixel."""

from __future__ import annotations

import numpy as np


def colour_at(picture, y, x):
    """Bilinear colour (3,): every pixel weighted by a triangle; NaN where one with weight is missing or outside."""
    total, weight = np.zeros(3), 0.0
    for row in range(picture.shape[0]):
        for column in range(picture.shape[1]):
            share = max(0.0, 1 - abs(y - row)) * max(0.0, 1 - abs(x - column))
            if share > 1e-9:
                total, weight = total + share * picture[row, column], weight + share
    return total if weight > 1 - 1e-6 else np.full(3, np.nan)


def range_around(picture, row, column, radius):
    """(low (3,), high (3,)) over a pixel and the eight points around it; points that are missing do not count."""
    angles = np.arange(8) * np.pi / 4
    around = [colour_at(picture, row + radius * np.sin(a), column + radius * np.cos(a)) for a in angles]
    found = [picture[row, column], *(colour for colour in around if np.isfinite(colour).all())]
    return np.min(found, axis=0), np.max(found, axis=0)
