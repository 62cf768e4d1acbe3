"""Which photos to match a photo with, and between which depths: from sparse points, or from cameras and masks alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ibrpipe.errors import CaptureError
from ibrpipe.io.points import SparsePoints
from ibrpipe.io.views import View, load_view
from ibrpipe.types import Array

#: best angle between two rays to a point, and how fast its worth falls below and above, degrees
BEST_ANGLE, BELOW, ABOVE = 8.0, 3.0, 12.0
#: how much farther than the sparse points the depth range reaches
NEARER, FARTHER = 0.85, 1.2
#: fewer sparse points than this in a view: cameras and masks are used instead
FEWEST = 12
#: pixels per side and depths per pixel of the samples without sparse points, and the greatest motion, picture widths
GRID, DEPTHS, MOTION = 24, 96, 0.5


@dataclass(frozen=True)
class Neighbourhood:
    """What a view is matched with.

    Attributes
    ----------
    others : tuple of int
        Indices of views, best first.
    near, far : float
        Depth range along camera z, scene units.
    """

    others: tuple[int, ...]
    near: float
    far: float


def neighbourhoods(views: Sequence[View], points: SparsePoints | None, count: int) -> tuple[Neighbourhood, ...]:
    """Choose up to `count` neighbours and the depth range of every view.

    Raises
    ------
    CaptureError
        There are fewer than two views, or a view shares nothing with any other.
    """
    if len(views) < 2:
        raise CaptureError(f"depth needs at least 2 photos, got {len(views)}; add photos or give a mesh")
    score = np.zeros((len(views), len(views)))
    ranges: list[tuple[float, float] | None] = [None] * len(views)
    if points is not None:
        score, ranges = _from_points(views, points)
    masks: list[Array] | None = None
    for i in range(len(views)):
        if ranges[i] is None or not score[i].any():
            masks = _small_masks(views) if masks is None else masks
            score[i], ranges[i] = _from_cameras(views, masks, i)
    return tuple(_chosen(views[i], score[i], ranges[i], count) for i in range(len(views)))


def worth(angle: Array) -> Array:
    """How good an angle (degrees) between two rays to a point is for matching, 0..1."""
    away = angle - BEST_ANGLE
    return np.exp(-(away**2) / (2 * np.where(away < 0, BELOW, ABOVE) ** 2))


def _chosen(view: View, score: Array, bounds: tuple[float, float] | None, count: int) -> Neighbourhood:
    order = [int(j) for j in np.argsort(-score, kind="stable")[:count] if score[j] > 0]
    if not order or bounds is None:
        raise CaptureError(f"photo {view.name} sees nothing that another photo sees; leave it out or add photos")
    return Neighbourhood(tuple(order), *bounds)


def _from_points(views: Sequence[View], points: SparsePoints) -> tuple[Array, list[tuple[float, float] | None]]:
    """Score (V, V): worth of all shared points; depth range of every view, None where it sees too few."""
    score = np.zeros((len(views), len(views)))
    which = np.repeat(np.arange(len(points.xyz)), np.diff(points.offsets))
    ranges: list[tuple[float, float] | None] = []
    seen = [which[points.views == i] for i in range(len(views))]
    for i, view in enumerate(views):
        depth = points.xyz[seen[i]] @ view.camera.R[2] + view.camera.t[2]
        depth = depth[depth > 0]
        few = len(depth) < FEWEST
        low, high = (0.0, 0.0) if few else np.percentile(depth, [1, 99])
        ranges.append(None if few else (float(low * NEARER), float(high * FARTHER)))
        for j in range(i):
            both = points.xyz[np.intersect1d(seen[i], seen[j], assume_unique=True)]
            angle = _angles(both, view.camera.center, views[j].camera.center)
            score[i, j] = score[j, i] = worth(angle).sum()
    return score, ranges


def _angles(points: Array, first: Array, second: Array) -> Array:
    """Angle at (N, 3) points between two centres, degrees."""
    a, b = first - points, second - points
    lengths = np.linalg.norm(a, axis=-1) * np.linalg.norm(b, axis=-1)
    return np.degrees(np.arccos(np.clip((a * b).sum(axis=-1) / np.maximum(lengths, 1e-300), -1, 1)))


def _small_masks(views: Sequence[View]) -> list[Array]:
    import cv2

    found = []
    for view in views:
        mask = load_view(view)[1]
        scale = min(1.0, 256.0 / max(mask.shape))
        size = (max(round(mask.shape[1] * scale), 1), max(round(mask.shape[0] * scale), 1))
        found.append(cv2.resize(mask, size, interpolation=cv2.INTER_AREA) > 0.02)
    return found


def _from_cameras(views: Sequence[View], masks: list[Array], i: int) -> tuple[Array, tuple[float, float] | None]:
    """Score (V,) and depth range of a view from samples of what it sees that lie in the masks of others."""
    camera, score = views[i].camera, np.zeros(len(views))
    apart = np.array([np.linalg.norm(view.camera.center - camera.center) for view in views])
    nearest = np.min(apart[apart > 1e-9 * apart.max()], initial=np.inf)
    if not np.isfinite(nearest):
        return score, None
    rows, columns = np.nonzero(masks[i])
    picked = np.linspace(0, len(rows) - 1, min(GRID * GRID, len(rows))).astype(np.int64)
    x = (columns[picked] + 0.5) * camera.width / masks[i].shape[1]
    y = (rows[picked] + 0.5) * camera.height / masks[i].shape[0]
    rays = np.stack([x, y, np.ones_like(x)], axis=1) @ camera.world_from_pixel.T
    highest = MOTION * camera.width / (camera.K[0, 0] * nearest)
    q = (np.arange(DEPTHS) + 0.5) / DEPTHS * highest
    points = camera.center + rays[:, None, :] / q[None, :, None]
    inside = np.stack([_inside(views[j], masks[j], points) if j != i else np.zeros(points.shape[:2], bool)
                       for j in range(len(views))])  # fmt: skip
    angles = np.stack([_angles(points, camera.center, view.camera.center) for view in views])
    inside &= angles < 60
    common = inside.sum(axis=0) >= min(2, len(views) - 1)
    common &= inside.sum(axis=0) >= 0.5 * inside.sum(axis=0).max()
    for j in range(len(views)):
        score[j] = (worth(angles[j]) * (inside[j] & common)).sum()
    kept = np.nonzero(common.any(axis=0))[0]
    if len(kept) == 0:
        return score, None
    low, high = max(q[kept[0]] - highest / DEPTHS, 0.1 * highest / DEPTHS), q[kept[-1]] + highest / DEPTHS
    return score, (float(1 / high), float(1 / low))


def _inside(view: View, mask: Array, points: Array) -> Array:
    """Which (..., 3) points fall into a view's mask."""
    local = points @ view.camera.R.T + view.camera.t
    with np.errstate(divide="ignore", invalid="ignore"):
        pixel = (local @ view.camera.K.T)[..., :2] / local[..., 2:]
    u = pixel[..., 0] * mask.shape[1] / view.camera.width
    v = pixel[..., 1] * mask.shape[0] / view.camera.height
    seen = (local[..., 2] > 0) & (u >= 0) & (v >= 0) & (u < mask.shape[1]) & (v < mask.shape[0])
    return seen & mask[np.where(seen, v, 0).astype(np.int64), np.where(seen, u, 0).astype(np.int64)]
