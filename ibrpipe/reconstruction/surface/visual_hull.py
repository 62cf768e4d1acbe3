"""The surface that outlines alone leave: the visual hull (laurentini1994), from signed distances."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ibrpipe.core.reconstruction.tsdf import SIDE
from ibrpipe.errors import CaptureError
from ibrpipe.reconstruction.surface.silhouettes import Outline, bounds_at, hull_box, least_photos
from ibrpipe.reconstruction.surface.tsdf import VOXEL_BYTES, VOXELS, Blocks, blocks_of, extract
from ibrpipe.types import Array, Mesh

#: blocks whose distances are found at a time
_AT_A_TIME = 512


def hull_surface(outlines: Sequence[Outline], voxel_pixels: float, memory: int) -> tuple[Mesh, float]:
    """Carve the surface out of the masks; also return the size of its voxels.

    Parameters
    ----------
    outlines : sequence of Outline
    voxel_pixels : float
        Size of a voxel in pixels of the middle photo; larger where `memory` (bytes) asks for it.

    Raises
    ------
    CaptureError
        There are no masks, or they have nothing in common.
    """
    if not outlines:
        raise CaptureError("a hull needs a mask for every photo; add masks, or choose another geometry.surface.method")
    low, high = hull_box(outlines)
    camera, most = outlines[len(outlines) // 2].camera, max(memory // (VOXEL_BYTES * VOXELS), 64)
    step = voxel_pixels * float(np.linalg.norm(camera.center - (low + high) / 2)) / camera.K[0, 0]
    marked = _blocks_near(low, high, step, outlines)
    while int(marked.sum()) > most:
        step *= 1.05 * float(marked.sum() / most) ** 0.5
        marked = _blocks_near(low, high, step, outlines)
    blocks = blocks_of(marked, low - step * SIDE, step)
    return extract(blocks, _distances(blocks, outlines)), step


def _blocks_near(low: Array, high: Array, step: float, outlines: Sequence[Outline]) -> Array:
    """Mark the blocks that the outlines' bound may pass."""
    size = step * SIDE
    shape = tuple(np.ceil((high - low) / size).astype(int) + 2)
    center = low - size + size * (np.argwhere(np.ones(shape, bool)) + 0.5)
    bound, count = bounds_at(center, outlines)
    return ((np.abs(bound) <= 1.25 * size) & (count >= least_photos(outlines))).reshape(shape)


def _distances(blocks: Blocks, outlines: Sequence[Outline]) -> Array:
    inner = np.stack(np.meshgrid(*[np.arange(SIDE)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    value, least = np.empty((len(blocks.corners), VOXELS), np.float32), least_photos(outlines)
    for first in range(0, len(value), _AT_A_TIME):
        corners = blocks.corners[first : first + _AT_A_TIME]
        points = blocks.origin + blocks.step * (corners[:, None, :] + inner).reshape(-1, 3)
        bound, count = bounds_at(points, outlines)
        value[first : first + _AT_A_TIME] = np.where(count >= least, np.minimum(bound / blocks.step, 8.0), 8.0).reshape(
            -1, VOXELS
        )
    return value
