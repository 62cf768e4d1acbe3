"""The bound that outlines put on an object: distances to masks, and where to look for it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ibrpipe.core.reconstruction.tsdf import silhouettes
from ibrpipe.errors import CaptureError
from ibrpipe.io.views import View, load_view
from ibrpipe.progress import Step
from ibrpipe.reconstruction.depth.map_store import packed_cameras
from ibrpipe.types import Array, Camera
from ibrpipe.types.bounds import meeting_point

OUTLINES = Step("outlines", 0.05)
#: from so many photos on, one photo alone may not cut anything away: masks have errors
TRUST_ONE = 12


@dataclass(frozen=True, eq=False)
class Outline:
    """A photo's mask as distances.

    Attributes
    ----------
    camera : Camera
        At the size of the distances.
    distance : (H, W) float32
        Pixels to the outline, positive outside; NaN where the photo has no pixel.
    touches : bool
        The mask reaches the border of the picture.
    contradicted : bool
        Points that are sure lie outside it, see `mask_consistency`.
    """

    camera: Camera
    distance: Array
    touches: bool
    contradicted: bool = False


def load_outlines(views: Sequence[View], most_pixels: int = 1_000_000) -> list[Outline]:
    """Read the masks of photos as distances."""
    return [load_outline(view, most_pixels) for view in OUTLINES.track(views)]


def load_outline(view: View, most_pixels: int = 1_000_000) -> Outline:
    """Read one photo's mask as distances to its outline."""
    mask, known = load_view(view)[1], np.ones((1, 1), bool)
    if view.distortion is not None:
        known = load_view(replace(view, mask=None, mask_from_alpha=False, mask_threshold=None))[1] >= 0.5
    return outline_of(view.camera, mask, known, most_pixels)


def outline_of(camera: Camera, mask: Array, known: Array, most_pixels: int = 1_000_000) -> Outline:
    """Turn a mask (H, W), coverage, into distances; `known` tells where the photo has pixels."""
    import cv2

    scale = min(1.0, (most_pixels / mask.size) ** 0.5)
    width, height = max(1, round(mask.shape[1] * scale)), max(1, round(mask.shape[0] * scale))
    small = mask if scale == 1.0 else cv2.resize(mask, (width, height), interpolation=cv2.INTER_AREA)
    inside = (small >= 0.5).astype(np.uint8)
    near = np.clip(small - 0.5, -0.5, 0.5)  # a pixel cut by the outline is off it by what its coverage says
    within = cv2.distanceTransform(inside, cv2.DIST_L2, cv2.DIST_MASK_PRECISE) if inside.any() else small * 0
    beyond = cv2.distanceTransform(1 - inside, cv2.DIST_L2, cv2.DIST_MASK_PRECISE) if not inside.all() else small * 0
    distance = np.where(inside > 0, 0.5 - within, beyond - 0.5)
    distance = np.where(np.abs(distance) <= 0.5, -near, distance)
    if inside.all():
        distance = np.full(small.shape, -1e6)
    border = np.concatenate([inside[0], inside[-1], inside[:, 0], inside[:, -1]])
    if known.size > 1:
        fitted = known if scale == 1.0 else cv2.resize(known.astype(np.uint8), (width, height)) > 0
        distance = np.where(fitted, distance, np.nan)
    resized = camera.resized(width, height)
    return Outline(resized, distance.astype(np.float32), bool(border.mean() > 0.01))


def bounds_at(points: Array, outlines: Sequence[Outline]) -> tuple[Array, Array]:
    """Return how far points (N, 3) lie outside the outlines, negative inside, and how many photos can tell.

    A point off a picture lies outside where the mask keeps clear of the picture's border.
    """
    bound, count = np.full((len(points), 2), -np.inf, np.float32), np.zeros(len(points), np.int32)
    points = np.ascontiguousarray(points, np.float64)
    for each in outlines:
        starts = np.array([0, each.distance.size], np.int64)
        sizes, focal = np.array([each.distance.shape], np.int64), np.array([each.camera.K[0, 0]])
        projection = packed_cameras([each.camera])[0]
        whole = np.array([not each.touches], np.uint8)
        silhouettes(points, each.distance.ravel(), starts, sizes, projection, focal, whole, bound, count)
    return chosen_bound(bound, len(outlines)), count


def chosen_bound(bound: Array, photos: int) -> Array:
    """Return the distance that counts among the two greatest ones (N, 2)."""
    return bound[:, 1] if photos >= TRUST_ONE else bound[:, 0]


def least_photos(outlines: Sequence[Outline]) -> int:
    """Return how many photos must tell of a place that may belong to the object."""
    return max(2, len(outlines) // 5)


def hull_box(outlines: Sequence[Outline], cells: int = 48) -> tuple[Array, Array]:
    """Return the corners of a box around what all outlines leave.

    Raises
    ------
    CaptureError
        The outlines have nothing in common.
    """
    cameras = [each.camera for each in outlines]
    center, radius = meeting_point(cameras)
    low, high = center - radius, center + radius
    for _ in range(4):
        axes = [np.linspace(low[a], high[a], cells) for a in range(3)]
        grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
        bound, count = bounds_at(grid, outlines)
        step = (high - low) / (cells - 1)
        inside = (bound <= 0.87 * step.max()) & (count >= least_photos(outlines))
        if not inside.any():
            raise CaptureError(
                "the masks have no part of space in common: a mask or camera is wrong, or they show different things"
            )
        low, high = grid[inside].min(axis=0) - 2 * step, grid[inside].max(axis=0) + 2 * step
    return low, high
