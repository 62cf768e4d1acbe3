"""Surfaces one behind another: what is seen past samples that fill only a part of their texel.

Where the nearest hit does not cover a pixel, the next ones behind it are found too, all in one search.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ibrpipe.core.ldi.mix import mix_levels
from ibrpipe.renderers.pixel_grid import PixelGrid
from ibrpipe.renderers.scene import Hits, Scene, shade_hits
from ibrpipe.renderers.search.epipolar_lines import cast_map
from ibrpipe.renderers.search.projection import project_behind
from ibrpipe.types import Array, Camera

#: levels behind the nearest at the most; light that must still come through for another one
MOST, LEAST = 4, 1 / 64
#: nothing is hit beyond this floor
_CLOSED = np.iinfo(np.int64).max


@dataclass(frozen=True, eq=False)
class Level:
    """Hits of one level: depth (H, W) float32 (+inf = none), ids (H, W) uint32, colour (H, W, 3), coverage `known`."""

    depth: Array
    ids: Array
    color: Array
    known: Array


def levels_behind(scene: Scene, camera: Camera, nearest: Level) -> list[Level]:
    """Find what is seen behind the nearest hits, level by level; pixels that show no more have no hit there."""
    through = np.where(nearest.known > 0, 1.0 - nearest.known, np.float32(0.0))
    if not (through > LEAST).any():
        return []
    floors = (nearest.depth.view(np.int32).astype(np.int64) << 32) | nearest.ids
    depths, ids = project_behind(scene, camera, np.where(through > LEAST, floors, _CLOSED).ravel(), MOST)
    solid = _heights(scene, camera)
    if solid is not None:  # what height fields hide is not seen; they cover all
        for level in range(MOST):
            nearer = (through > LEAST) & (solid.depth <= depths[level]) & (solid.depth > nearest.depth)
            depths[level][nearer], ids[level][nearer] = solid.depth[nearer], solid.ids[nearer]
    return shade_levels(scene, camera, depths, ids, through)


def shade_levels(
    scene: Scene, camera: Camera, depths: Array, ids: Array, through: Array, grid: PixelGrid | None = None
) -> list[Level]:
    """Shade hits (L, H, W) one behind another as far as light comes through those before; at least the first.

    Parameters
    ----------
    through : (H, W) float32
        Light that comes through what is before the first.
    grid : PixelGrid, optional
        Where rays pass through the picture, as for `shade_hits`.
    """
    found = list[Level]()
    for level, own in zip(depths, ids, strict=True):
        depth = np.where(through > LEAST, level, np.float32(np.inf))
        if found and not np.isfinite(depth).any():
            break
        color, known = shade_hits(scene, Hits(depth, own), camera, grid)
        found.append(Level(depth, own, color, known))
        through = np.where(known > 0, through * (1.0 - known), np.float32(0.0))
    return found


def _heights(scene: Scene, camera: Camera) -> Hits | None:
    """Nearest hits of the height fields alone; None where there are none."""
    if not scene.heights:
        return None
    depth = np.full((camera.height, camera.width), np.inf, np.float32)
    ids = np.full(depth.shape, 2**32 - 1, np.uint32)
    for one in scene.maps:
        cast_map(one, camera, depth, ids)
    return Hits(depth, ids)


def mix(levels: Sequence[Level], texel: float) -> Level:
    """Put levels, nearest first, together; see :mod:`ibrpipe.core.ldi.mix`. A single one is returned as it is.

    Parameters
    ----------
    texel : hits less apart are one surface, scene units
    """
    first = levels[0]
    if len(levels) == 1:
        return first
    depths, known, colors = (np.stack([getattr(each, name) for each in levels]) for name in ("depth", "known", "color"))
    depth, covered, color = np.empty_like(first.depth), np.empty_like(first.known), np.empty_like(first.color)
    mix_levels(depths, known, colors, np.float32(texel), depth, covered, color)
    return Level(depth, first.ids, color, covered)
