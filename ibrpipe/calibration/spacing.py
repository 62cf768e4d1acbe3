"""How far apart the photos stand, told by what they share, before depth is searched."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.sparse import csr_matrix

from ibrpipe.capture.view_spacing import WANTED, Spacing, median_spacing, middle_angle
from ibrpipe.io.cameras.colmap_write import ModelImage, SparseModel
from ibrpipe.types import Array

#: Share of a photo's features that its best partner shares, with which a wide angle does no harm
ENOUGH = 0.3
#: Photos count as partners from so many common points on; angles are taken to the so many that share most
FEWEST, PARTNERS = 8, 8


@dataclass(frozen=True)
class Shared:
    """What neighbours share.

    Attributes
    ----------
    spacing : Spacing
        Angles to the partners at the points that both see.
    matched : float
        Share of a photo's features that match its best partner, median over the photos.
    widest : (str, str)
        A photo and its nearest partner, where they are farthest apart.
    widest_deg : float
    """

    spacing: Spacing
    matched: float
    widest: tuple[str, str]
    widest_deg: float

    @property
    def too_wide(self) -> bool:
        """Whether photos stand far apart, and share too little for it to do no harm."""
        return self.spacing.too_wide and self.matched < ENOUGH

    @property
    def facts(self) -> dict[str, Any]:
        """Figures for ``calibration.json``."""
        angles = {"nearest_deg": self.spacing.nearest, "second_deg": self.spacing.second}
        return {**angles, "matched": self.matched, "widest": self.widest, "widest_deg": self.widest_deg}


def shared_of(model: SparseModel, matched: Sequence[float]) -> Shared | None:
    """Return what the photos of a model share; None where no two have enough points in common.

    Parameters
    ----------
    model : SparseModel
    matched : sequence of float
        Share of each photo's features that match its best partner.
    """
    angles: list[list[tuple[float, str]]] = [
        sorted((_angle(one, model.images[j], model.xyz), model.images[j].name) for j in partners)
        for one, partners in zip(model.images, _partners(model), strict=True)
    ]
    spacing = median_spacing([[angle for angle, _ in row] for row in angles])
    if spacing is None:
        return None
    far, photo, partner = max((row[0][0], one.name, row[0][1]) for one, row in zip(model.images, angles) if row)
    return Shared(spacing, float(np.median(matched)), (photo, partner), far)


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
    toward = (shared + image.cam_from_world[:, :3].T @ image.cam_from_world[:, 3] for image in (one, other))
    return middle_angle(*toward)


def words(shared: Shared, photos: int) -> tuple[str, str]:
    """Say what is wrong, and what to shoot."""
    spacing = shared.spacing
    text = (
        f"stand far apart: {spacing.nearest:.0f} degrees to the nearest, {spacing.second:.0f} to the second "
        f"nearest, and a photo shares {shared.matched:.0%} of its features with its best partner (medians); expected "
        f"{WANTED:.0f} degrees to the second, or {ENOUGH:.0%}"
    )
    between = f"{shared.widest[0]} and {shared.widest[1]} ({shared.widest_deg:.0f} degrees apart)"
    return text, f"take {spacing.more_photos(photos)}, first between {between}"
