"""Pictures of surfaces under shared reflection: diffuse texels, tables of reflected light, and the object in itself."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ibrpipe.core.reflection.directions import pad
from ibrpipe.core.reflection.model import CHANNELS, predict
from ibrpipe.renderers.view_dependence.mirror import Looks, Surface, look, meet_surface
from ibrpipe.types import Array, Camera

#: mirrored light of the object itself is cut here
BRIGHTEST = 1.5


@dataclass(frozen=True, eq=False)
class Model:
    """Shared reflection of a surface; see :mod:`ibrpipe.core.reflection.model`.

    Attributes
    ----------
    texels : (S, 3 or 3 + L) float32
        Square roots of linear diffuse light, then weights of the tables.
    tables : (L, n, n, 3) float32
        Square roots of linear reflected light.
    law : (2 + L,) float64
        Damping, Huber's bend, reflectances.
    """

    texels: Array
    tables: Array
    law: Array

    @property
    def size(self) -> int:
        """Cells along an edge of a table."""
        return int(self.tables.shape[1])

    @property
    def padded(self) -> Array:
        """(L, (n + 2)^2, 3) float32, as the kernels take the tables."""
        count, size = self.tables.shape[:2]
        return pad(self.tables).reshape(count, (size + 2) ** 2, CHANNELS)

    def colors(self, where: Array, traits: Array, corners: Array) -> Array:
        """Linear light (N, 3) float32 of looks; NaN where a patch has no known sample."""
        out = np.empty((len(where), 3), np.float32)
        predict(where, traits, corners, self.texels, self.padded, self.law, out)
        return out

    def own_light(self, where: Array, traits: Array, corners: Array) -> Array:
        """Linear light (M, 3) float32 that the object mirrors of itself; it mirrors the tables, but nothing further."""
        return np.minimum(np.nan_to_num(self.colors(where, traits, corners)), np.float32(BRIGHTEST))


def look_through(surface: Surface, camera: Camera, depth: Array, ids: Array, hit: Array, size: int) -> Looks:
    """Look at the hits of a picture's pixels.

    Parameters
    ----------
    depth, ids : (H, W) float32 along camera z, (H, W) uint32 patches
    hit : (H, W) bool
        Pixels to look at.
    """
    row, column = np.nonzero(hit)
    pixel = np.stack([column + 0.5, row + 0.5, np.ones(len(row))], axis=1)
    points = camera.center + depth[hit][:, None].astype(np.float64) * (pixel @ camera.world_from_pixel.T)
    return look(surface, points, ids[hit].astype(np.int64), camera.center, size)


def shade_looks(surface: Surface, model: Model, seen: Looks) -> Array:
    """Linear light (N, 3) float32 of looks, with the object's own mirror image; NaN where no colour is known."""
    if len(model.tables):
        met, ends = meet_surface(surface, seen, model.size)
        seen.traits[met, 9:] = model.own_light(ends.where, ends.traits, surface.corners)
    return model.colors(seen.where, seen.traits, surface.corners)
