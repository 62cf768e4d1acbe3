"""Which of the directions that parts are seen from is nearest."""

import numpy as np

#: cells along a side of the table that finds the nearest direction
CELLS = 64


def nearest_table(axes):
    """Return (CELLS, CELLS) int32: which of the `axes` (D, 3, 3) is nearest to each cell of an octahedral map.

    The map is that of cigolle2014.
    """
    grid = (np.arange(CELLS) + 0.5) * 2.0 / CELLS - 1.0
    u, v = np.meshgrid(grid, grid)
    z = 1.0 - np.abs(u) - np.abs(v)
    x = np.where(z < 0, (1.0 - np.abs(v)) * np.where(u >= 0, 1.0, -1.0), u)
    y = np.where(z < 0, (1.0 - np.abs(u)) * np.where(v >= 0, 1.0, -1.0), v)
    cells = np.stack([x, y, z], axis=-1)
    cells /= np.linalg.norm(cells, axis=-1, keepdims=True)
    return np.argmax(cells @ axes[:, 2].T, axis=-1).astype(np.int32)
