"""Perspective depth images of a mesh as an asset: what the cameras of `frusta` see. Source: schaufler1999, sec. 7.1."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ibrpipe.embree import MeshCaster
from ibrpipe.stages.frusta import Frustum
from ibrpipe.stages.reliefs import _clay
from ibrpipe.types import Asset, Camera, LayeredDepthImage, Mesh, SpiralTexture


def depth_images_asset(mesh: Mesh, frusta: Sequence[Frustum], size: int, made_from: str) -> Asset:
    """Return an asset with one perspective image, one sample per pixel, for each frustum."""
    caster = MeshCaster(mesh)
    textures = tuple(SpiralTexture(_layers(caster, frustum.camera(size))) for frustum in frusta)
    info = {
        "textures": [{"name": f"map_{k:02d}"} for k in range(len(frusta))],
        "units": "scene units",
        "provenance": {"made": "ibrpipe depth-images", "from": made_from},
    }
    return Asset(textures, info)


def _layers(caster: MeshCaster, camera: Camera) -> LayeredDepthImage:
    hits = caster.cast_camera(camera)
    ways = np.stack(np.meshgrid(np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5), axis=-1)
    ways = np.concatenate([ways, np.ones((*ways.shape[:2], 1))], axis=-1) @ camera.world_from_pixel.T
    normal = caster.flat_normals[np.maximum(hits.face, 0)]
    there = np.isfinite(hits.t) & (hits.face >= 0) & ((ways * normal).sum(axis=-1) < 0)
    ends = np.cumsum(there, dtype=np.int64).reshape(there.shape)
    offsets = np.concatenate([np.r_[0, ends[:-1, -1]][:, None], ends], axis=1)
    count = np.ones(int(there.sum()), np.int32)
    return LayeredDepthImage(camera, offsets, hits.t[there], _clay(normal[there]), normal[there], count)
