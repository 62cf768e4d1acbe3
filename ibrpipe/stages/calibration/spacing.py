"""How far apart the photos stand, told by what they share, before depth is searched."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_matrix

from ibrpipe.io.colmap_write import ModelImage, SparseModel
from ibrpipe.types import Array

#: Angle to the second nearest photo up to which depth is found well, degrees (the geometry stage wants the same)
WANTED = 20.0
#: Share of a photo's features that its best partner shares, with which such an angle does no harm
ENOUGH = 0.3
#: Photos count as partners from so many common points on; angles are taken to the so many that share most
FEWEST, PARTNERS = 8, 8


@dataclass(frozen=True)
class Spacing:
    """What neighbours share.

    Attributes
    ----------
    nearest_deg, second_deg : float
        Angle to the nearest and to the second nearest partner at the points that both see, median over the photos.
    matched : float
        Share of a photo's features that match its best partner, median over the photos.
    widest : (str, str)
        A photo and its nearest partner, where they are farthest apart.
    widest_deg : float
    """

    nearest_deg: float
    second_deg: float
    matched: float
    widest: tuple[str, str]
    widest_deg: float

    @property
    def too_wide(self) -> bool:
        """Whether photos stand far apart, and share too little for it to do no harm."""
        return self.second_deg > WANTED and self.matched < ENOUGH


def spacing_of(model: SparseModel, matched: Sequence[float]) -> Spacing | None:
    """Return how far apart the photos of a model stand; None where no two have enough points in common.

    Parameters
    ----------
    model : SparseModel
    matched : sequence of float
        Share of each photo's features that match its best partner.
    """
    angles: list[tuple[float, float, str, str]] = []
    for index, partners in enumerate(_partners(model)):
        one = model.images[index]
        found = sorted((_angle(one, model.images[j], model.xyz), model.images[j].name) for j in partners)
        if found:
            angles.append((found[0][0], found[min(1, len(found) - 1)][0], one.name, found[0][1]))
    if not angles:
        return None
    nearest, second = (float(np.median([each[k] for each in angles])) for k in (0, 1))
    far = max(angles)
    return Spacing(nearest, second, float(np.median(matched)), (far[2], far[3]), far[0])


def _partners(model: SparseModel) -> list[list[int]]:
    """Of each photo those that share most points with it, `PARTNERS` at the most."""
    rows = np.repeat(np.arange(len(model.images)), [len(image.points) for image in model.images])
    columns = np.concatenate([image.points for image in model.images])
    sees = csr_matrix((np.ones(len(rows), np.int32), (rows, columns)), shape=(len(model.images), len(model.xyz)))
    common = np.asarray((sees @ sees.T).todense())
    np.fill_diagonal(common, 0)
    order = np.argsort(-common, axis=1, kind="stable")[:, :PARTNERS]
    return [[int(j) for j in row if common[i, j] >= FEWEST] for i, row in enumerate(order)]


def _angle(one: ModelImage, other: ModelImage, xyz: Array) -> float:
    """Median angle in degrees between the rays of two photos to the points that both see."""
    shared = xyz[np.intersect1d(one.points, other.points)]
    rays = []
    for image in (one, other):
        R, t = image.cam_from_world[:, :3], image.cam_from_world[:, 3]
        away = shared + R.T @ t
        rays.append(away / np.linalg.norm(away, axis=1, keepdims=True))
    return float(np.median(np.degrees(np.arccos(np.clip((rays[0] * rays[1]).sum(axis=1), -1.0, 1.0)))))


def words(spacing: Spacing, photos: int) -> tuple[str, str]:
    """Say what is wrong, and what to shoot."""
    text = (
        f"stand far apart: {spacing.nearest_deg:.0f} degrees to the nearest, {spacing.second_deg:.0f} to the second "
        f"nearest, and a photo shares {spacing.matched:.0%} of its features with its best partner (medians); expected "
        f"{WANTED:.0f} degrees to the second, or {ENOUGH:.0%}"
    )
    more = max(1, math.ceil(photos * (spacing.second_deg / WANTED)) - photos)
    between = f"{spacing.widest[0]} and {spacing.widest[1]} ({spacing.widest_deg:.0f} degrees apart)"
    photos_more = f"{more} more photo{'s' if more > 1 else ''}"
    return text, f"take about {photos_more} between those {photos}, first between {between}"
