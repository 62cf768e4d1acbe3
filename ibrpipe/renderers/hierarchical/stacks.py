"""Stacks of slices as arrays: what one part has at one resolution, and what all parts have together."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ibrpipe.core.hierarchy import prefilter as kernels
from ibrpipe.types import Array


@dataclass(frozen=True)
class Stacks:
    """Slices of one part at one resolution: boxes (D, K, 4), heights (D, K, 2), means (D, K, 12), texels (N, 12)."""

    part: int
    boxes: Array
    heights: Array
    means: Array
    texels: Array


def packed_stacks(part: int, dense: Array, heights: Array) -> Stacks:
    """Keep of dense texels (D, K, R, R, 12) what covers something; heights (D, K, 2)."""
    boxes = np.empty((*dense.shape[:2], 4), np.int32)
    kernels.trim(dense, boxes)
    sizes = boxes[..., 2].astype(np.int64) * boxes[..., 3]
    offsets = (np.cumsum(sizes) - sizes.ravel()).reshape(sizes.shape)
    texels, means = np.empty((int(sizes.sum()), kernels.TEXEL), np.uint8), np.empty((*sizes.shape, 12), np.float32)
    kernels.pack(dense, boxes, offsets, texels, means)
    return Stacks(part, boxes, heights, means, texels)


def join_stacks(stacks: list[Stacks], directions: int) -> tuple[Array, Array, Array, Array, Array]:
    """Stacks of all parts, by part, resolution, direction -> first slabs, slabs, heights, means, texels."""
    counts, slabs, heights, means = [np.zeros(1, np.int64)], [], [], []
    base = 0
    for each in stacks:
        kept = each.boxes[..., 2] > 0
        sizes = each.boxes[..., 2].astype(np.int64) * each.boxes[..., 3]
        firsts = base + np.cumsum(sizes) - sizes.ravel()
        bordered = np.where(kept, (each.boxes[..., 2] + 2) * (each.boxes[..., 3] + 2), 0).astype(np.int64)
        within = np.cumsum(bordered, axis=1) - bordered
        rows = np.concatenate(
            [
                each.boxes.reshape(-1, 4),
                firsts[:, None],
                within.reshape(-1, 1),
                np.full((sizes.size, 1), each.part),
            ],
            axis=1,
        )
        counts.append(kept.sum(axis=1))
        slabs.append(rows[kept.ravel()])
        heights.append(each.heights[kept])
        means.append(each.means[kept])
        base += len(each.texels)
    texels = [each.texels for each in stacks]
    return (
        np.cumsum(np.concatenate(counts), dtype=np.int64),
        np.concatenate([np.zeros((0, 7), np.int64), *slabs]).astype(np.int64),
        np.concatenate([np.zeros((0, 2), np.float32), *heights]),
        np.concatenate([np.zeros((0, 12), np.float32), *means]),
        np.concatenate([np.zeros((0, 12), np.uint8), *texels]),
    )
