"""The diffuse colour of any surface point, looked up in the layers that face it best (gong-yang, sec. 4.2)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ibrpipe.core.appearance.diffuse_lookup import lookup_diffuse
from ibrpipe.embree import MeshCaster
from ibrpipe.modelling.rectangles import Rectangle
from ibrpipe.types import Array, Camera, LayeredDepthImage


class DiffuseSource:
    """Layers of all textures, joined for the look-up."""

    def __init__(self, rectangles: Sequence[Rectangle], layers: Sequence[LayeredDepthImage]) -> None:
        self._rectangles = tuple(rectangles)
        self._projections = np.stack([_projection(layer) for layer in layers])
        self._texels = np.array([np.linalg.norm(r.u) / r.width for r in rectangles])
        self._offsets = tuple(layer.offsets for layer in layers)
        self._starts = np.concatenate([[0], np.cumsum([len(layer.depth) for layer in layers])])
        self._depth = np.concatenate([layer.depth for layer in layers])
        self._color = np.concatenate([layer.color for layer in layers])
        self._observers = np.concatenate(
            [np.ones(len(x.depth), np.int32) if x.observers is None else x.observers for x in layers]
        )

    def at(self, points: Array, normals: Array) -> Array:
        """Diffuse colour (N, 3) float32, linear, of world points (N, 3) with unit normals; NaN where none is known."""
        points = np.ascontiguousarray(points, np.float64)
        facing = np.stack([r.facing(points, normals) for r in self._rectangles], axis=1)
        color = np.empty((len(points), 3), np.float32)
        lookup_diffuse(
            points, facing, self._projections, self._texels, self._offsets, self._starts, self._depth, self._color,
            self._observers, color
        )  # fmt: skip
        return color


def diffuse_frame(caster: MeshCaster, diffuse: DiffuseSource, camera: Camera) -> tuple[Array, Array, Array]:
    """Diffuse colour (H, W, 3) float32 linear at the mesh's surface, depth (H, W) float32, and where it is known."""
    hits = caster.cast_camera(camera)
    hit = np.isfinite(hits.t)
    rays = camera.pixel_rays(camera.pixel_centers()[hit])
    points = camera.center + hits.t[hit][:, None].astype(np.float64) * rays
    found = diffuse.at(points, caster.smooth_normals(hits.face[hit], hits.uv[hit]))
    color, known = np.zeros((*hit.shape, 3), np.float32), np.zeros(hit.shape, bool)
    known[hit] = np.isfinite(found).all(axis=1)
    color[hit] = np.nan_to_num(found)
    return color, hits.t.astype(np.float32), known


def _projection(layers: LayeredDepthImage) -> Array:
    """(4, 4) float64, world to (u w, v w, depth, w)."""
    frame = layers.frame
    if isinstance(frame, Camera):
        x, y, z = frame.pixel_from_world
        return np.stack([x, y, z, z])
    rows = np.concatenate([frame.local_from_world, -(frame.local_from_world @ frame.origin)[:, None]], axis=1)
    return np.concatenate([rows, [[0.0, 0.0, 0.0, 1.0]]])
