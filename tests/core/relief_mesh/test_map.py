"""Pyramids of bounds over depth layers: every node against the texels below it."""

from __future__ import annotations

import numpy as np
import pytest
from kernel_runs import on_all_thread_counts

from ibrpipe.core.relief_mesh.map import HEAD, bound_blocks, bound_cells, build_bounds, count_nodes, plan_levels

SHAPES = [(1, 1), (1, 7), (5, 3), (8, 8), (13, 6)]


@pytest.mark.parametrize("least", [True, False])
@pytest.mark.parametrize("shape", SHAPES)
def test_cells_are_bounded_by_their_corners(shape, least):
    grid = np.random.default_rng(1).random((shape[0] + 1, shape[1] + 1)).astype(np.float32)
    out = np.full(shape[0] * shape[1] + 2, -7, np.float32)
    (found,) = on_all_thread_counts(lambda: (bound_cells(grid, least, out), out.copy())[1:])
    corners = np.stack([grid[:-1, :-1], grid[:-1, 1:], grid[1:, :-1], grid[1:, 1:]])
    np.testing.assert_array_equal(found[:-2].reshape(shape), corners.min(axis=0) if least else corners.max(axis=0))
    assert (found[-2:] == -7).all()  # the other levels' share is left alone


@pytest.mark.parametrize("least", [True, False])
@pytest.mark.parametrize("shape", SHAPES)
def test_blocks_are_bounded_by_all_their_cells(shape, least):
    plan = plan_levels(*shape, True)
    cells = np.random.default_rng(2).random(shape).astype(np.float32)
    out = np.empty(count_nodes(plan), np.float32)
    out[: cells.size] = cells.ravel()
    for level in range(1, plan[2] + 1):
        bound_blocks(plan, level, least, out)
        first, across, size = plan[HEAD + 2 * level], plan[HEAD + 2 * level + 1], 1 << level
        for j, i in np.ndindex(-(-shape[0] // size), across):
            block = cells[j * size : (j + 1) * size, i * size : (i + 1) * size]
            assert out[first + j * across + i] == (block.min() if least else block.max())


def test_the_coarsest_bound_is_that_of_all_texels():
    grid = np.random.default_rng(3).random((7, 10)).astype(np.float32)
    plan = plan_levels(6, 9, False)
    assert build_bounds(grid, plan, True)[-1] == grid.min()
    assert build_bounds(grid, plan, False)[-1] == grid.max()
