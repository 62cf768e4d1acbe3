"""Sorting, tiles and the table of shaded stacks against plain Python."""

from __future__ import annotations

import numpy as np

from ibrpipe.core.hierarchy import order, table


def test_depths_are_sorted_and_ties_keep_their_order():
    rng = np.random.default_rng(0)
    depths = np.exp(rng.uniform(-9, 9, 300)).astype(np.float32)
    depths[50:60] = depths[7]
    found = np.empty(300, np.int64)
    order.sort_depths(depths, found)
    np.testing.assert_array_equal(found, np.argsort(depths, kind="stable"))
    order.sort_depths(depths[:0], found[:0])


def test_tiles_list_what_they_show_in_order():
    rng = np.random.default_rng(1)
    low = rng.integers(0, 90, (60, 2))
    high = np.minimum(low + rng.integers(0, 50, (60, 2)), (100, 70))
    boxes = np.stack([low[:, 0], high[:, 0], np.minimum(low[:, 1], high[:, 1] - 1), high[:, 1]], axis=1)
    boxes = boxes[boxes[:, 2] >= 0]
    sequence = rng.permutation(len(boxes))
    starts = np.zeros(4 * 3 + 1, np.int64)
    items = np.empty(order.count_tiles(sequence, boxes, 4, starts), np.int64)
    order.fill_tiles(sequence, boxes, 4, starts, items)
    for tile in range(12):
        x, y = tile % 4 * 32, tile // 4 * 32
        wanted = [
            i
            for i in sequence
            if boxes[i, 0] < boxes[i, 1]
            and boxes[i, 0] < x + 32 and boxes[i, 1] > x and boxes[i, 2] < y + 32 and boxes[i, 3] > y
        ]  # fmt: skip
        assert items[starts[tile] : starts[tile + 1]].tolist() == wanted


def test_the_table_knows_what_was_entered():
    lengths = np.array([5, 7, 11])
    held = np.full((9, 3), table.EMPTY, np.int64)
    held[-1, 2] = 0
    keys = np.array([[1, 3], [0, 3], [1, 3], [1, 4]])
    found, fresh = np.empty(4, np.int64), np.empty((4, 3), np.int64)
    made, used = table.look_up(keys, lengths, 100, held, found, fresh)
    assert (made, used) == (3, 100 + 7 + 5 + 7)
    assert found.tolist() == [0, 1, 0, 2]
    assert fresh[:3].tolist() == [[1, 3, 100], [0, 3, 107], [1, 4, 112]]
    larger = np.full((17, 3), table.EMPTY, np.int64)
    table.grow(held, larger)
    made, used = table.look_up(np.array([[1, 4], [2, 0]]), lengths, 119, larger, found, fresh)
    assert (made, used) == (1, 130)
    assert found[:2].tolist() == [2, 3]
