"""Camera paths: files on disk, orbits, and what they mean."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from ibrpipe.errors import ConfigError, FormatError, MissingFileError
from ibrpipe.io.paths import OrbitSpec, orbit, parse_orbit, read_path
from ibrpipe.types import Camera

BOX = (np.array([-1.0, -2.0, -0.5]), np.array([1.0, 2.0, 0.5]))


def photos(up: tuple[float, float, float] = (0, 0, 1)) -> list[Camera]:
    return [
        Camera.look_at((6 * np.cos(a), 6 * np.sin(a), 2), (0, 0, 0), up, width=80, height=60)
        for a in np.linspace(0, 2 * np.pi, 12, endpoint=False)
    ]


def test_text_becomes_an_orbit() -> None:
    assert parse_orbit("orbit") == OrbitSpec()
    assert parse_orbit("orbit:frames=7, elevation=-12.5,up=-y") == OrbitSpec(frames=7, elevation=-12.5, up="-y")


@pytest.mark.parametrize(
    ("text", "match"),
    [
        ("orbit:frames", "key=value"),
        ("orbit:frame=3", "frames, elevation"),
        ("orbit:frames=many", "expected a number"),
        ("orbit:frames=-1", "frames is -1"),
        ("orbit:fov=180", "less than 170"),
        ("orbit:elevation=nan", "elevation is nan"),
        ("orbit:distance=-2", "distance is -2"),
    ],
)
def test_wrong_orbits_are_refused(text: str, match: str) -> None:
    with pytest.raises(ConfigError, match=match):
        parse_orbit(text)


def test_an_orbit_closes_and_shows_the_whole_box() -> None:
    path = orbit(OrbitSpec(frames=36, elevation=25), BOX, photos())
    corners = np.stack(np.meshgrid(*zip(*BOX)), axis=-1).reshape(-1, 3)
    fullest = 0.0
    for _, camera in path:
        seen = corners @ camera.R.T + camera.t
        pixels = (seen @ camera.K.T)[:, :2] / seen[:, 2:]
        share = np.abs(pixels / (camera.width, camera.height) - 0.5).max() * 2
        assert share < 0.951
        fullest = max(fullest, share)
        assert camera.R[1] @ (0, 0, 1) < 0  # image y points down
    assert fullest > 0.949
    centers = np.array([camera.center for _, camera in path])
    step = np.linalg.norm(np.roll(centers, -1, axis=0) - centers, axis=1)
    np.testing.assert_allclose(step, step[0])
    radius = np.linalg.norm(centers[0])
    np.testing.assert_allclose(centers[:, 2], radius * np.sin(np.radians(25)))
    assert [name for name, _ in path][:2] == ["orbit_0000", "orbit_0001"]


def test_an_open_orbit_reaches_its_end() -> None:
    path = orbit(OrbitSpec(frames=3, sweep=90, elevation=0), BOX, photos())
    first, last = path[0][1].center, path[-1][1].center
    assert first @ last == pytest.approx(0, abs=1e-9)


def test_up_and_front_follow_the_photos() -> None:
    one_side = [Camera.look_at((0.5 * x, -5, 0.5), (0, 0, 0), (0, 0, 1)) for x in (-2, -1, 1, 2)]
    (_, camera), *_ = orbit(OrbitSpec(frames=4, elevation=0), BOX, one_side)
    np.testing.assert_allclose(camera.center / np.linalg.norm(camera.center), (0, -1, 0), atol=1e-9)
    held_sideways = [Camera.look_at((x, 0, 4), (x, 0, 0), (0, 1, 0)) for x in (-0.1, 0.1)]
    (_, camera), *_ = orbit(OrbitSpec(frames=1, elevation=90), BOX, held_sideways)
    np.testing.assert_allclose(camera.center / np.linalg.norm(camera.center), (0, 1, 0), atol=1e-9)


@pytest.mark.parametrize("up", ["x", "-y", "z"])
@pytest.mark.parametrize("elevation", [-90, 0, 90])
def test_every_up_and_elevation_gives_a_camera(up: str, elevation: float) -> None:
    for _, camera in orbit(OrbitSpec(frames=5, elevation=elevation, up=up), BOX):
        np.testing.assert_allclose(camera.R @ (0.0 - camera.center), [0, 0, np.linalg.norm(camera.center)], atol=1e-9)


def test_a_colmap_model_and_a_transforms_file_mean_the_same_path(tiny_glossy: Path) -> None:
    from_model, from_folder = read_path(tiny_glossy / "sparse" / "0"), read_path(tiny_glossy)
    from_file = read_path(tiny_glossy / "transforms.json")
    assert len(from_model) == 14
    for (a, first), (b, second), (c, third) in zip(from_model, from_folder, from_file, strict=True):
        assert a == b == c
        np.testing.assert_allclose(first.cam_from_world, second.cam_from_world, atol=1e-12)
        np.testing.assert_allclose(first.cam_from_world, third.cam_from_world, atol=1e-12)
        np.testing.assert_allclose(first.K, third.K, atol=1e-9)
        assert (first.width, first.height) == (third.width, third.height) == (96, 72)


def test_a_distorted_camera_becomes_a_pinhole(tiny_glossy: Path, tmp_path: Path) -> None:
    document = json.loads((tiny_glossy / "transforms.json").read_text())
    document["k1"] = -0.2
    (tmp_path / "transforms.json").write_text(json.dumps(document))
    (_, bent), *_ = read_path(tmp_path / "transforms.json")
    assert bent.width > 96  # everything that the barrel distortion squeezed in is kept
    assert bent.K[0, 0] == pytest.approx(document["fl_x"])


def test_what_is_not_there_is_told(tmp_path: Path) -> None:
    with pytest.raises(MissingFileError, match="no such camera path"):
        read_path(tmp_path / "nowhere")
    with pytest.raises(MissingFileError, match="neither a COLMAP model"):
        read_path(tmp_path)
    (tmp_path / "transforms.json").write_text("{")
    with pytest.raises(FormatError, match="not JSON"):
        read_path(tmp_path / "transforms.json")
