"""Masks ask for surface where depth maps show a dent that the object has not; what lies behind is left out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ibrpipe.reconstruction.depth.fusion import Cloud
from ibrpipe.reconstruction.surface.hull_completion import complete_by_masks, required_by_masks
from ibrpipe.reconstruction.surface.mesh_operations import vertex_normals
from ibrpipe.reconstruction.surface.silhouettes import Outline, outline_of
from ibrpipe.synthetic.surfaces import ball, lobed_ball
from ibrpipe.types import Array, Camera, Mesh

STEP = 0.083  # a pixel at the ball, which is 12 pixels wide from its middle
DENT = 0.4


def _outline(eye: Array) -> Outline:
    """The outline of the unit ball."""
    camera = Camera.look_at(eye, (0, 0, 0), (0.1, 1, 0.2), 90.0, 160, 120)
    y, x = np.mgrid[:120, :160] + 0.5
    rays = np.stack([x, y, np.ones_like(x)], axis=-1) @ camera.world_from_pixel.T
    rays /= np.linalg.norm(rays, axis=2, keepdims=True)
    apart = np.linalg.norm(np.cross(rays, np.broadcast_to(-eye, rays.shape)), axis=2)
    return outline_of(camera, (apart <= 1).astype(np.float32), np.ones((1, 1), bool))


@pytest.fixture(scope="module")
def outlines() -> list[Outline]:
    """Of 80 photos around the unit ball."""
    z = 1 - 2 * (np.arange(80) + 0.5) / 80
    angle, side = np.pi * (3 - 5**0.5) * np.arange(80), np.sqrt(1 - z**2)
    return [_outline(5 * each) for each in np.stack([side * np.cos(angle), side * np.sin(angle), z], axis=1)]


def _dented() -> tuple[Mesh, Mesh, Array]:
    """The ball, the ball with a dent on the x axis, and how deep every vertex lies."""
    whole = ball(lobed_ball(1.0, 1, 0.0, 1.0), 120, 60).mesh
    depth = DENT * np.exp(-(((1 - whole.vertices[:, 0]) / 0.15) ** 2))
    return whole, Mesh(whole.vertices * (1 - depth)[:, None], whole.faces), depth


def _cloud(mesh: Mesh) -> Cloud:
    ones = np.ones(len(mesh.vertices), np.float32)
    return Cloud(mesh.vertices, vertex_normals(mesh), ones, np.full(len(ones), 3, np.int32), STEP * ones)


def test_a_dent_that_masks_refute_is_filled(outlines: list[Outline]) -> None:
    whole, dented, depth = _dented()
    found = complete_by_masks(_cloud(dented), dented, whole, outlines, STEP)
    assert 0 < found.missed < 0.02
    assert (found.required[:, 0] > 0.5).all()  # nowhere else
    left = {tuple(each) for each in found.cloud.position}
    gone = np.array([tuple(each) not in left for each in dented.vertices])
    assert gone.sum() == found.behind
    assert gone[depth > 2 * STEP].mean() > 0.8
    assert not gone[depth < STEP].any()
    error = np.abs(np.linalg.norm(found.cloud.position, axis=1) - 1)
    assert (error > 2 * STEP).sum() < 0.2 * (depth > 2 * STEP).sum()
    assert found.measured["points_behind"] == found.behind


def test_masks_that_are_met_or_contradicted_ask_for_nothing(outlines: list[Outline]) -> None:
    whole, dented, _ = _dented()
    cloud = _cloud(dented)
    silent = [replace(each, contradicted=True) for each in outlines]
    assert complete_by_masks(cloud, dented, whole, silent, STEP).cloud is cloud
    assert complete_by_masks(cloud, whole, whole, outlines, STEP).cloud is cloud


def test_a_long_way_through_the_hull_tells_nothing(outlines: list[Outline]) -> None:
    whole = ball(lobed_ball(1.0, 1, 0.0, 1.0), 120, 60).mesh
    front = whole.faces[whole.vertices[whole.faces][:, :, 0].mean(axis=1) > 0.3]
    required, missed = required_by_masks(Mesh(whole.vertices, front), whole, outlines, STEP)
    assert missed > 0.3
    share = required[whole.vertices[:, 0] < 0].mean()
    assert 0.02 < share < 1  # only what stands at the rim of a photo
