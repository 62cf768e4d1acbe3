"""Similarities between worlds and points from directions, against what they were made of."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ibrpipe.core.reconstruction.triangulation import distances, triangulate_agreed, triangulate_point
from ibrpipe.core.similarity import (
    centers,
    fit_cameras,
    fit_points,
    fit_poses,
    move_points,
    move_poses,
    rotation_angle_deg,
    spread,
)


def poses_of(random: np.random.Generator, count: int) -> np.ndarray:
    turns = Rotation.random(count, random_state=int(random.integers(1 << 30))).as_matrix()
    places = random.normal(size=(count, 3)) * (3.0, 2.0, 1.0)
    return np.concatenate([turns, -(turns @ places[:, :, None])], axis=2)


def similarity_of(random: np.random.Generator) -> tuple[float, np.ndarray, np.ndarray]:
    turn = Rotation.random(random_state=int(random.integers(1 << 30))).as_matrix()
    return float(np.exp(random.normal())), turn, random.normal(size=3) * 10


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("fit", [fit_poses, fit_cameras])
def test_cameras_are_taken_to_where_they_were_moved(seed: int, fit: object) -> None:
    random = np.random.default_rng(seed)
    old, wanted = poses_of(random, 2 + seed), similarity_of(random)
    new = move_poses(wanted, old)
    scale, R, t = fit(old, new)  # type: ignore[operator]
    assert scale == pytest.approx(wanted[0], rel=1e-9)
    assert np.allclose(R, wanted[1], atol=1e-9)
    assert np.allclose(move_poses((scale, R, t), old), new, atol=1e-8)
    assert np.allclose(centers(new), move_points(wanted, centers(old)), atol=1e-9)


def test_places_mirrored_are_not_taken_for_turned() -> None:
    random = np.random.default_rng(1)
    old = random.normal(size=(20, 3))
    _, R, _ = fit_points(old, old * (1, 1, -1))
    assert np.linalg.det(R) == pytest.approx(1.0)


def test_pictures_stay_the_same_when_the_world_moves() -> None:
    random = np.random.default_rng(2)
    old, point, moved = poses_of(random, 4), random.normal(size=3), similarity_of(random)
    before = old[:, :, :3] @ point + old[:, :, 3]
    new = move_poses(moved, old)
    after = new[:, :, :3] @ move_points(moved, point[None])[0] + new[:, :, 3]
    assert np.allclose(after, moved[0] * before)


def test_spread_tells_lines_from_planes() -> None:
    line = np.outer(np.arange(5.0), (1, 2, 3))
    assert spread(line) < 1e-12
    assert spread(line[:1]) == 0.0
    assert spread(np.eye(3)) > 0.9


def test_small_turns_are_exact() -> None:
    angles = np.array([0.0, 1e-9, 1e-4, 1.0, 90.0, 179.0])
    turns = Rotation.from_rotvec(np.radians(angles)[:, None] * np.array([[0.6, 0.8, 0.0]])).as_matrix()
    assert np.allclose(rotation_angle_deg(turns, np.broadcast_to(np.eye(3), (6, 3, 3))), angles, rtol=1e-6, atol=1e-13)


def test_points_are_found_from_directions_and_a_wrong_one_is_dropped() -> None:
    random = np.random.default_rng(3)
    point = np.array([0.1, -0.2, 0.3])
    turn = Rotation.from_rotvec(0.2 * random.normal(size=(6, 3))).as_matrix()
    places = random.normal(size=(6, 3)) * 0.5 - (0, 0, 5)
    poses = np.concatenate([turn, -(turn @ places[:, :, None])], axis=2)
    local = poses[:, :, :3] @ point + poses[:, :, 3]
    seen = local[:, :2] / local[:, 2:]
    assert np.allclose(triangulate_point(poses, seen), point, atol=1e-10)
    assert distances(point, poses, seen).max() < 1e-12
    seen[2] += 0.3
    found, kept = triangulate_agreed(poses, seen, 1e-3)
    assert np.allclose(found, point, atol=1e-9)
    assert kept.tolist() == [True, True, False, True, True, True]
    found, kept = triangulate_agreed(poses[[0, 2]], seen[[0, 2]], 1e-6)
    assert np.isnan(found).all()
    assert not kept.any()
