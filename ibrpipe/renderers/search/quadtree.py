"""Min/max pyramids over fields for the ray search (``search="quadtree"``), built when that search is first asked for.

Layered images are split into sheets (first patch of every cell, second, ...), each with its own pyramid, because a
range shared by two layers would prune nothing.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ibrpipe.core.ldi import patches, quadtree
from ibrpipe.core.ldi.search import search_field
from ibrpipe.renderers.fields import Field, HeightField, PatchField, Pose
from ibrpipe.types import Array, Camera

_NO_HEIGHT = np.empty((0, 0), np.float32)
_NO_CELLS = np.empty(0, np.int32)


@dataclass(frozen=True, eq=False)
class Sheet:
    """One layer of cells with its pyramid.

    Attributes
    ----------
    pose : Pose
    box : (4,) float64
        Columns and rows of cells, least and greatest depth.
    grid : (2,) float64
        Lowest depth of the bounds and steps per depth.
    nodes, meta : see :mod:`ibrpipe.core.ldi.quadtree`
    leaves : (height, cells, corners, masks)
        Texel heights of a height field (then `cells` is empty), or the patch of every cell (-1 = none).
    base : int
        Number of the first patch or cell.
    """

    pose: Pose
    box: Array
    grid: Array
    nodes: Array
    meta: Array
    leaves: tuple[Array, Array, Array, Array]
    base: int

    def search(self, camera: Camera, depth: Array, ids: Array) -> None:
        """Lower `depth` (h, w) float32 and `ids` (h, w) uint32 where this sheet is hit nearer."""
        if not self.box[2] <= self.box[3]:
            return
        front = bool(len(self.leaves[1]))
        window = np.array([0, camera.width, 0, camera.height])
        pyramid = (self.nodes, self.meta, self.grid)
        search_field(
            self.pose.field_from_pixel(camera), self.box, pyramid, self.leaves, front, window, self.base, depth, ids
        )  # fmt: skip


def build_sheets(field: Field, base: int) -> list[Sheet]:
    """Build the pyramids of one field whose patches or cells are numbered from `base` on."""
    if isinstance(field, HeightField):
        return [_height_sheet(field, base)]
    return _patch_sheets(field, base)


def _grid(near: float, far: float, pose: Pose) -> tuple[Array, float, float]:
    """Return ((low, scale), least, greatest): the depth range padded, so that its ends are never grazed.

    Depths of perspective frames are -1/z and stay below 0, which is infinity.
    """
    if not near <= far:
        return np.array([0.0, 1.0]), 1.0, 0.0
    pad = 1e-4 * (far - near) + 4.0 * float(np.spacing(np.float32(max(abs(near), abs(far))))) + pose.slack
    low, high = pose.limited(near, far, pad)
    return np.array([low, quadtree.STEPS / (high - low)]), low, high


def _height_sheet(field: HeightField, base: int) -> Sheet:
    height = field.height
    near, far = np.empty(len(height), np.float32), np.empty(len(height), np.float32)
    quadtree.measure_heights(height, near, far)
    grid, low, high = _grid(float(near.min()), float(far.max()), field.pose)
    rows, columns = height.shape[0] - 1, height.shape[1] - 1
    meta = quadtree.plan_levels(rows, columns)
    nodes = np.empty(meta[-1, 0] + 1, np.uint32)
    quadtree.pack_heights(height, grid[0], grid[1], nodes)
    quadtree.build_levels(nodes, meta)
    leaves = (height, _NO_CELLS, np.empty((0, 4), np.float32), np.empty(0, np.uint8))
    return Sheet(field.pose, np.array([columns, rows, low, high]), grid, nodes, meta, leaves, base)


def _patch_sheets(field: PatchField, base: int) -> list[Sheet]:
    near, far = np.empty(len(field.corners)), np.empty(len(field.corners))
    patches.measure_patches(field.corners, field.masks, near, far)
    sheets = []
    for chosen in _ranks(field.cells[:, 0].astype(np.int64) + field.cells[:, 1].astype(np.int64) * 2**31, near + far):
        first = field.cells[chosen].min(axis=0)
        column, row = (field.cells[chosen] - first).T
        cells = np.full((row.max() + 1, column.max() + 1), -1, np.int32)
        cells[row, column] = chosen
        grid, low, high = _grid(float(near[chosen].min()), float(far[chosen].max()), field.pose)
        meta = quadtree.plan_levels(*cells.shape)
        nodes = np.empty(meta[-1, 0] + 1, np.uint32)
        patches.pack_patches(cells.ravel(), near, far, grid[0], grid[1], nodes)
        quadtree.build_levels(nodes, meta)
        box = np.array([cells.shape[1], cells.shape[0], low, high])
        leaves = (_NO_HEIGHT, cells.ravel(), field.corners, field.masks)
        sheets.append(Sheet(_moved(field.pose, first), box, grid, nodes, meta, leaves, base))
    return sheets


def _moved(pose: Pose, first: Array) -> Pose:
    """Return the pose whose cell (0, 0) is cell `first` (column, row)."""
    linear, shift = pose.linear.copy(), pose.shift.copy()
    for axis in range(2):
        linear[axis] -= first[axis] * linear[3]
        shift[axis] -= first[axis] * shift[3]
    return replace(pose, linear=linear, shift=shift)


def _ranks(cell: Array, depth: Array) -> list[Array]:
    """Return the patches of each sheet: of every cell the nearest, the second nearest, and so on."""
    order = np.lexsort((depth, cell))
    new = np.r_[True, np.diff(cell[order]) > 0][: len(order)]
    starts = np.flatnonzero(new)
    rank = np.arange(len(order)) - np.repeat(starts, np.diff(np.r_[starts, len(order)]))
    return [order[rank == k] for k in range(int(rank.max(initial=-1)) + 1)]
