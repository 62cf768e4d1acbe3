"""Hits of one texel put together, against plain loops."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from ibrpipe.core.rims import LEAD, group_hits


def twin(starts, place, points, normals, gap):
    out = np.full(len(place), -1)
    for first, last in pairwise(starts):
        for turn in LEAD:
            for lead in range(first, last):
                if place[lead] != turn or out[lead] >= 0:
                    continue
                out[lead] = lead
                for other in set(range(9)) - {int(turn)}:
                    free = [j for j in range(first, last) if place[j] == other and out[j] < 0]
                    off = [
                        min(
                            abs((points[j] - points[lead]) @ normals[lead]),
                            abs((points[j] - points[lead]) @ normals[j]),
                        )
                        for j in free
                    ]
                    if free and min(off) <= gap:
                        out[free[int(len(off) - 1 - np.argmin(off[::-1]))]] = lead
    return out


def test_groups_equal_plain_loops():
    random = np.random.default_rng(5)
    counts = random.integers(0, 14, 40)
    starts = np.concatenate([[0], np.cumsum(counts)])
    place = np.concatenate([np.sort(random.integers(0, 9, n)) for n in counts])
    points = random.random((len(place), 3))
    normals = random.standard_normal((len(place), 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    out = np.full(len(place), -1, np.int64)
    group_hits(starts, place, points, normals, 0.2, out)
    np.testing.assert_array_equal(out, twin(starts, place, points, normals, 0.2))
    assert len(np.unique(out)) < 0.8 * len(out)


def test_two_sheets_in_one_texel_are_two_surfaces():
    place = np.repeat(np.arange(9), 2)
    row, column = np.divmod(place, 3)
    level = np.tile([0.0, 0.5], 9)
    points = np.stack([column / 3, row / 3, level + 0.1 * column], axis=1)
    normals = np.tile(np.array([-0.3, 0.0, 1.0]) / np.hypot(0.3, 1.0), (18, 1))
    out = np.full(18, -1, np.int64)
    group_hits(np.array([0, 18]), place, points, normals, 0.1, out)
    assert len(np.unique(out[::2])) == len(np.unique(out[1::2])) == 1
    assert out[0] != out[1]
    assert place[out[0]] == 4
