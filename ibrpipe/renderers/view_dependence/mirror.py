"""What a surface of layered images mirrors: positions and normals of hits, reflected rays, and what these meet.

The surface is the very one that is drawn: reflected rays meet the same patches as the rays of pixels.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ibrpipe.core.reflection.geometry import place_hits, reflect
from ibrpipe.core.reflection.model import TRAITS
from ibrpipe.core.reflection.voxels import cast_rays
from ibrpipe.renderers.fields import Pose
from ibrpipe.renderers.scene import Scene
from ibrpipe.renderers.view_dependence.voxel_grid import VoxelGrid, build_grid, outline_patches
from ibrpipe.types import Array

#: reflected rays start this far above the surface, and meet nothing nearer than this, in texels
LIFT, CLEAR = 0.3, 2.0


@dataclass(frozen=True, eq=False)
class Surface:
    """The surface of layered images as mirrors need it.

    Attributes
    ----------
    records : (P, 8) int32, as `Scene.records`
    corners : (P, 4) int32
        Samples of every patch whose colour is known; -1 = none.
    poses : (F, 4, 4) float64, homogeneous field coordinates from world, one per layered image
    normals : (S, 3) float32, unit, world
    depths, masks : (P, 4) float32 field depths of every patch's corners, (P,) uint8 which of them are samples
    texel : float
        Scene units.
    grid : VoxelGrid
        Finds the patches that a ray may meet.
    """

    records: Array
    corners: Array
    poses: Array
    normals: Array
    depths: Array
    masks: Array
    texel: float
    grid: VoxelGrid

    @property
    def shapes(self) -> tuple[Array, Array, Array]:
        """The patches as :mod:`ibrpipe.core.reflection.voxels` takes them."""
        return self.poses, self.depths, self.masks


@dataclass(frozen=True, eq=False)
class Looks:
    """Looks at N positions of a surface.

    Attributes
    ----------
    where, traits : see :mod:`ibrpipe.core.reflection.model`
        Weight and observed colour are not set; the mirrored colour is NaN.
    points, normals, reflected : (N, 3) float64
        Places and unit vectors in the world; NaN where no normal is known.
    """

    where: Array
    traits: Array
    points: Array
    normals: Array
    reflected: Array


def make_surface(scene: Scene, normals: Array) -> Surface:
    """Gather what mirrors need of the layered images of a scene.

    Parameters
    ----------
    scene : Scene
    normals : (S, 3) float32, unit, world
        Of all samples, in the order of `Scene.records`; NaN where nothing mirrors.
    """
    records, colors = scene.records
    known = np.append(colors[:, 3] > 0, False)
    corners = np.where(known[records[:, 4:]], records[:, 4:], -1).astype(np.int32)
    poses = np.stack([matrix(field.pose) for _, field in scene.patches])
    fields = [field for _, field in scene.patches]
    parts = [outline_patches(pose, field.cells, field.corners) for pose, field in zip(poses, fields, strict=True)]
    return Surface(
        records,
        corners,
        poses,
        np.ascontiguousarray(normals, np.float32),
        np.concatenate([field.corners for field in fields]),
        np.concatenate([field.masks for field in fields]),
        scene.texel,
        build_grid(parts, scene.texel),
    )


def matrix(pose: Pose) -> Array:
    """(4, 4) float64: homogeneous field coordinates from (X, 1)."""
    return np.concatenate([pose.linear, (pose.shift - pose.linear @ pose.origin)[:, None]], axis=1)


def look(surface: Surface, points: Array, patches: Array, eyes: Array, size: int) -> Looks:
    """Look from `eyes` at positions on patches.

    Parameters
    ----------
    points : (N, 3) float64, world
    patches : (N,) int64; -1 = none
    eyes : (N, 3) or (3,) float64, world
    size : int
        Cells along a table's edge.
    """
    count = len(points)
    where, traits = np.zeros((count, 2), np.int32), np.zeros((count, TRAITS), np.float32)
    where[:, 0], traits[:, 9:] = np.maximum(patches, 0), np.nan
    points, normals, reflected = np.ascontiguousarray(points), np.empty((count, 3)), np.empty((count, 3))
    place_hits(points, patches, surface.records, surface.poses, surface.normals, traits, normals)
    toward = eyes - points
    toward /= np.linalg.norm(toward, axis=1, keepdims=True)
    reflect(normals, toward, size, where, traits, reflected)
    return Looks(where, traits, points, normals, reflected)


def meet_surface(surface: Surface, seen: Looks, size: int) -> tuple[Array, Looks]:
    """Follow the reflected rays: indices (M,) int64 of those that meet the surface, and the looks at what they meet."""
    able = np.flatnonzero(np.isfinite(seen.reflected[:, 0]))
    directions = seen.reflected[able]
    start = seen.points[able] + LIFT * surface.texel * seen.normals[able] + CLEAR * surface.texel * directions
    t, patches = cast(surface, start, directions)
    met = np.flatnonzero(patches >= 0)
    ends = start[met] + t[met, None] * directions[met]
    return able[met], look(surface, ends, patches[met], seen.points[able[met]], size)


def cast(surface: Surface, origins: Array, directions: Array) -> tuple[Array, Array]:
    """Nearest fronts that rays (N, 3) meet: (N,) float64 in lengths of the direction, +inf = none; (N,) int64 patch."""
    rays = np.ascontiguousarray(np.concatenate([origins, directions], axis=1))
    t, patches = np.empty(len(rays)), np.empty(len(rays), np.int64)
    cast_rays(rays, surface.grid.packed, surface.shapes, t, patches)
    return t, patches
