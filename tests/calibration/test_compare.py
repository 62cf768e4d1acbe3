"""Cameras against others of the same photos: a turn, a shifted principal point, another focal length."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from scipy.spatial.transform import Rotation
from textured_corner import HEIGHT, WIDTH, cameras

from ibrpipe.calibration.compare import GRID, compare_cameras
from ibrpipe.cli.main import cli
from ibrpipe.core.similarity import direction_angle_deg
from ibrpipe.synthetic.layout import write_colmap_text
from ibrpipe.types import Camera

COUNT = 5
NAMES = [f"{index}.png" for index in range(COUNT)]


def compared(folder: Path, turn: float = 0.0, shift: float = 0.0, focal: float = 1.0) -> dict[str, float]:
    """Errors of cameras turned about their y axis by `turn` degrees, of another principal point and focal length."""
    shots, changed = cameras(COUNT), []
    matrix = Rotation.from_euler("y", turn, degrees=True).as_matrix()
    for camera in shots:
        K = camera.K.copy()
        K[0, 2] += shift
        K[[0, 1], [0, 1]] *= focal
        changed.append(Camera(K, matrix @ camera.cam_from_world, WIDTH, HEIGHT))
    write_colmap_text(folder / "truth", NAMES, shots)
    write_colmap_text(folder / "found", NAMES, changed)
    return compare_cameras(folder / "found", folder / "truth")


def test_a_camera_turned_back_by_as_much_as_its_middle_lies_aside_shows_in_rotations_only(tmp_path: Path) -> None:
    focal = cameras(1)[0].K[0, 0]
    turn = float(np.degrees(np.arctan(1.5 / focal)))
    both = compared(tmp_path / "with", -turn, 1.5)
    assert both["rotation_mean_deg"] == pytest.approx(turn, rel=1e-3)
    assert both["rays_mean_deg"] < 0.2 * turn
    wrong = compared(tmp_path / "against", turn, 1.5)
    assert wrong["rotation_mean_deg"] == pytest.approx(turn, rel=1e-3)
    assert wrong["rays_mean_deg"] > 1.7 * turn


def test_a_turn_alone_is_the_same_in_both_to_the_side_of_the_axis(tmp_path: Path) -> None:
    found = compared(tmp_path, 0.2)
    assert found["rotation_mean_deg"] == pytest.approx(0.2, rel=1e-6)
    assert 0.8 * 0.2 < found["rays_mean_deg"] < found["rays_max_deg"] <= 0.2 * (1 + 1e-9)


def test_rays_see_the_focal_length_as_worked_out_by_hand(tmp_path: Path) -> None:
    found = compared(tmp_path, focal=1.01)
    K = cameras(1)[0].K
    angles = []
    for row in range(GRID):
        for column in range(GRID):
            x = (column + 0.5) / GRID * WIDTH - K[0, 2]
            y = (row + 0.5) / GRID * HEIGHT - K[1, 2]
            away = np.hypot(x, y) / K[0, 0]
            angles.append(np.degrees(np.arctan(away) - np.arctan(away / 1.01)))
    assert found["rotation_max_deg"] == pytest.approx(0.0, abs=1e-9)
    assert found["rays_mean_deg"] == pytest.approx(np.mean(angles), rel=1e-6)
    assert found["rays_max_deg"] == pytest.approx(np.max(angles), rel=1e-6)


def test_angles_of_close_directions_keep_their_digits() -> None:
    turn = np.array([1e-9, 1e-3, 1.0, 90.0, 180.0])
    one = np.tile([1.0, 0.0, 0.0], (5, 1))
    other = np.stack([np.cos(np.radians(turn)), np.sin(np.radians(turn)), np.zeros(5)], axis=1)
    assert direction_angle_deg(one, other) == pytest.approx(turn, rel=1e-7)


def test_inspect_names_rotations_and_rays(tmp_path: Path) -> None:
    compared(tmp_path, 0.2)
    told = CliRunner().invoke(cli, ["inspect", str(tmp_path / "found"), "--against", str(tmp_path / "truth")])
    assert told.exit_code == 0, told.output
    assert "rotation mean deg" in told.output
    assert "rays mean deg" in told.output
