"""Texture coordinates for meshes that bring none: wrapped round an axis, round a point, or laid on from the sides.

One texture is laid once round the mesh (cylinder, sphere) or once along its longest side (planar, box), with square
texels on average; seams of tiled textures fit when they are repeated a whole number of times.
"""

from __future__ import annotations

import numpy as np

from ibrpipe.errors import ValueRangeError
from ibrpipe.types import Array, Mesh

PROJECTIONS = ("cylinder", "sphere", "planar", "box")
AXES = {"x": 0, "y": 1, "z": 2}


def map_mesh(mesh: Mesh, projection: str, up: str = "y") -> Array:
    """Return (F, 3, 2) float64 texture coordinates, u to the right and v downward seen from outside.

    Parameters
    ----------
    projection : {"cylinder", "sphere", "planar", "box"}
    up : {"x", "y", "z"}
        Axis of the cylinder and sphere, and the direction from which a planar map is laid on.
    """
    if projection not in PROJECTIONS or up not in AXES:
        choices = f"file, {', '.join(PROJECTIONS)} and x, y, z"
        raise ValueRangeError(f"uv is {projection!r} with up {up!r}; choose among {choices}")
    axis = AXES[up]
    first, second = (axis + 1) % 3, (axis + 2) % 3
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    points = (mesh.vertices - 0.5 * (low + high))[mesh.faces]
    size = float((high - low).max()) or 1.0
    if projection in ("planar", "box"):
        return _laid_on(mesh, points, size, axis if projection == "planar" else None)
    radius = np.hypot(points[..., first], points[..., second])
    u = np.arctan2(points[..., second], points[..., first]) / (2 * np.pi)
    pole = radius < 1e-6 * size
    u += np.round(np.take_along_axis(u, pole.argmin(axis=1)[:, None], 1) - u)  # near the first that is no pole
    others = np.where(pole, 0.0, u).sum(axis=1, keepdims=True) / np.maximum((~pole).sum(axis=1, keepdims=True), 1)
    u = np.where(pole, others, u)
    if projection == "cylinder":
        mean = max(float(radius.mean()), 1e-6 * size)
        fall = -points[..., axis] / (2 * np.pi * mean)
    else:
        fall = 0.5 * np.arctan2(radius, points[..., axis]) / np.pi
    return np.ascontiguousarray(np.stack([u, fall], axis=-1))


def _laid_on(mesh: Mesh, points: Array, size: float, axis: int | None) -> Array:
    from ibrpipe.core.normals import face_normals

    normals = face_normals(mesh.vertices, mesh.faces)
    main = np.abs(normals).argmax(axis=1) if axis is None else np.full(len(points), axis)
    rows = np.arange(len(points))
    sign = np.sign(normals[rows, main]) if axis is None else np.ones(len(points))
    across = points[rows[:, None], np.arange(3), ((main + 1) % 3)[:, None]]
    up = points[rows[:, None], np.arange(3), ((main + 2) % 3)[:, None]]
    sign = np.where(sign == 0, 1.0, sign)[:, None]
    return np.ascontiguousarray(np.stack([sign * across, -up], axis=-1) / size + 0.5)
