"""Light, clipping and set-up of triangles against plain NumPy."""

from __future__ import annotations

import numpy as np
import pytest

from ibrpipe.core.hierarchy import triangles

K = np.array([[60.0, 0.0, 22.0], [0.0, 62.0, 19.0], [0.0, 0.0, 1.0]])
LIMITS = np.array([45.0, 40.0, 0.5])


def emit(corners, steps, pose=None, lights=(), lighting=((1, 1, 1),), material=(0, 1), paints=None):
    count = len(corners)
    numbers, boxes = np.zeros((count * steps, 21), np.float32), np.empty((count * steps, 4), np.int64)
    triangles.emit_triangles(
        np.array([[0, 0, count, 0, steps]]), np.eye(4)[:3].reshape(1, 12) if pose is None else pose[None],
        np.asarray(corners, np.float32), np.ones((count, 3, 3), np.float32) if paints is None else paints,
        np.array([material], float), (K, LIMITS), np.array(lights, float).reshape(-1, 3), np.array(lighting, float),
        numbers, boxes,
    )  # fmt: skip
    return numbers, boxes


def at(numbers, box, x, y):
    """Weights, depth and colour at a place of the picture."""
    values = numbers.reshape(7, 3) @ (x - box[0], y - box[2], 1)
    return values[:3], 1 / values[3], values[4:] / values[3]


def test_linear_forms_give_weights_depth_and_colour():
    corners = np.array([[[-1, -1, 4.0], [1.5, -0.8, 6.0], [0.2, 1, 9.0]]])
    paints = np.random.default_rng(0).random((1, 3, 3)).astype(np.float32)
    numbers, boxes = emit(corners, 1, paints=paints)
    for weights in ((1, 0, 0), (0.2, 0.5, 0.3), (0, 0, 1)):
        point = np.array(weights) @ corners[0]
        x, y, w = K @ point
        found, depth, color = at(numbers[0], boxes[0], x / w, y / w)
        assert depth == pytest.approx(point[2], rel=1e-4)
        np.testing.assert_allclose(color, np.array(weights) @ paints[0], atol=1e-4)
        assert found.sum() == pytest.approx(1.0, abs=1e-4)
        assert found.min() > -1e-4
        assert boxes[0, 0] <= x / w <= boxes[0, 1]


def test_both_sides_are_lit_towards_the_viewer():
    face = np.array([[0, 0, 5.0], [1, 0, 5.0], [0, 1, 5.0]])
    light, lighting = [(0, 0, -1.0)], [(0.1, 0.1, 0.1), (0.5, 0.6, 0.7)]
    for corners in (face, face[::-1]):
        numbers, boxes = emit(corners[None], 1, lights=light, lighting=lighting)
        np.testing.assert_allclose(at(numbers[0], boxes[0], 25, 22)[2], (0.6, 0.7, 0.8), atol=1e-5)
    numbers, boxes = emit(face[None], 1, lights=[(0, 0, 1.0)], lighting=lighting)
    np.testing.assert_allclose(at(numbers[0], boxes[0], 25, 22)[2], 0.1, atol=1e-5)


def test_highlights_are_where_the_mirror_sends_the_light():
    face = np.array([[[-3, -3, 5.0], [3, -3, 5.0], [0, 3, 5.0]]])
    lighting = [(0.0, 0, 0), (1.0, 1, 1)]
    dull = emit(face, 1, lights=[(0, 0, -1.0)], lighting=lighting)
    shiny = emit(face, 1, lights=[(0, 0, -1.0)], lighting=lighting, material=(0.5, 20.0))
    centre = at(shiny[0][0], shiny[1][0], *K[:2, 2])[2] - at(dull[0][0], dull[1][0], *K[:2, 2])[2]
    assert (centre > 0.01).all()


@pytest.mark.parametrize("behind", range(4))
def test_the_near_plane_cuts_what_crosses_it(behind):
    corners = np.array([[[-1, -1, 3.0], [1.2, -1, 3.0], [0, 1, 3.0]]])
    corners[0, :behind, 2] = -1.0
    numbers, boxes = emit(corners, 2)
    used = [n for n in range(2) if boxes[n, 0] < boxes[n, 1]]
    assert len(used) <= {0: 1, 1: 2, 2: 1, 3: 0}[behind]
    assert np.isfinite(numbers[used]).all()
    for weights in np.random.default_rng(0).dirichlet((1, 1, 1), 40):
        point = weights @ corners[0]
        x, y, w = K @ point
        inside = w > 0.51 and 0 < x / w < 45 and 0 < y / w < 40
        hit = [at(numbers[n], boxes[n], x / w, y / w) for n in used] if inside else []
        assert not inside or any(h[0].min() > -1e-4 and h[1] == pytest.approx(w, rel=1e-3) for h in hit)


def test_degenerate_and_distant_triangles_have_no_pixels():
    line = [[0, 0, 5.0], [1, 1, 5.0], [2, 2, 5.0]]
    away = [[90, 0, 5.0], [91, 0, 5.0], [90, 1, 5.0]]
    _, boxes = emit([line, away], 1)
    assert (boxes[:, 0] >= boxes[:, 1]).all()


def test_poses_are_applied_exactly_as_matrices():
    pose = np.array([0.5, 0, 0, 1, 0, 2, 0, 0, 0, 0, -1, 8.0])
    corners = np.array([[[0, 0, 1.0], [1, 0, 1.0], [0, 1, 1.0]]])
    numbers, boxes = emit(corners, 1, pose=pose)
    x, y, w = K @ (pose.reshape(3, 4) @ (0.3, 0.3, 1, 1))
    assert at(numbers[0], boxes[0], x / w, y / w)[1] == pytest.approx(7.0, rel=1e-5)
