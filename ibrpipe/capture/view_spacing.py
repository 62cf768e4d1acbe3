"""How far apart photos stand, and how many would stand near enough: what calibration and depth both tell of."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ibrpipe.core.similarity import direction_angle_deg
from ibrpipe.types import Array

#: angle to the second nearest neighbour (two must agree with a depth) from which on photos are too far apart, and the
#: one that is asked for, degrees; a neighbour at the latter has 0.6 of the worth of the best (`view_selection.worth`)
TOO_WIDE, WANTED = 23.0, 20.0
#: photos in one row have their fourth neighbour at twice the angle of the second, photos over a surface at 1.4 times
ROW = 1.7


@dataclass(frozen=True)
class Spacing:
    """Angles between photos at what they share, medians over the photos, degrees.

    Attributes
    ----------
    nearest, second, fourth : float
        To the nearest of the neighbours that were used, and so on; the farthest where there are fewer.
    farthest : float
        To the farthest of those that were used.
    """

    nearest: float
    second: float
    fourth: float
    farthest: float

    @property
    def too_wide(self) -> bool:
        """Whether the second neighbour stands too far off."""
        return self.second > TOO_WIDE

    def photos_for(self, photos: int) -> int:
        """How many photos bring the second neighbour to the wanted angle, at least, where there are `photos` now."""
        row = self.fourth / self.second > ROW or self.fourth == self.second
        return max(math.ceil(photos * (self.second / WANTED) ** (1 if row else 2)), photos)

    def more_photos(self, photos: int) -> str:
        """Say how many photos to take, in words."""
        more = max(self.photos_for(photos) - photos, 1)
        return f"about {more} more photo{'s' if more > 1 else ''} between those {photos}"


def median_spacing(angles: Sequence[Sequence[float]]) -> Spacing | None:
    """Return the spacing of photos, for each of which the angles to its neighbours are given; None without any."""
    rows = [sorted(row) for row in angles if row]
    if not rows:
        return None
    ranked = ([row[min(rank, len(row) - 1)] for row in rows] for rank in (0, 1, 3))
    return Spacing(*(float(np.median(each)) for each in (*ranked, [row[-1] for row in rows])))


def middle_angle(one: Array, other: Array) -> float:
    """Median angle in degrees between two sets of vectors (N, 3) of any length."""
    unit = [each / np.linalg.norm(each, axis=1, keepdims=True) for each in (one, other)]
    return float(np.median(direction_angle_deg(*unit)))
