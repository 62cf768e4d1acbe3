"""Points from the pixels where cameras see them. Source: hartley2004, section 12.2 (linear triangulation)."""

from __future__ import annotations

import numpy as np


def triangulate_point(poses, seen):
    """Least-squares point that cameras see in given directions.

    Parameters
    ----------
    poses : (V, 3, 4) float64
        cam_from_world, at least two.
    seen : (V, 2) float64
        Where each camera sees the point, on its plane z = 1.

    Returns
    -------
    (3,) float64
        World; NaN where the cameras do not fix it.
    """
    rows = np.concatenate([seen[:, :1] * poses[:, 2] - poses[:, 0], seen[:, 1:] * poses[:, 2] - poses[:, 1]])
    rows /= np.linalg.norm(rows[:, :3], axis=1, keepdims=True)
    _, size, axes = np.linalg.svd(rows)
    point = axes[3]
    if size[2] < 1e-9 * size[0] or abs(point[3]) < 1e-12 * np.abs(point).max():
        return np.full(3, np.nan)
    return point[:3] / point[3]


def triangulate_agreed(poses, seen, limit):
    """Point that most cameras agree on: the worst one is dropped as long as it is off by more than `limit`.

    Parameters
    ----------
    poses : (V, 3, 4) float64
    seen : (V, 2) float64
    limit : float
        Largest distance on the plane z = 1.

    Returns
    -------
    point : (3,) float64
        NaN where fewer than two cameras agree.
    kept : (V,) bool
    """
    kept = np.ones(len(poses), bool)
    while kept.sum() >= 2:
        point = triangulate_point(poses[kept], seen[kept])
        off = distances(point, poses, seen)
        off[~kept] = -1.0
        if np.isnan(point).any() or off.max() <= limit:
            break
        kept[off.argmax()] = False
    if kept.sum() < 2 or np.isnan(point).any():
        return np.full(3, np.nan), np.zeros(len(poses), bool)
    return point, kept


def distances(point, poses, seen):
    """How far from `seen` each camera sees `point`, on its plane z = 1; infinity behind a camera, (V,) float64."""
    local = poses[:, :, :3] @ point + poses[:, :, 3]
    with np.errstate(divide="ignore", invalid="ignore"):
        off = np.linalg.norm(local[:, :2] / local[:, 2:] - seen, axis=1)
    return np.where(local[:, 2] > 0, off, np.inf)
