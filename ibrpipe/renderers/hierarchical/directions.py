"""Directions that parts are seen from beforehand."""

from __future__ import annotations

import numpy as np

from ibrpipe.types import Array

#: cells along a side of the table that finds the nearest direction
CELLS = 64


def view_axes(count: int) -> Array:
    """Return axes (D, 3, 3) float64 of views, rows a, b, d: 6 = those of max1999, else a spiral over the sphere."""
    if count == 6:
        directions = np.concatenate([np.eye(3), -np.eye(3)])
    else:
        z = 1.0 - (2.0 * np.arange(count) + 1.0) / count
        around = np.arange(count) * np.pi * (3.0 - np.sqrt(5.0))
        ring = np.sqrt(1.0 - z * z)
        directions = np.stack([ring * np.cos(around), ring * np.sin(around), z], axis=1)
    aside = np.where(np.abs(directions[:, 2:]) < 0.9, (0.0, 0.0, 1.0), (1.0, 0.0, 0.0))
    a = np.cross(aside, directions)
    a /= np.linalg.norm(a, axis=1, keepdims=True)
    return np.stack([a, np.cross(directions, a), directions], axis=1)


def nearest_table(axes: Array) -> Array:
    """Return (CELLS, CELLS) int32: the view nearest to each cell of an octahedral map (cigolle2014)."""
    grid = (np.arange(CELLS) + 0.5) * 2.0 / CELLS - 1.0
    u, v = np.meshgrid(grid, grid)
    z = 1.0 - np.abs(u) - np.abs(v)
    x = np.where(z < 0, (1.0 - np.abs(v)) * np.where(u >= 0, 1.0, -1.0), u)
    y = np.where(z < 0, (1.0 - np.abs(u)) * np.where(v >= 0, 1.0, -1.0), v)
    cells = np.stack([x, y, z], axis=-1)
    cells /= np.linalg.norm(cells, axis=-1, keepdims=True)
    return np.argmax(cells @ axes[:, 2].T, axis=-1).astype(np.int32)
