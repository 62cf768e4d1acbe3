"""What renderers are given to render, and points whose box encloses it."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np

from ibrpipe.types.arrays import Array
from ibrpipe.types.asset import Asset
from ibrpipe.types.camera import Camera, ParallelFrame
from ibrpipe.types.relief_mesh import ReliefMesh
from ibrpipe.types.texture import Texture
from ibrpipe.types.textures import DepthImage, LayeredDepthImage, ReliefTexture

#: a surface as depths on a grid of texels
GridSource = ReliefTexture | DepthImage | LayeredDepthImage | Texture

#: everything that is rendered as one source; assets and lists are rendered as the sources that they hold
Renderable = GridSource | ReliefMesh

#: captured things that a part of a scene may hold beside its meshes
Captured: TypeAlias = Renderable | Asset


def enclosing_points(source: Captured) -> Array:
    """Return points (N, 3) float64 whose axis-parallel box holds all of the source; none where it is empty."""
    if isinstance(source, Asset):
        found = [enclosing_points(texture) for texture in source.textures]
        return np.concatenate([np.zeros((0, 3)), *found])
    if isinstance(source, Texture):
        return enclosing_points(source.layers)
    if isinstance(source, ReliefMesh):
        vertices = source.mesh.vertices
        return np.concatenate([vertices - source.thickness, vertices + source.thickness])
    if isinstance(source, LayeredDepthImage):
        return _corners(source.frame, source.shape, source.depth)
    if isinstance(source, DepthImage):
        return _corners(source.camera, source.depth.shape, source.depth)
    return _corners(source.frame, source.height.shape, source.height)


def _corners(frame: ParallelFrame | Camera, shape: tuple[int, ...], depth: Array) -> Array:
    """Corners (8, 3) of the frustum of a grid of `shape` texels between its least and greatest depth."""
    known = depth[np.isfinite(depth)].astype(np.float64)
    if known.size == 0:
        return np.zeros((0, 3))
    v, u, d = (each.ravel() for each in np.meshgrid((0, shape[0]), (0, shape[1]), (known.min(), known.max())))
    if isinstance(frame, Camera):
        rays = np.stack([u, v, np.ones(len(u))], axis=1) @ frame.world_from_pixel.T
        return frame.center + rays * d[:, None]
    return frame.origin + np.stack([u, v, d], axis=1) @ frame.world_from_local.T
