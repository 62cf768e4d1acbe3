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


def test_one_halving_equals_a_scan_of_four():
    rng = np.random.default_rng(3)
    meta = quadtree.plan_levels(5, 3)
    nodes = np.zeros(meta[-1, 0] + 1, np.uint32)
    low = rng.integers(0, 1000, 15)
    cells = np.where(rng.random(15) < 0.4, quadtree.EMPTY, low | (low + 5) << 16).astype(np.uint32)
    nodes[:15] = cells
    quadtree.halve_bounds(nodes, meta, 1)
    np.testing.assert_array_equal(nodes[:15], cells)
    for j in range(3):
        for i in range(2):
            four = cells.reshape(5, 3)[2 * j : 2 * j + 2, 2 * i : 2 * i + 2].ravel()
            want = int((four & 0xFFFF).min()) | int((four >> 16).max()) << 16
            assert nodes[meta[1, 0] + 2 * j + i] == want


@pytest.mark.parametrize("shape", [(1, 1), (4, 7), (3, 0), (0, 3)])
def test_rows_are_measured_over_what_is_there(shape):
    rng = np.random.default_rng(5)
    height = rng.random(shape).astype(np.float32)
    height[rng.random(shape) < 0.3] = np.nan
    height[-1:] = np.nan
    near, far = np.empty(shape[0], np.float32), np.empty(shape[0], np.float32)
    quadtree.measure_heights(height, near, far)
    for row, least, greatest in zip(height, near, far, strict=True):
        some = row[np.isfinite(row)]
        assert (least, greatest) == ((some.min(), some.max()) if len(some) else (np.inf, -np.inf))
