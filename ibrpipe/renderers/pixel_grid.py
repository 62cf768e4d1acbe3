"""Where the rays of a picture pass through it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from ibrpipe.types import Array


@dataclass(frozen=True, eq=False)
class PixelGrid:
    """Ray (y, x) of (H, W) passes through ``rows[y] + columns[x]`` of the camera's picture.

    Usually rows and columns are those of the picture itself. They may also be some pixels, and places within a pixel.

    Attributes
    ----------
    rows, columns : (H, 2), (W, 2) float64, pixels along x and y
    """

    rows: Array
    columns: Array

    @staticmethod
    @lru_cache(maxsize=8)
    def centers(height: int, width: int) -> PixelGrid:
        """Return the rays through all pixels' centres."""
        rows, columns = np.zeros((height, 2)), np.full((width, 2), 0.5)
        rows[:, 1], columns[:, 0] = np.arange(height), np.arange(width) + 0.5
        return PixelGrid(rows, columns)

    @property
    def arrays(self) -> tuple[Array, Array]:
        """Rows and columns, as kernels take them."""
        return self.rows, self.columns

    @property
    def points(self) -> Array:
        """(H, W, 2) float64, all places."""
        return self.rows[:, None] + self.columns
