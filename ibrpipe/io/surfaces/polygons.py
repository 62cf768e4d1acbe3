"""Polygons into triangles: fans where they are right, ears cut off where a polygon is not convex."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ibrpipe.types import Array


def wrong_as_fans(points: Array, polygons: Sequence[Array]) -> list[int]:
    """Return which polygons a fan from their first corner would cut wrongly.

    Parameters
    ----------
    points : (V, 3) float64
    polygons : sequence of (n,) int
        Indices into `points`, n at least 3.
    """
    if isinstance(polygons, np.ndarray) and polygons.ndim == 2:
        return [int(row) for row in np.flatnonzero(~_fan_is_right(points[polygons]))]
    sizes = np.array([len(polygon) for polygon in polygons], np.int64)
    found: list[int] = []
    for size in np.unique(sizes[sizes > 3]):
        rows = np.flatnonzero(sizes == size)
        corners = points[np.array([polygons[int(row)] for row in rows], np.int64)]
        found += rows[~_fan_is_right(corners)].tolist()
    return sorted(found)


def cut_ears(corners: Array) -> Array:
    """Cut one polygon into triangles that stay inside it.

    Parameters
    ----------
    corners : (n, 3) float64
        Nearly in one plane, in order.

    Returns
    -------
    (n - 2, 3) int64
        Which corners the triangles have, turning as the polygon does; fewer rows where corners lie on a line.
    """
    import mapbox_earcut

    count = len(corners)
    normal = _normals(corners[None])[0]
    fan = np.array([(0, n, n + 1) for n in range(1, count - 1)], np.int64)
    if not (np.linalg.norm(normal) > 0 and np.isfinite(normal).all()):
        return fan
    normal /= np.linalg.norm(normal)
    first = np.cross(np.eye(3)[np.abs(normal).argmin()], normal)
    first /= np.linalg.norm(first)
    flat = np.stack([corners @ first, corners @ np.cross(normal, first)], axis=1)  # the polygon turns to the left there
    found = np.asarray(mapbox_earcut.triangulate_float64(flat, np.array([count], np.uint32)), np.int64).reshape(-1, 3)
    if not len(found):
        return fan
    one, two = flat[found[:, 1]] - flat[found[:, 0]], flat[found[:, 2]] - flat[found[:, 0]]
    right = one[:, 0] * two[:, 1] - one[:, 1] * two[:, 0] < 0
    found[right] = found[right][:, ::-1]
    return found


def _normals(corners: Array) -> Array:
    """Newell's normals of polygons (m, n, 3), twice their areas long."""
    local = corners - corners[:, :1]
    return np.cross(local, np.roll(local, -1, axis=1)).sum(axis=1)


def _fan_is_right(corners: Array) -> Array:
    """Whether no triangle of the fan of a polygon (m, n, 3) turns against the polygon."""
    normals = _normals(corners)
    spokes = corners[:, 1:] - corners[:, :1]
    turns = (np.cross(spokes[:, :-1], spokes[:, 1:]) * normals[:, None]).sum(axis=2)
    return (turns >= -1e-9 * (normals**2).sum(axis=1, keepdims=True)).all(axis=1)
