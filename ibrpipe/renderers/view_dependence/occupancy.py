"""Grids of voxels by which mirrors pass over most sheets that a ray cannot meet."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ibrpipe.core.reflection import occupancy
from ibrpipe.types import Array

#: voxels of a grid at most, about, and their least width in texels
VOXELS, WIDTH = 300_000, 2.0
#: sheets that have a bit of their own; those beyond share them
BITS = 62


@dataclass(frozen=True, eq=False)
class Occupancy:
    """Which sheets rays may meet.

    Attributes
    ----------
    frame : (4,) float64
        Least corner of the grid in the world, width of a voxel.
    cells : (X, Y, Z) int32
        Number of a voxel in `bits` and `cones`; -1 = nothing reaches it.
    free : (8, X, Y, Z) uint8
        Cubes of voxels that hinder no ray of an octant.
    bits : (C,) int64
        Sheets that reach into the voxel.
    cones : (C, 4) float64
        Axis, and sine of the half angle, of a cone that holds all normals there; sine 2 = no such cone.
    always : int
        Sheets that every ray may meet, as bits.
    """

    frame: Array
    cells: Array
    free: Array
    bits: Array
    cones: Array
    always: int

    @property
    def bytes(self) -> int:
        """Bytes held."""
        return sum(part.nbytes for part in self.grid)

    @property
    def grid(self) -> tuple[Array, Array, Array, Array, Array]:
        """The grid as kernels take it."""
        return self.frame, self.cells, self.free, self.bits, self.cones

    def find_sheets(self, rays: Array) -> Array:
        """Sheets (N,) int64, as bits, that rays (N, 6) float64, origin and direction, may meet."""
        found = np.empty(len(rays), np.int64)
        occupancy.find_sheets(rays, self.grid, self.always, found)
        return found


def bit(number: int) -> int:
    """The bit of a sheet."""
    return 1 << number % BITS


def build_occupancy(sheets: Sequence[tuple[Array, int, tuple[Array, ...]]], texel: float) -> Occupancy:
    """Build the grid of sheets, each (pose (4, 4), columns, leaves); `texel` in scene units."""
    poses = [(np.ascontiguousarray(pose), np.linalg.inv(pose), columns, leaves) for pose, columns, leaves in sheets]
    bounds, always = np.array([[np.inf] * 3, [-np.inf] * 3]), 0
    for number, sheet in enumerate(poses):
        if occupancy.bound_sheet(*sheet, bounds):
            always |= bit(number)
    frame, size = _lay_out(bounds, texel)
    cells = np.full(size, -1, np.int32)
    count, bits, sums = _mark(poses, frame, cells)
    length = np.linalg.norm(sums, axis=1, keepdims=True)
    axes, cosines = np.divide(sums, length, out=np.zeros_like(sums), where=length > 0), np.ones(count)
    for sheet in poses:
        occupancy.open_cones(*sheet, frame, cells, axes, cosines)
    sines = np.where(cosines > 0, np.sqrt(np.maximum(1 - cosines**2, 0)) + occupancy.SLACK, 2.0)
    cones, free = np.column_stack([axes, sines]), np.empty((8, *size), np.uint8)
    occupancy.measure_free(cells, cones, free)
    return Occupancy(frame, cells, free, bits, cones, always)


def _lay_out(bounds: Array, texel: float) -> tuple[Array, tuple[int, int, int]]:
    """Frame and size of a grid over bounds (2, 3)."""
    if not np.isfinite(bounds).all():
        return np.array([0.0, 0.0, 0.0, 1.0]), (1, 1, 1)
    span = np.maximum(bounds[1] - bounds[0], WIDTH * texel)
    width = max(float(np.cbrt(span.prod() / VOXELS)), WIDTH * texel)
    x, y, z = (int(each) for each in np.ceil(span / width + 2 * occupancy.MARGIN) + 1)
    return np.append(bounds[0] - 0.5 * width, width), (x, y, z)


def _mark(
    poses: list[tuple[Array, Array, int, tuple[Array, ...]]], frame: Array, cells: Array
) -> tuple[int, Array, Array]:
    """Number the voxels that are reached: their count, bits (C,) and sums of normals (C, 3)."""
    room = cells.size
    bits, sums, count = np.zeros(room, np.int64), np.zeros((room, 3)), 0
    for number, sheet in enumerate(poses):
        count = occupancy.mark_sheet(*sheet, frame, bit(number), cells, count, bits, sums)
    return count, bits[:count].copy(), sums[:count].copy()
