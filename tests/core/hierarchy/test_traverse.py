"""What is drawn how: poses against NumPy, and the choice on cases that are clear."""

from __future__ import annotations

import numpy as np
import pytest

from ibrpipe.core.hierarchy import traverse


def random_pose(seed):
    rng = np.random.default_rng(seed)
    return rng.normal(size=12)


@pytest.mark.parametrize("seed", range(5))
def test_pose_arithmetic_equals_numpy(seed):
    pose = random_pose(seed)
    matrix = pose.reshape(3, 4)[:, :3]
    det = traverse.determinant(pose)
    np.testing.assert_allclose(det, np.linalg.det(matrix))
    np.testing.assert_allclose(traverse.solve(pose, det, 1.0, -2.0, 0.5), np.linalg.solve(matrix, (1, -2, 0.5)))
    assert traverse.stretch(pose) >= np.linalg.norm(matrix, 2) - 1e-12


def test_the_stretch_of_a_similarity_is_its_scale():
    q, _ = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))
    pose = np.concatenate([-2.5 * q, np.ones((3, 1))], axis=1).ravel()
    np.testing.assert_allclose(traverse.stretch(pose), 2.5)


def test_octahedral_cells_are_the_nearest_in_the_table():
    from ibrpipe.core.hierarchy.directions import CELLS, nearest_table
    from ibrpipe.types.prerendered import view_axes

    axes = view_axes(48)
    np.testing.assert_allclose(axes @ axes.transpose(0, 2, 1), np.broadcast_to(np.eye(3), axes.shape), atol=1e-12)
    assert (np.linalg.det(axes) > 0).all()
    table = nearest_table(axes).ravel()
    rng = np.random.default_rng(2)
    for direction in rng.normal(size=(300, 3)):
        found = axes[table[traverse.octahedral_cell(*direction, CELLS)], 2] @ direction
        best = (axes[:, 2] @ direction).max()
        assert found >= best - 0.06 * np.linalg.norm(direction)


VIEW = np.array([500.0, 0.01, 1 / 0.7, -0.6, 0.6, -0.5, 0.5, 0, 0])
RESOLUTIONS = np.array([2, 4, 8, 16, 32])


def choice(pose_z, kind, cost=0.0, scale=1.0, x=0.0, flat=False):
    matrix = np.diag([scale, scale, 0.0 if flat else scale])
    pose = np.concatenate([matrix, [[x], [0], [pose_z]]], axis=1).ravel()[None]
    action, found = np.empty(1, np.int8), np.empty(1, np.int32)
    traverse.classify(
        np.zeros(1, np.int32), pose, np.array([[0, 0, 0, 1.0]]), np.array([kind]), np.full((1, 5), cost, np.float32),
        RESOLUTIONS, np.zeros((64, 64), np.int32), VIEW, action, found,
    )  # fmt: skip
    return int(action[0]), int(found[0] >> 16)


@pytest.mark.parametrize("z", [60.0, 100.0, 300.0, 1000.0])
def test_the_coarsest_resolution_within_the_error_is_drawn(z):
    need = 2 * 500 / 0.7 / z
    action, level = choice(z, (1, 0))
    assert action == traverse.SLICES
    assert RESOLUTIONS[level] >= need
    assert level == 0 or RESOLUTIONS[level - 1] < need


def test_what_is_near_is_taken_apart_or_drawn_as_polygons():
    assert choice(20.0, (1, 0))[0] == traverse.PARTS
    assert choice(20.0, (1, 9))[0] == traverse.POLYGONS
    assert choice(100.0, (0, 0))[0] == traverse.PARTS
    assert choice(100.0, (1, 9), cost=2.0)[0] == traverse.POLYGONS
    assert choice(100.0, (1, 0), cost=2.0)[0] == traverse.SLICES
    assert choice(0.5, (1, 0))[0] == traverse.PARTS  # the eye inside


def test_what_is_not_seen_is_left_out():
    assert choice(-5.0, (1, 0))[0] == traverse.CULLED
    assert choice(100.0, (1, 0), x=70.0)[0] == traverse.CULLED
    assert choice(100.0, (1, 0), x=60.5)[0] == traverse.SLICES
    assert choice(100.0, (1, 0), scale=0.0)[0] == traverse.CULLED


def test_flattened_copies_are_not_drawn_from_slices():
    assert choice(100.0, (1, 0), flat=True)[0] == traverse.PARTS
    assert choice(100.0, (1, 3), flat=True)[0] == traverse.POLYGONS


def test_copies_are_placed_by_products_of_matrices():
    rng = np.random.default_rng(3)
    poses, matrices = rng.normal(size=(2, 12)), rng.normal(size=(3, 12))
    parents, copies = np.array([1, 0, 1]), np.array([2, 0, 1])
    nodes, out = np.empty(3, np.int32), np.empty((3, 12))
    traverse.expand(parents, copies, poses, np.array([5, 6, 7], np.int32), matrices, nodes, out)
    assert nodes.tolist() == [7, 5, 6]
    square = [np.vstack([m.reshape(3, 4), (0, 0, 0, 1)]) for m in matrices]
    for n in range(3):
        np.testing.assert_allclose(out[n].reshape(3, 4), poses[parents[n]].reshape(3, 4) @ square[copies[n]])
