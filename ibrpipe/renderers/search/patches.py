"""The patches of all layered images of a source, laid out in blocks as the projecting search takes them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ibrpipe.core.ldi.project import BLOCK
from ibrpipe.renderers.fields import PatchField
from ibrpipe.types import Array

#: cells of a tile along u and v: patches of one tile of one layer lie together
TILE = 16


@dataclass(frozen=True, eq=False)
class Blocks:
    """Patches in blocks of BLOCK; see :func:`ibrpipe.core.ldi.project.project_patches`."""

    corners: Array
    cells: Array
    masks: Array
    numbers: Array
    blocks: Array
    bounds: Array

    @property
    def patches(self) -> tuple[Array, Array, Array, Array]:
        """Corners, cells, masks and numbers, as the kernel takes them."""
        return self.corners, self.cells, self.masks, self.numbers


def pack_blocks(fields: Sequence[PatchField]) -> Blocks:
    """Lay out the patches of `fields`, which are numbered in that order."""
    firsts = np.cumsum([0] + [len(field.corners) for field in fields])
    parts = [_pack_field(n, field, int(first)) for n, (field, first) in enumerate(zip(fields, firsts, strict=False))]
    return Blocks(*(np.concatenate(column) for column in zip(*parts, strict=True)))


def _pack_field(number: int, field: PatchField, base: int) -> tuple[Array, ...]:
    order = _order(field.cells.astype(np.int64))
    count = -(-len(order) // BLOCK)
    counts = np.minimum(BLOCK, len(order) - BLOCK * np.arange(count))
    chosen = np.concatenate([order, np.repeat(order[-1:], count * BLOCK - len(order))]).reshape(count, BLOCK)
    corners = np.ascontiguousarray(field.corners[chosen].transpose(0, 2, 1))
    cells = np.ascontiguousarray(field.cells[chosen].transpose(0, 2, 1), np.float32)
    return (
        corners,
        cells,
        field.masks[chosen],
        (chosen + base).astype(np.uint32),
        np.stack([np.full(count, number), counts], axis=1).astype(np.int64),
        _bounds(corners.astype(np.float64), cells.astype(np.float64)),
    )


def _order(cells: Array) -> Array:
    """Return the order of patches (P, 2): by layer within their cell, then by tile, then by cell."""
    column, row = cells.T
    width = int(column.max(initial=0)) + 1
    cell = row * width + column  # ascending, equal for the patches of one cell
    new = np.flatnonzero(np.diff(cell, prepend=-1))
    layer = np.arange(len(cell)) - np.repeat(new, np.diff(new, append=len(cell)))
    tiles = -(-width // TILE)
    height = int(row.max(initial=0)) // TILE + 1
    key = ((layer * height + row // TILE) * tiles + column // TILE) * TILE**2 + row % TILE * TILE + column % TILE
    return np.argsort(key, kind="stable")


def _bounds(corners: Array, cells: Array) -> Array:
    """Return (B, 10) float64: least and greatest u, v, depth, slope along u and slope along v of every block."""
    a, b, c, e = corners.transpose(1, 0, 2)
    parts = (
        (cells[:, :1], cells[:, :1] + 1.0),
        (cells[:, 1:], cells[:, 1:] + 1.0),
        (corners, corners),
        (np.stack([b - a, e - c], 1),) * 2,
        (np.stack([c - a, e - b], 1),) * 2,
    )
    ends = [(low.min(axis=(1, 2)), high.max(axis=(1, 2))) for low, high in parts]
    return np.stack([end for pair in ends for end in pair], axis=1)
