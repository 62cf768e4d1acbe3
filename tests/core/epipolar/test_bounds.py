"""Bounds of blocks, built in bands and above them, against a plain scan of every block."""

from __future__ import annotations

import numpy as np
import pytest

from ibrpipe.core.epipolar import bounds
from ibrpipe.core.ldi.quadtree import EMPTY, plan_levels

LOW, SCALE = -2.1, 65535 / 5.2


def check(nodes, meta, near, far):
    """Compare with the least and greatest of near, far (rows, columns), NaN where a cell is empty."""
    for level, (first, stride, count) in enumerate(meta):
        for j in range(count):
            for i in range(stride):
                block = slice(j << level, (j + 1) << level), slice(i << level, (i + 1) << level)
                low, high, node = near[block].ravel(), far[block].ravel(), int(nodes[first + j * stride + i])
                low, high = low[~np.isnan(low)], high[~np.isnan(high)]
                if not len(low):
                    assert node == EMPTY
                    continue
                least, greatest = (low.min() - LOW) * SCALE, (high.max() - LOW) * SCALE
                assert node & 0xFFFF <= least <= (node & 0xFFFF) + 1.02
                assert (node >> 16) - 1.02 <= greatest <= node >> 16


@pytest.mark.parametrize("shape", [(2, 2), (9, 6), (66, 3), (131, 4)])
def test_blocks_of_heights(shape):
    rng = np.random.default_rng(0)
    height = (rng.random(shape) * 5 - 2).astype(np.float32)
    height[rng.random(shape) < 0.1] = np.nan
    meta = plan_levels(shape[0] - 1, shape[1] - 1)
    nodes = np.full(meta[-1, 0] + 1, 7, np.uint32)
    bounds.bound_heights(height, LOW, SCALE, meta, nodes)
    bounds.bound_above(nodes, meta)
    four = np.stack([height[:-1, :-1], height[:-1, 1:], height[1:, :-1], height[1:, 1:]]).astype(float)
    check(nodes, meta, four.min(axis=0), four.max(axis=0))


@pytest.mark.parametrize("shape", [(1, 1), (5, 7), (130, 2)])
@pytest.mark.parametrize("most", [0, 3])
def test_blocks_of_patches(shape, most):
    rng = np.random.default_rng(1)
    counts = rng.integers(0, most + 1, shape)
    starts = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
    near = rng.random(starts[-1]) * 3 - 2
    far = near + rng.random(len(near))
    meta = plan_levels(*shape)
    nodes = np.full(meta[-1, 0] + 1, 7, np.uint32)
    bounds.bound_patches(starts, near, far, LOW, SCALE, meta, nodes)
    bounds.bound_above(nodes, meta)
    least, greatest = np.full(counts.size, np.nan), np.full(counts.size, np.nan)
    for cell in np.flatnonzero(counts.ravel()):
        own = slice(starts[cell], starts[cell + 1])
        least[cell], greatest[cell] = near[own].min(), far[own].max()
    check(nodes, meta, least.reshape(shape), greatest.reshape(shape))
