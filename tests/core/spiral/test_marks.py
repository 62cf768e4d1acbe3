"""Which spiral images a picture looks up: against the plain look-up, pixel by pixel and texture by texture."""

from __future__ import annotations

import numpy as np
import pytest
import spiral_twin
from kernel_runs import on_all_thread_counts

from ibrpipe.core.spiral import directions
from ibrpipe.core.spiral.marks import mark_images
from ibrpipe.types import Camera

#: rows a, b, -f of two rectangles
ROTATIONS = np.array([[[1, 0, 0], [0, 1, 0], [0, 0, -1]], [[0, 0, -1], [0, 1, 0], [-1, 0, 0]]], float)


@pytest.mark.parametrize("closed", [True, False])
def test_as_twin_whatever_the_threads(closed):
    ks, camera = (1 / 8, 1 / 5), Camera.look_at((-2.2, 0.4, -3.1), (0, 0, 0), fov_y_deg=50, width=12, height=9)
    alphas = [directions.table(k, closed) for k in ks]
    limit = directions.LIMIT if closed else np.pi / 2
    closings = np.array([directions.closing_count(k) if closed else 0 for k in ks])
    ranges = np.cumsum([0] + [len(part) for part in alphas])
    depth = np.ones((9, 12), np.float32)
    depth[:4], depth[7, 3:] = np.inf, np.inf

    def marked():
        marks = np.ones((9, ranges[-1]), bool)
        way = np.ascontiguousarray(camera.world_from_pixel)
        mark_images(
            depth, way, (ROTATIONS, np.zeros((2, 3)), np.ones((2, 2))),
            (np.concatenate(alphas), np.array(ks), np.full(2, limit), closings, ranges), marks
        )  # fmt: skip
        return (marks,)

    (marks,) = on_all_thread_counts(marked)
    wanted = np.zeros_like(marks)
    for row, column in zip(*np.nonzero(np.isfinite(depth))):
        way = -(camera.world_from_pixel @ (column + 0.5, row + 0.5, 1.0))
        for t, k in enumerate(ks):
            local = ROTATIONS[t] @ (way / np.linalg.norm(way))
            if local[2] > 0:
                found = spiral_twin.lookup(local[None], alphas[t], k, limit, closings[t])[0]
                wanted[row, ranges[t] : ranges[t + 1]] |= found > 1e-12
    np.testing.assert_array_equal(marks, wanted)
    assert 0 < marks.any(axis=0).sum() < ranges[-1]
