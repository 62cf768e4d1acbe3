"""Kernels of the surface nets against dense NumPy: unknown voxels, missing blocks, no blocks, too small an output."""

from __future__ import annotations

import numpy as np
import pytest
import surface_twin as twin
from kernel_runs import on_all_thread_counts

from ibrpipe.core.reconstruction.surface_nets import SIDE, join_quads, mark_cells, place_vertices

VOXELS = SIDE**3


def field(seed, shape=(2, 1, 2), holes=0.03, missing=True):
    """(corners, grid, values (B, 512), dense with NaN where unknown) of a ball whose shell has holes."""
    rng = np.random.default_rng(seed)
    dense = np.indices([SIDE * size for size in shape]).astype(float)
    middle = np.array([SIDE * size / 2 + 0.3 for size in shape]).reshape(3, 1, 1, 1)
    dense = np.sqrt(((dense - middle) ** 2).sum(axis=0)) - 4.2
    dense[rng.random(dense.shape) < holes] = np.nan
    grid = np.full(shape, -1, np.int32)
    there = [place for place in np.ndindex(shape) if not (missing and place == (1, 0, 0))]
    values = np.empty((len(there), VOXELS), np.float32)
    for number, place in enumerate(there):
        grid[place] = number
        own = tuple(slice(SIDE * p, SIDE * p + SIDE) for p in place)
        values[number] = dense[own].ravel()
    for place in np.argwhere(grid < 0):
        dense[tuple(slice(SIDE * p, SIDE * p + SIDE) for p in place)] = np.nan
    return (np.array(there, np.int32) * SIDE), grid, values, dense.astype(np.float32)


def spread(corners, blocks, shape):
    """Blocks (B, 512) as one dense array, -1 elsewhere."""
    out = np.full(shape, -1, int)
    for corner, block in zip(corners, blocks):
        out[tuple(slice(c, c + SIDE) for c in corner)] = block.reshape(SIDE, SIDE, SIDE)
    return out


def numbered(corners, grid, values):
    """(marked, vertex) of all blocks."""
    marked = np.full(values.shape, 9, np.uint8)
    mark_cells(corners, grid, values, marked)
    vertex = np.full(values.shape, -1, np.int32)
    vertex[marked > 0] = np.arange(int(marked.sum()))
    return marked, vertex


@pytest.mark.parametrize("missing", [False, True])
def test_marked_cells_are_those_with_known_corners_of_both_signs(missing):
    corners, grid, values, dense = field(1, missing=missing)
    (marked,) = on_all_thread_counts(lambda: (numbered(corners, grid, values)[0],))
    padded = np.pad(dense, ((0, 1),) * 3, constant_values=np.nan)
    near = np.stack([padded[i : i + dense.shape[0], j : j + dense.shape[1], k : k + dense.shape[2]]
                     for i, j, k in np.ndindex(2, 2, 2)])  # fmt: skip
    wanted = np.isfinite(near).all(axis=0) & (near < 0).any(axis=0) & (near >= 0).any(axis=0)
    found = spread(corners, marked, dense.shape)
    np.testing.assert_array_equal(found == 1, wanted)
    assert set(np.unique(marked)) == {0, 1}
    assert wanted.sum() > 60


def test_vertices_stand_at_the_mean_of_their_crossings():
    corners, grid, values, dense = field(2)
    marked, vertex = numbered(corners, grid, values)
    place = np.full((int(marked.sum()), 3), np.nan)
    (found,) = on_all_thread_counts(lambda: (place_vertices(corners, grid, values, vertex, place), place.copy())[1:])
    wanted, _ = twin.surface_net(dense.astype(float))
    assert len(found) == len(wanted) > 60
    order = [np.lexsort(np.round(each, 4).T) for each in (found, wanted)]
    np.testing.assert_allclose(found[order[0]], wanted[order[1]], atol=1e-4)


def turned(faces):
    """Corners of faces, each turned to begin with its least, sorted."""
    return np.array(sorted(tuple(np.roll(face, -int(np.argmin(face)))) for face in faces))


def test_quads_join_the_cells_around_every_crossed_edge_once():
    corners, grid, values, dense = field(3)
    marked, vertex = numbered(corners, grid, values)
    place = np.empty((int(marked.sum()), 3))
    place_vertices(corners, grid, values, vertex, place)
    places, wanted = twin.surface_net(dense.astype(float))
    count = join_quads(corners, grid, values, vertex, np.empty((0, 3), np.int32))
    assert count == len(wanted) > 100
    faces = np.full((count, 3), -1, np.int32)
    assert join_quads(corners, grid, values, vertex, faces) == count
    near = np.linalg.norm(place[:, None] - places[None], axis=2)
    assert (near.min(axis=1) < 1e-4).all()
    np.testing.assert_array_equal(turned(near.argmin(axis=1)[faces]), turned(wanted))
    short = np.full((11, 3), -1, np.int32)  # what does not fit is counted, and nothing is written past the end
    assert join_quads(corners, grid, values, vertex, short) == count
    np.testing.assert_array_equal(short[:10], faces[:10])
    assert (short[10] == -1).all()


def test_no_blocks_and_nothing_known():
    none, grid = np.empty((0, 3), np.int32), np.full((1, 1, 1), -1, np.int32)
    empty, numbers = np.empty((0, VOXELS), np.float32), np.empty((0, VOXELS), np.int32)
    mark_cells(none, grid, empty, np.empty((0, VOXELS), np.uint8))
    place_vertices(none, grid, empty, numbers, np.empty((0, 3)))
    assert join_quads(none, grid, empty, numbers, np.empty((0, 3), np.int32)) == 0
    unknown = np.full((1, VOXELS), np.nan, np.float32)
    marked, vertex = numbered(np.zeros((1, 3), np.int32), np.zeros((1, 1, 1), np.int32), unknown)
    assert not marked.any()
    assert join_quads(np.zeros((1, 3), np.int32), np.zeros((1, 1, 1), np.int32), unknown, vertex, np.empty((0, 3))) == 0
