"""The pyramid's bounds against a plain scan of every block."""

from __future__ import annotations

import numpy as np
import pytest

from ibrpipe.core.ldi import quadtree


@pytest.mark.parametrize("shape", [(2, 2), (3, 9), (17, 33), (16, 5)])
def test_every_block_holds_its_heights(shape):
    rng = np.random.default_rng(0)
    height = (rng.random(shape) * 5 - 2).astype(np.float32)
    height[rng.random(shape) < 0.1] = np.nan
    rows, columns = shape[0] - 1, shape[1] - 1
    low, scale = -2.1, 65535 / 5.2
    meta = quadtree.plan_levels(rows, columns)
    nodes = np.empty(meta[-1, 0] + 1, np.uint32)
    quadtree.pack_heights(height, low, scale, nodes)
    quadtree.build_levels(nodes, meta)
    cells = np.stack([height[:-1, :-1], height[:-1, 1:], height[1:, :-1], height[1:, 1:]])
    for level, (first, stride, count) in enumerate(meta):
        for j in range(count):
            for i in range(stride):
                node = int(nodes[first + j * stride + i])
                least, greatest = node & 0xFFFF, node >> 16
                block = cells[:, j << level : (j + 1) << level, i << level : (i + 1) << level].reshape(4, -1)
                whole = block[:, np.isfinite(block).all(axis=0)]
                if whole.size == 0:
                    assert node == quadtree.EMPTY
                    continue
                near, far = (float(whole.min()) - low) * scale, (float(whole.max()) - low) * scale
                assert least <= near <= least + 1.02
                assert greatest - 1.02 <= far <= greatest


def test_levels_end_in_one_block():
    meta = quadtree.plan_levels(5, 9)
    assert meta[:, 1].tolist() == [9, 5, 3, 2, 1]
    assert meta[:, 2].tolist() == [5, 3, 2, 1, 1]
    assert meta[1:, 0].tolist() == np.cumsum(meta[:-1, 1] * meta[:-1, 2]).tolist()
