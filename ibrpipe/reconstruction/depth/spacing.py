"""Angles between photos at the points of their depth maps, and a line for photos that stand too far apart."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ibrpipe.capture.view_spacing import WANTED, Spacing, median_spacing, middle_angle
from ibrpipe.io.dense import DepthMap
from ibrpipe.io.views import View
from ibrpipe.types import Array

#: with this share of agreed depth, the angle does no harm that is worth a warning
ENOUGH = 0.75
#: pixels with depth at which angles are taken, about; with fewer than so many known ones the depth range stands in
PIXELS, FEWEST = 400, 20


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
    rays = camera.pixel_rays(np.stack([columns, rows], axis=1) + 0.5)
    away = rays * depth[rows, columns, None]
    if len(rows) < FEWEST:
        away = middle * camera.R[2:3]
    return tuple(middle_angle(away, away + camera.center - other.camera.center) for other in others)


def spacing_of(maps: Sequence[DepthMap]) -> Spacing | None:
    """Return how far apart the photos of depth maps stand; None where no map tells."""
    return median_spacing([each.angles for each in maps])


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
    apart = f"{spacing.nearest:.0f} degrees to the nearest neighbour"
    if photos > 2:
        apart += f", {spacing.second:.0f} to the second, {spacing.farthest:.0f} to the farthest that was used"
    return (
        f"the photos stand far apart for depth ({apart}; medians), and {agreed:.0%} of the pixels have depth that "
        f"others confirm; expected {'two neighbours' if photos > 2 else 'a neighbour'} within {WANTED:.0f} degrees: "
        f"take {spacing.more_photos(photos)}, evenly spread"
    )
