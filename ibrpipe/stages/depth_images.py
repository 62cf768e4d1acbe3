"""Perspective depth images as an asset: of a mesh, what the cameras of `frusta` see; of photos, those with depth maps.

Source: schaufler1999, sec. 7.1.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ibrpipe.embree import MeshCaster
from ibrpipe.stages.frusta import Frustum
from ibrpipe.stages.reliefs import _clay
from ibrpipe.types import Array, Asset, Camera, DepthImage, LayeredDepthImage, Mesh, SpiralTexture


def depth_images_asset(mesh: Mesh, frusta: Sequence[Frustum], size: int, made_from: str) -> Asset:
    """Return an asset with one perspective image, one sample per pixel, for each frustum."""
    caster = MeshCaster(mesh)
    names = [f"map_{k:02d}" for k in range(len(frusta))]
    return _asset([_layers(caster, frustum.camera(size)) for frustum in frusta], names, made_from)


def asset_of_views(images: Sequence[DepthImage], names: Sequence[str], made_from: str) -> Asset:
    """Return an asset of depth images as they are: one sample per pixel with depth, normals unknown."""
    return _asset([_single(image) for image in images], names, made_from)


def _asset(layers: Sequence[LayeredDepthImage], names: Sequence[str], made_from: str) -> Asset:
    info = {
        "textures": [{"name": name} for name in names],
        "units": "scene units",
        "provenance": {"made": "ibrpipe depth-images", "from": made_from},
    }
    return Asset(tuple(SpiralTexture(each) for each in layers), info)


def _single(image: DepthImage) -> LayeredDepthImage:
    there = np.isfinite(image.depth)
    normal = np.full((int(there.sum()), 3), np.nan, np.float32)
    count = np.ones(len(normal), np.int32)
    return LayeredDepthImage(image.camera, _offsets(there), image.depth[there], image.color[there], normal, count)


def _offsets(there: Array) -> Array:
    """(H, W + 1) offsets of one sample in every pixel that is set in `there` (H, W)."""
    ends = np.cumsum(there, dtype=np.int64).reshape(there.shape)
    return np.concatenate([np.r_[0, ends[:-1, -1]][:, None], ends], axis=1)


def _layers(caster: MeshCaster, camera: Camera) -> LayeredDepthImage:
    hits = caster.cast_camera(camera)
    ways = np.stack(np.meshgrid(np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5), axis=-1)
    ways = np.concatenate([ways, np.ones((*ways.shape[:2], 1))], axis=-1) @ camera.world_from_pixel.T
    normal = caster.flat_normals[np.maximum(hits.face, 0)]
    there = np.isfinite(hits.t) & (hits.face >= 0) & ((ways * normal).sum(axis=-1) < 0)
    count = np.ones(int(there.sum()), np.int32)
    return LayeredDepthImage(camera, _offsets(there), hits.t[there], _clay(normal[there]), normal[there], count)
