"""Uniform grids of voxels in which mirrors find the patches that a ray may meet."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ibrpipe.core.reflection import voxels
from ibrpipe.types import Array

#: voxels of a grid at most, about, and their least width in texels
VOXELS, WIDTH = 300_000, 2.0
#: added to the sine of a cone's half angle
SLACK = 1e-5


@dataclass(frozen=True, eq=False)
class Outlines:
    """Where patches lie in the world.

    Attributes
    ----------
    cells : (P, 2) int32, column and row
    points, normals : (P, 4, 3) float64
        Corners, and unit normals there. A patch lies in the hull of its corners, and its normals in the cone of those
        there, in either kind of frame.
    placed : (P,) bool
        False where a corner has no position, such as one beyond infinity.
    """

    cells: Array
    points: Array
    normals: Array
    placed: Array


@dataclass(frozen=True, eq=False)
class VoxelGrid:
    """Which patches rays may meet; see :mod:`ibrpipe.core.reflection.voxels`.

    Attributes
    ----------
    frame : (4,) float64
        Least corner of the grid in the world, width of a voxel.
    cells : (X, Y, Z) int32
        Number of a voxel's record; -1 = nothing reaches it.
    free : (8, X, Y, Z) uint8
        Cubes of voxels that hinder no ray of an octant.
    hulls : (C, 6) float64
        Axis and sine of the half angle of a cone that holds all normals, slab across the axis that holds all patches.
    starts, listed : (C + 1,) int64, (L, 4) int32
        Number, field, column and row of the patches that reach into every voxel, ascending.
    loose : (K, 4) int32
        Those that every ray may meet.
    """

    frame: Array
    cells: Array
    free: Array
    hulls: Array
    starts: Array
    listed: Array
    loose: Array

    @property
    def bytes(self) -> int:
        """Bytes held."""
        return sum(part.nbytes for part in self.packed)

    @property
    def packed(self) -> tuple[Array, ...]:
        """The grid as kernels take it."""
        return self.frame, self.cells, self.free, self.hulls, self.starts, self.listed, self.loose


def outline_patches(pose: Array, cells: Array, corners: Array) -> Outlines:
    """Find where the patches of one field lie.

    Parameters
    ----------
    pose : (4, 4) float64
        Homogeneous field coordinates from (X, 1).
    cells : (P, 2) int32, column and row
    corners : (P, 4) float32, field depths
    """
    depth = corners.astype(np.float64)
    a, b, c, e = depth.T
    at = np.stack([cells[:, :1] + [0, 1, 0, 1], cells[:, 1:] + [0, 0, 1, 1], depth, np.ones_like(depth)], axis=-1)
    with np.errstate(all="ignore"):
        points = at @ np.linalg.inv(pose).T
        weight = points[..., 3]
        rise_u, rise_v = np.stack([b - a, b - a, e - c, e - c], axis=1), np.stack([c - a, e - b, c - a, e - b], axis=1)
        rest = rise_u * at[..., 0] + rise_v * at[..., 1] - depth
        normals = np.stack([rise_u, rise_v, -np.ones_like(depth), -rest], axis=-1) @ pose[:, :3]
        length = np.sqrt((normals**2).sum(axis=-1))
        placed = ((weight > 0) & (weight < np.inf) & (length > 0) & (length < np.inf)).all(axis=1)
        return Outlines(cells, points[..., :3] / weight[..., None], normals / length[..., None], placed)


def build_grid(parts: Sequence[Outlines], texel: float) -> VoxelGrid:
    """Build the grid of fields whose patches are numbered one after the other; `texel` in scene units."""
    placed = np.concatenate([np.zeros(0, bool), *(part.placed for part in parts)])
    points = np.concatenate([np.zeros((0, 4, 3)), *(part.points[part.placed] for part in parts)])
    normals = np.concatenate([np.zeros((0, 4, 3)), *(part.normals[part.placed] for part in parts)])
    frame, size = _lay_out(points, texel)
    points = (points - frame[:3]) / frame[3]
    patch, voxel = _reached(points, size)
    cells = np.full(int(np.prod(size)), -1, np.int32)
    found, starts = np.unique(voxel, return_index=True)
    cells[found] = np.arange(len(found))
    hulls = _hulls(points, normals, patch, starts, np.diff(starts, append=len(voxel)))
    cells, free = cells.reshape(size), np.empty((8, *size), np.uint8)
    voxels.measure_free(cells, hulls, free)
    fields = np.repeat(np.arange(len(parts)), [len(part.cells) for part in parts])
    cell = np.concatenate([np.zeros((0, 2), np.int32), *(part.cells for part in parts)])
    tags = np.column_stack([np.arange(len(placed)), fields, cell]).astype(np.int32)
    ends = np.append(starts, len(voxel)).astype(np.int64)
    return VoxelGrid(frame, cells, free, hulls, ends, tags[placed][patch], tags[~placed])


def _lay_out(points: Array, texel: float) -> tuple[Array, tuple[int, int, int]]:
    """Frame and size of a grid over points (P, 4, 3)."""
    if len(points) == 0:
        return np.array([0.0, 0.0, 0.0, 1.0]), (1, 1, 1)
    least = points.min(axis=(0, 1))
    span = np.maximum(points.max(axis=(0, 1)) - least, WIDTH * texel)
    width = max(float(np.cbrt(span.prod() / VOXELS)), WIDTH * texel)
    x, y, z = (int(each) for each in np.ceil(span / width + 2 * voxels.MARGIN) + 1)
    return np.append(least - 0.5 * width, width), (x, y, z)


def _reached(points: Array, size: tuple[int, int, int]) -> tuple[Array, Array]:
    """List all pairs of a patch and a voxel that it may reach into, (L,) int64 each, by voxel and then by patch."""
    first = np.floor(points.min(axis=1) - voxels.MARGIN).astype(np.int64).clip(0, np.array(size) - 1)
    count = np.floor(points.max(axis=1) + voxels.MARGIN).astype(np.int64).clip(0, np.array(size) - 1) + 1 - first
    total = count.prod(axis=1)
    patch = np.repeat(np.arange(len(points)), total)
    index = np.arange(len(patch)) - np.repeat(np.cumsum(total) - total, total)
    _, high, deep = count[patch].T
    x, y, z = (first[patch] + np.stack([index // (high * deep), index // deep % high, index % deep], axis=1)).T
    voxel = (x * size[1] + y) * size[2] + z
    order = np.argsort(voxel, kind="stable")
    return patch[order], voxel[order]


def _hulls(points: Array, normals: Array, patch: Array, starts: Array, counts: Array) -> Array:
    """Cones and slabs (C, 6) of voxels whose patches are patch[start : start + count]."""
    if len(starts) == 0:
        return np.zeros((0, 6))
    sums = np.add.reduceat(normals.sum(axis=1)[patch], starts)
    length = np.linalg.norm(sums, axis=1, keepdims=True)
    axes = np.divide(sums, length, out=np.zeros_like(sums), where=length > 0)
    own = np.repeat(axes, counts, axis=0)[:, :, None]
    cosines = np.minimum.reduceat((normals[patch] @ own)[..., 0].min(axis=1), starts)
    heights = (points[patch] @ own)[..., 0]
    sines = np.where(cosines > 0, np.sqrt(np.maximum(1 - cosines**2, 0)) + SLACK, 2.0)
    least, greatest = np.minimum.reduceat(heights.min(axis=1), starts), np.maximum.reduceat(heights.max(axis=1), starts)
    return np.column_stack([axes, sines, least - voxels.MARGIN, greatest + voxels.MARGIN])
