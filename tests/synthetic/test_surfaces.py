"""Parametric meshes: welded, closed, outward, with the normals of the closed form."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest

from ibrpipe.synthetic.scene import joined_mesh
from ibrpipe.synthetic.scenes import glossy, lambert, plain_ball
from ibrpipe.synthetic.surfaces import SmoothMesh, ball, lobed_ball, tilt, torus, tube

RING = tube(torus(2.0, 0.5, tilt("x", 30), (1.0, 2.0, 3.0)), 60, 30)
BALL = ball(lobed_ball(1.5, 1, 0.0, 1.0), 48, 24)
LOBED = ball(lobed_ball(1.0, 10, 0.035, 0.92), 80, 40)


def directed_edges(faces: np.ndarray) -> Counter:
    return Counter((int(face[i]), int(face[(i + 1) % 3])) for face in faces for i in range(3))


def volume(shape: SmoothMesh) -> float:
    a, b, c = (shape.mesh.vertices[shape.mesh.faces[:, i]] for i in range(3))
    return float((a * np.cross(b, c)).sum() / 6.0)


@pytest.mark.parametrize("shape", [RING, BALL, LOBED], ids=["ring", "ball", "lobed"])
def test_closed_surfaces_are_watertight_and_turned_outwards(shape: SmoothMesh) -> None:
    edges = directed_edges(shape.mesh.faces)
    assert set(edges.values()) == {1}
    assert all((b, a) in edges for a, b in edges)
    assert len(np.unique(shape.mesh.vertices.round(9), axis=0)) == len(shape.mesh.vertices)
    assert set(np.unique(shape.mesh.faces)) == set(range(len(shape.mesh.vertices)))
    assert volume(shape) > 0


def test_volumes_are_those_of_the_closed_forms() -> None:
    assert volume(BALL) == pytest.approx(4 / 3 * np.pi * 1.5**3, rel=0.02)
    assert volume(RING) == pytest.approx(2 * np.pi**2 * 2.0 * 0.5**2, rel=0.02)
    assert volume(BALL) < 4 / 3 * np.pi * 1.5**3  # inscribed


def test_ball_normals_are_radial() -> None:
    radial = BALL.mesh.vertices / np.linalg.norm(BALL.mesh.vertices, axis=1, keepdims=True)
    np.testing.assert_allclose(BALL.normals, radial, atol=1e-9)


def test_ring_normals_point_away_from_its_core() -> None:
    local = (RING.mesh.vertices - (1.0, 2.0, 3.0)) @ tilt("x", 30)
    flat = local * (1, 1, 0)
    core = 2.0 * flat / np.linalg.norm(flat, axis=1, keepdims=True)
    np.testing.assert_allclose(RING.normals @ tilt("x", 30), (local - core) / 0.5, atol=1e-8)


@pytest.mark.parametrize("make", [glossy, lambert, plain_ball])
def test_smooth_normals_agree_with_the_triangles(make) -> None:
    for part in make(1.0).parts:
        mesh = part.shape.mesh
        a, b, c = (mesh.vertices[mesh.faces[:, i]] for i in range(3))
        flat = np.cross(b - a, c - a)
        flat /= np.linalg.norm(flat, axis=1, keepdims=True)
        smooth = part.shape.normals[mesh.faces].mean(axis=1)
        np.testing.assert_allclose(np.linalg.norm(part.shape.normals, axis=1), 1.0, atol=1e-12)
        assert (flat * smooth).sum(axis=1).min() > 0.85


def test_parts_are_joined_in_order() -> None:
    scene = glossy(0.3)
    mesh, owner = joined_mesh(scene.parts)
    counts = [len(part.shape.mesh.faces) for part in scene.parts]
    assert owner.tolist() == [0] * counts[0] + [1] * counts[1]
    ring = mesh.vertices[mesh.faces[owner == 1]].reshape(-1, 3)
    wanted = scene.parts[1].shape.mesh
    np.testing.assert_allclose(ring, wanted.vertices[wanted.faces].reshape(-1, 3), atol=1e-6)


def test_tilt_is_a_right_handed_rotation() -> None:
    for axis, (before, after) in {"x": (1, 2), "y": (2, 0), "z": (0, 1)}.items():
        turn = tilt(axis, 90)
        np.testing.assert_allclose(turn @ np.eye(3)[before], np.eye(3)[after], atol=1e-15)
        assert np.linalg.det(turn) == pytest.approx(1.0)
