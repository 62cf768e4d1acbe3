"""Similarities between worlds: found from points or from camera poses, and applied to both. Source: umeyama1991.

A similarity is ``(scale, R, t)``: a point x of the old world is ``scale * R @ x + t`` in the new one.
"""

from __future__ import annotations

import numpy as np


def fit_points(old, new):
    """Least-squares similarity that takes points to points.

    Parameters
    ----------
    old, new : (N, 3) float64
        At least three, not on one line (see `spread`).

    Returns
    -------
    scale : float
    R : (3, 3) float64
    t : (3,) float64
    """
    old_mean, new_mean = old.mean(axis=0), new.mean(axis=0)
    left, size, right = np.linalg.svd((new - new_mean).T @ (old - old_mean))
    flip = np.array([1.0, 1.0, np.sign(np.linalg.det(left @ right))])
    R = (left * flip) @ right
    scale = float((size * flip).sum() / ((old - old_mean) ** 2).sum())
    return scale, R, new_mean - scale * (R @ old_mean)


def fit_poses(old, new):
    """Similarity that takes cameras to cameras: rotation from their attitudes, scale and shift from their centres.

    Parameters
    ----------
    old, new : (N, 3, 4) float64
        cam_from_world, at least one. Scale is 1 where all centres are one.
    """
    rotations = np.einsum("nji,njk->ik", new[:, :, :3], old[:, :, :3])
    left, _, right = np.linalg.svd(rotations)
    R = (left * np.array([1.0, 1.0, np.sign(np.linalg.det(left @ right))])) @ right
    a, b = centers(old), centers(new)
    a_mean, b_mean = a.mean(axis=0), b.mean(axis=0)
    size = ((a - a_mean) ** 2).sum()
    scale = float((((a - a_mean) @ R.T) * (b - b_mean)).sum() / size) if size > 0 else 1.0
    scale = scale if scale > 0 else 1.0
    return scale, R, b_mean - scale * (R @ a_mean)


def fit_cameras(old, new):
    """Similarity by the centres of cameras where these fix it, else by their poses; (N, 3, 4) each."""
    a, b = centers(old), centers(new)
    if len(a) >= 3 and min(spread(a), spread(b)) > 0.02:
        return fit_points(a, b)
    return fit_poses(old, new)


def spread(points):
    """Second largest extent of points over the largest: 0 for one point or points on a line."""
    size = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return float(size[1] / size[0]) if len(size) > 1 and size[0] > 0 else 0.0


def centers(poses):
    """Centres (N, 3) of cameras (N, 3, 4)."""
    return -np.einsum("nji,nj->ni", poses[:, :, :3], poses[:, :, 3])


def move_points(similarity, points):
    """Apply a similarity to points (N, 3)."""
    scale, R, t = similarity
    return scale * (points @ R.T) + t


def move_poses(similarity, poses):
    """Apply a similarity to the world of cameras (N, 3, 4); their pictures stay the same."""
    scale, R, t = similarity
    turned = poses[:, :, :3] @ R.T
    shift = scale * poses[:, :, 3] - turned @ t
    return np.concatenate([turned, shift[:, :, None]], axis=2)


def rotation_angle_deg(one, other):
    """Angles in degrees between rotations (N, 3, 3); exact for small ones too."""
    delta = one @ np.swapaxes(other, 1, 2)
    axis = np.stack(
        [delta[:, 2, 1] - delta[:, 1, 2], delta[:, 0, 2] - delta[:, 2, 0], delta[:, 1, 0] - delta[:, 0, 1]], axis=1
    )
    trace = delta[:, 0, 0] + delta[:, 1, 1] + delta[:, 2, 2]
    return np.degrees(np.arctan2(np.linalg.norm(axis, axis=1), trace - 1.0))


def direction_angle_deg(one, other):
    """Angles in degrees between unit vectors (N, 3); exact for small ones too."""
    return np.degrees(2.0 * np.arcsin(np.minimum(np.linalg.norm(one - other, axis=-1) / 2.0, 1.0)))
