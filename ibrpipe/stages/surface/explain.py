"""How much of the pictures a surface explains: the measure by which one way to a surface is chosen over another."""

from __future__ import annotations

import numpy as np

from ibrpipe.embree import MeshCaster
from ibrpipe.stages.surface.maps import LoadedMap, MapStore
from ibrpipe.types import Mesh

#: maps that are asked
_MAPS = 12


def explained(mesh: Mesh, maps: MapStore, tolerance: float) -> float:
    """Return the share of the masks' pixels that a surface explains, over at most twelve maps.

    A pixel with confirmed depth is explained by a front of the surface within `tolerance` (scene units) of that depth,
    one without depth by any front.
    """
    caster, right, pixels = MeshCaster(mesh), 0, 0
    for number, each in enumerate(maps):
        if number % max(1, -(-len(maps) // _MAPS)):
            continue
        inside = each.mask >= 0.5
        right += int(_explains(caster, each, tolerance)[inside].sum())
        pixels += int(inside.sum())
    return right / max(pixels, 1)


def _explains(caster: MeshCaster, each: LoadedMap, tolerance: float) -> np.ndarray:
    hits, height, width = caster.cast_camera(each.camera), *each.depth.shape
    x, y = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    rays = np.stack([x, y, np.ones_like(x)], axis=-1) @ each.camera.world_from_pixel.T
    front = (hits.face >= 0) & ((hits.normal * rays).sum(axis=2) < 0)
    return front & ((each.depth == 0) | (np.abs(hits.t - each.depth) <= tolerance))
