"""Signed distances on sparse blocks around the points, from depth maps and, where masks are given, outlines."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ibrpipe.core.reconstruction.surface_nets import SIDE, join_quads, mark_cells, place_vertices
from ibrpipe.core.reconstruction.tsdf import integrate
from ibrpipe.errors import CaptureError
from ibrpipe.progress import Step
from ibrpipe.reconstruction.depth.map_store import LoadedMap, MapStore, pack
from ibrpipe.reconstruction.surface.silhouettes import Outline, chosen_bound
from ibrpipe.types import Array, Mesh

DISTANCES = Step("sum distances", 0.4)
VOXELS = SIDE**3
#: bytes a voxel takes while distances are summed, extracted and joined
VOXEL_BYTES = 32


@dataclass(frozen=True, eq=False)
class Blocks:
    """Blocks of voxels.

    Attributes
    ----------
    origin : (3,) float64
        Position of voxel (0, 0, 0), world.
    step : float
        Size of a voxel, scene units.
    corners : (B, 3) int32
        First voxel of every block.
    grid : (GX, GY, GZ) int32
        Number of the block, -1 = none.
    """

    origin: Array
    step: float
    corners: Array
    grid: Array

    def lattice(self) -> Array:
        """Origin and step as the kernels read them."""
        return np.array([*self.origin, self.step], np.float64)


def blocks_around(points: Array, low: Array, high: Array, step: float, reach: float) -> Blocks:
    """Choose the blocks within `reach` of the points inside the box from `low` to `high`."""
    size = step * SIDE
    origin = low - size
    count = np.maximum(np.ceil((high - origin) / size).astype(np.int64) + 1, 1)
    marked = np.zeros(count, bool)
    for corner in np.ndindex(3, 3, 3):
        moved = points + (np.array(corner) - 1) * reach
        index = np.floor((moved - origin) / size).astype(np.int64)
        index = index[((index >= 0) & (index < count)).all(axis=1)]
        marked[tuple(index.T)] = True
    return blocks_of(marked, origin, step)


def blocks_of(marked: Array, origin: Array, step: float) -> Blocks:
    """Number the marked blocks of a grid."""
    grid = np.full(marked.shape, -1, np.int32)
    grid[marked] = np.arange(int(marked.sum()), dtype=np.int32)
    return Blocks(origin, step, (np.argwhere(marked) * SIDE).astype(np.int32), grid)


@dataclass(frozen=True)
class Weights:
    """How depth maps add up.

    Attributes
    ----------
    truncation : float
        In voxels.
    carve : float
        Weight of voxels far in front of a surface, relative to those near it.
    rays : float
        Weight of the rays that must pass a voxel far from any surface for it to be empty.
    """

    truncation: float = 4.0
    carve: float = 0.2
    rays: float = 1.5


def summed(blocks: Blocks, maps: MapStore, outlines: Sequence[Outline], weights: Weights) -> Array:
    """Average the maps' signed distances: (B, 512) float32 in truncation lengths, positive outside, NaN = unknown.

    Parameters
    ----------
    blocks : Blocks
    maps : MapStore
    outlines : sequence of Outline
        One for each map, at its size, or none. No surface lies outside them.
    weights : Weights
    """
    count = len(blocks.corners)
    total, free = np.zeros((count, VOXELS, 2), np.float32), np.zeros((count, VOXELS), np.float32)
    bound = np.full((free.size if outlines else 0, 2), -np.inf, np.float32)
    length = weights.truncation * blocks.step
    for index, each in enumerate(DISTANCES.track(maps, len(maps))):
        p = pack([each])
        seen = np.abs((each.normal * _toward(each)).sum(axis=2)).ravel()
        limits = np.array([length, each.camera.K[0, 0]], np.float64)
        outline = outlines[index].distance.ravel() if outlines else np.empty(0, np.float32)
        integrate(
            blocks.corners, blocks.lattice(), p.depth, p.normal, (p.confidence * seen).astype(np.float32), outline,
            p.cameras, limits, total, free, bound,
        )  # fmt: skip
    outer = np.clip(chosen_bound(bound, len(outlines)).reshape(free.shape) / length, -1, 1) if outlines else None
    return _settled(total, free, outer, weights)


def _settled(total: Array, free: Array, outer: Array | None, weights: Weights) -> Array:
    """Decide every voxel: surfaces near it first, then rays that pass it; none outside the outlines; NaN = unknown."""
    near, passed = total[..., 1], weights.carve * free
    with np.errstate(invalid="ignore", divide="ignore"):
        value = (total[..., 0] + passed) / (near + passed)
    lonely = near <= 0  # no surface in reach: empty only where several rays pass
    value = np.where(lonely, np.where(free >= weights.rays, np.float32(1), np.float32(np.nan)), value)
    if outer is not None:
        known = np.isfinite(outer)
        value = np.where(known, np.maximum(value, outer), value)
    return value.astype(np.float32)


def _toward(each: LoadedMap) -> Array:
    rays = each.camera.pixel_rays()
    return rays / np.linalg.norm(rays, axis=2, keepdims=True)


def extract(blocks: Blocks, value: Array) -> Mesh:
    """Turn signed distances (B, 512), NaN = unknown, into the mesh of their zero surface.

    Raises
    ------
    CaptureError
        There is no surface.
    """
    marked = np.empty(value.shape, np.uint8)
    mark_cells(blocks.corners, blocks.grid, value, marked)
    vertex = np.full(value.shape, -1, np.int32)
    count = int(marked.sum())
    if count == 0:
        raise CaptureError("the depth maps agree on no surface; look at their overlap, or give a mesh")
    vertex[marked > 0] = np.arange(count, dtype=np.int32)
    position = np.empty((count, 3), np.float64)
    place_vertices(blocks.corners, blocks.grid, value, vertex, position)
    faces = np.empty((6 * count, 3), np.int32)
    found = join_quads(blocks.corners, blocks.grid, value, vertex, faces)
    if found == 0:
        raise CaptureError("the depth maps agree on no surface; look at their overlap, or give a mesh")
    return Mesh(blocks.origin + blocks.step * position, faces[:found])
