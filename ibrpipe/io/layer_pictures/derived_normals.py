"""Normals had from depth: the plane through every sample and its neighbours of the same layer."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ibrpipe.core.coding.slopes import slopes
from ibrpipe.io.layer_pictures.planes import Plane
from ibrpipe.types import Array, Camera, ParallelFrame

#: depth per texel's width that is still one surface, as the renderer `ldi` takes it
_STEEPEST = 4.0


def derived_normals(frame: ParallelFrame | Camera, depth: Array, planes: Sequence[Plane]) -> Array:
    """Return unit normals (S, 3) float64, world, that face the frame, of depths (S,).

    A plane is linear in depth over a parallel frame, and in 1 / depth over a perspective one.
    """
    perspective = isinstance(frame, Camera)
    values = 1.0 / depth.astype(np.float64) if perspective else depth.astype(np.float64)
    found = np.zeros((len(depth), 3))
    for plane in planes:
        picture = np.zeros(plane.there.shape)
        picture[plane.there] = values[plane.samples]
        slope = slopes(picture, plane.there, _steepest(frame), perspective)[plane.there]
        found[plane.samples] = _tilted(frame, plane, slope, values[plane.samples])
    return found


def _steepest(frame: ParallelFrame | Camera) -> float:
    if isinstance(frame, Camera):
        return _STEEPEST / float(min(frame.K[0, 0], frame.K[1, 1]))
    return _STEEPEST * float(max(np.linalg.norm(frame.a), np.linalg.norm(frame.b)))


def _tilted(frame: ParallelFrame | Camera, plane: Plane, slope: Array, values: Array) -> Array:
    """Return the normals (n, 3) of planes with such slopes (n, 2) through such values (n,)."""
    if isinstance(frame, Camera):
        v, u = np.nonzero(plane.there)
        u, v = u + plane.box[1].start + 0.5, v + plane.box[0].start + 0.5
        start = values - slope[:, 0] * u - slope[:, 1] * v  # 1 / depth at pixel (0, 0)
        local = -np.column_stack([slope, start])
        normal = local @ np.linalg.inv(frame.world_from_pixel)
    else:
        local = np.column_stack([slope, -np.ones(len(slope))])
        normal = local @ np.linalg.inv(np.column_stack([frame.a, frame.b, frame.f]))
    return normal / np.linalg.norm(normal, axis=1, keepdims=True)
