"""How far apart the photos stand for depth, and what to shoot where that is too far."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ibrpipe.io.dense import DepthMap
from ibrpipe.io.views import View
from ibrpipe.types import Array

#: angle to the second nearest neighbour (two must agree with a depth) from which on photos are too far apart, and the
#: one that is asked for, degrees; a neighbour at the latter has 0.6 of the worth of the best, see `neighbours.worth`
TOO_WIDE, WANTED = 23.0, 20.0
#: with this share of agreed depth, the angle does no harm that is worth a warning
ENOUGH = 0.75
#: photos in one row have their fourth neighbour at twice the angle of the second, photos over a surface at 1.4 times
ROW = 1.7
#: pixels with depth at which angles are taken, about; with fewer than so many known ones the depth range stands in
PIXELS, FEWEST = 400, 20


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


def angles_between(view: View, others: Sequence[View], depth: Array, middle: float) -> tuple[float, ...]:
    """Return the median angles between a view and others at the points of its depth map, degrees.

    Parameters
    ----------
    view : View
    others : sequence of View
    depth : (H, W) float32
        0 = unknown.
    middle : float
        Depth on the view's axis that is taken where hardly any is known, scene units.
    """
    camera = view.camera.resized(depth.shape[1], depth.shape[0])
    rows, columns = np.nonzero(depth > 0)
    step = max(len(rows) // PIXELS, 1)
    rows, columns = rows[step // 2 :: step], columns[step // 2 :: step]
    rays = np.stack([columns + 0.5, rows + 0.5, np.ones(len(rows))], axis=1) @ camera.world_from_pixel.T
    away = rays * depth[rows, columns, None]
    if len(rows) < FEWEST:
        away = middle * camera.R[2:3]
    return tuple(_middle_angle(away, away + camera.center - other.camera.center) for other in others)


def _middle_angle(one: Array, two: Array) -> float:
    lengths = np.linalg.norm(one, axis=1) * np.linalg.norm(two, axis=1)
    return float(np.median(np.degrees(np.arccos(np.clip((one * two).sum(axis=1) / lengths, -1, 1)))))


def spacing_of(maps: Sequence[DepthMap]) -> Spacing | None:
    """Return how far apart the photos of depth maps stand; None where no map tells."""
    rows = [sorted(each.angles) for each in maps if each.angles]
    if not rows:
        return None
    return Spacing(*(float(np.median([row[min(n, len(row) - 1)] for row in rows])) for n in (0, 1, 3, len(rows[0]))))


def warning(spacing: Spacing, photos: int, agreed: float) -> str | None:
    """Say in one line what is wrong and what to shoot; None where photos stand near enough or depth agrees anyhow.

    Parameters
    ----------
    spacing : Spacing
    photos : int
        How many there are.
    agreed : float
        Share of the pixels (of the masks, where there are some) with depth that other photos confirm.
    """
    if not spacing.too_wide or agreed >= ENOUGH:
        return None
    more = max(spacing.photos_for(photos) - photos, 1)
    apart = f"{spacing.nearest:.0f} degrees to the nearest neighbour"
    if photos > 2:
        apart += f", {spacing.second:.0f} to the second, {spacing.farthest:.0f} to the farthest that was used"
    return (
        f"the photos stand far apart for depth ({apart}; medians), and {agreed:.0%} of the pixels have depth that "
        f"others confirm; expected {'two neighbours' if photos > 2 else 'a neighbour'} within {WANTED:.0f} degrees: "
        f"take about {more} more photo{'s' if more > 1 else ''} between those {photos}, evenly spread"
    )
