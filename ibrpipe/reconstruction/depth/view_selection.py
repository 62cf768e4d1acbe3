"""Which photos to match a photo with, and between which depths: from sparse points, or from cameras and masks alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ibrpipe.errors import CaptureError
from ibrpipe.io.points import SparsePoints
from ibrpipe.io.views import View, load_view
from ibrpipe.types import Array, Camera

#: best angle between two rays to a point, and how fast its worth falls below and above, degrees
BEST_ANGLE, BELOW, ABOVE = 8.0, 3.0, 12.0
#: how much farther than the sparse points the depth range reaches
NEARER, FARTHER = 0.85, 1.2
#: fewer sparse points than this in a view: cameras and masks are used instead
FEWEST = 12
#: rays and depths per ray of the samples without sparse points; the greatest motion between the nearest cameras,
#: picture widths; how many of the nearest and of all cameras judge them
RAYS, DEPTHS, MOTION, JUDGES = 256, 192, 2.0, 32
#: a depth counts where this share of its rays lies in other pictures
OVERLAP = 0.5
#: a sample belongs to the object where it lies in this share of the masks whose pictures hold it
AGREED = 0.75
#: photos see a sample only under smaller angles, degrees
WIDEST = 60.0


@dataclass(frozen=True)
class ViewSelection:
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


def select_views(views: Sequence[View], points: SparsePoints | None, count: int) -> tuple[ViewSelection, ...]:
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


def _chosen(view: View, score: Array, bounds: tuple[float, float] | None, count: int) -> ViewSelection:
    order = [int(j) for j in np.argsort(-score, kind="stable")[:count] if score[j] > 0]
    if not order or bounds is None:
        raise CaptureError(f"photo {view.name} sees nothing that another photo sees; leave it out or add photos")
    return ViewSelection(tuple(order), *bounds)


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
    rays = _rays(camera, masks[i])
    highest = MOTION * camera.width / (camera.K[0, 0] * nearest)
    q = ((np.arange(DEPTHS) + 0.5) / DEPTHS * highest).astype(np.float32)
    looks = {j: _look(camera, views[j].camera, masks[j], rays, q) for j in _judges(apart, i)}
    least = min(2, len(looks))
    framed, common = np.zeros((len(rays), DEPTHS), np.int32), np.zeros((len(rays), DEPTHS), np.int32)
    held, near = framed.copy(), framed.copy()
    for j, (in_picture, in_mask, cosine) in looks.items():
        close = cosine > np.cos(np.radians(WIDEST))
        framed += in_picture | _shows_all(masks[j])
        held += in_mask
        near += in_picture & close
        common += in_mask & close
    kept = (common >= least) & (held >= AGREED * framed) & ((near >= least).mean(axis=0) >= OVERLAP)
    for j, (_, in_mask, cosine) in looks.items():
        angle = np.degrees(np.arccos(np.clip(cosine[in_mask & kept], -1, 1)))
        score[j] = worth(angle[angle < WIDEST]).sum()
    used = np.nonzero(kept.any(axis=0))[0]
    if len(used) == 0:
        return score, None
    step = highest / DEPTHS
    low, high = max(q[used[0]] - step, 0.1 * step), q[used[-1]] + step
    return score, (float(1 / high), float(1 / low))


def _judges(apart: Array, i: int) -> list[int]:
    """Indices of the nearest cameras and of some of all, but for the view's own; `apart` are their distances."""
    order = [int(j) for j in np.argsort(apart, kind="stable") if j != i]
    rest = order[JUDGES:]
    return order[:JUDGES] + rest[:: max(-(-len(rest) // JUDGES), 1)]


def _shows_all(mask: Array) -> bool:
    """Whether a mask keeps away from the picture's border, so that nothing of the object is outside the picture."""
    return bool(mask.any() and not (mask[[0, -1]].any() or mask[:, [0, -1]].any()))


def _rays(camera: Camera, mask: Array) -> Array:
    """Rays through pixels spread over a mask, (N, 3), 1 along the camera's axis."""
    rows, columns = np.nonzero(mask)
    step = max(int(np.sqrt(len(rows) / RAYS)), 1)
    even = (rows % step == step // 2) & (columns % step == step // 2)
    rows, columns = (rows[even], columns[even]) if even.any() else (rows, columns)
    x = (columns + 0.5) * camera.width / mask.shape[1]
    y = (rows + 0.5) * camera.height / mask.shape[0]
    return camera.pixel_rays(np.stack([x, y], axis=1))


def _look(camera: Camera, other: Camera, mask: Array, rays: Array, q: Array) -> tuple[Array, Array, Array]:
    """How another view sees samples on a camera's rays (N, 3) at inverse depths q (D,).

    Returns
    -------
    (N, D) bool, (N, D) bool, (N, D) float32
        In its picture; in its mask; cosine of the angle between both views' rays.
    """
    start, moved = rays @ other.R.T @ other.K.T, other.K @ (other.R @ camera.center + other.t)
    u, v, w = (start[:, k, None].astype(np.float32) + np.float32(moved[k]) * q for k in range(3))
    with np.errstate(divide="ignore", invalid="ignore"):
        u, v = u / w * np.float32(mask.shape[1] / other.width), v / w * np.float32(mask.shape[0] / other.height)
    seen = (w > 0) & (u >= 0) & (v >= 0) & (u < mask.shape[1]) & (v < mask.shape[0])
    held = seen & mask[np.where(seen, v, 0).astype(np.int64), np.where(seen, u, 0).astype(np.int64)]
    apart = camera.center - other.center
    square, along = (rays**2).sum(axis=1)[:, None].astype(np.float32), (rays @ apart)[:, None].astype(np.float32)
    dot = square + along * q
    length = np.sqrt(square * np.maximum(square + 2 * along * q + np.float32(apart @ apart) * q * q, 1e-30))
    return seen, held, dot / length
