"""Perspective depth images as an asset: of a mesh, what the cameras of `frusta` see; of photos, those with depth maps.

Source: schaufler1999, sec. 7.1.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ibrpipe.embree import MeshCaster
from ibrpipe.modelling.frusta import Frustum
from ibrpipe.modelling.mesh_colors import Painter, painter_of
from ibrpipe.types import Asset, Camera, DepthImage, LayeredDepthImage, Mesh, Texture
from ibrpipe.types.layers import single_layer
from ibrpipe.types.mesh import MeshColors


def depth_images_asset(
    mesh: Mesh, frusta: Sequence[Frustum], size: int, made_from: str, colors: MeshColors | None = None
) -> Asset:
    """Return an asset with one perspective image, one sample per pixel, for each frustum.

    `colors` are those of the mesh's faces; clay unless given.
    """
    caster = MeshCaster(mesh)
    painter = painter_of(caster, colors)
    names = [f"map_{k:02d}" for k in range(len(frusta))]
    return _asset([_layers(caster, painter, frustum.camera(size)) for frustum in frusta], names, made_from)


def asset_of_views(images: Sequence[DepthImage], names: Sequence[str], made_from: str) -> Asset:
    """Return an asset of depth images as they are: one sample per pixel with depth, normals unknown."""
    return _asset(
        [single_layer(each.camera, each.depth, each.color, observed=True) for each in images], names, made_from
    )


def _asset(layers: Sequence[LayeredDepthImage], names: Sequence[str], made_from: str) -> Asset:
    info = {
        "textures": [{"name": name} for name in names],
        "units": "scene units",
        "provenance": {"made": "ibrpipe depth-images", "from": made_from},
    }
    return Asset(tuple(Texture(each) for each in layers), info)


def _layers(caster: MeshCaster, painter: Painter, camera: Camera) -> LayeredDepthImage:
    hits, rays = caster.cast_camera(camera), camera.pixel_rays()
    normal = caster.flat_normals[np.maximum(hits.face, 0)]
    along = np.where(hits.face >= 0, (rays * normal).sum(axis=-1), 0.0)
    there = along > 0 if (along > 0).sum() > (along < 0).sum() else along < 0  # from within, what is seen from outside
    color, depth = np.zeros((*there.shape, 3), np.float32), hits.t[there]
    right, down = (depth[:, None] * camera.world_from_pixel[:, k] for k in (0, 1))
    color[there] = painter.at(hits.face[there], hits.uv[there], rays[there], (right, down))
    return single_layer(camera, np.where(there, hits.t, np.inf), color, normal, observed=True)
