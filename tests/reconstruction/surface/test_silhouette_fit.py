"""Rims of a surface go to the masks' outlines: a body shrunk by a known size grows back, an open border moves out."""

from __future__ import annotations

import numpy as np

from ibrpipe.reconstruction.depth.evidence import Evidence
from ibrpipe.reconstruction.surface.mesh_operations import openings
from ibrpipe.reconstruction.surface.silhouette_fit import fit_to_silhouettes, less_sure, shape_of, unfolded
from ibrpipe.reconstruction.surface.silhouettes import Outline, outline_of
from ibrpipe.types import Camera, Mesh

_KNOWN = np.ones((1, 1), bool)


def _cameras(around: float, count: int = 24) -> list[Camera]:
    """Cameras 5 units from the origin, on a spiral; `around` is how far down they go, 1 = everywhere."""
    z = 1 - around * (2 * np.arange(count) + 1) / count
    angle = np.pi * (3 - 5**0.5) * np.arange(count)
    side = np.sqrt(1 - z**2)
    eyes = 5 * np.stack([side * np.cos(angle), side * np.sin(angle), z], axis=1)
    return [Camera.look_at(eye, (0, 0, 0), (0.1, 1, 0.2), 40.0, 160, 120) for eye in eyes]


def _rays(camera: Camera) -> np.ndarray:
    y, x = np.mgrid[: camera.height, : camera.width] + 0.5
    rays = np.stack([x, y, np.ones_like(x)], axis=-1) @ camera.world_from_pixel.T
    return rays / np.linalg.norm(rays, axis=2, keepdims=True)


def _ball_outline(camera: Camera) -> Outline:
    """The outline of the unit ball."""
    rays = _rays(camera)
    apart = np.linalg.norm(np.cross(rays, np.broadcast_to(-camera.center, rays.shape)), axis=2)
    return outline_of(camera, (apart <= 1).astype(np.float32), _KNOWN)


def _square_outline(camera: Camera) -> Outline:
    """The outline of the square from -1 to 1 in the plane z = 0."""
    rays = _rays(camera)
    met = camera.center + rays * (-camera.center[2] / rays[..., 2])[..., None]
    return outline_of(camera, (np.abs(met[..., :2]).max(axis=2) <= 1).astype(np.float32), _KNOWN)


def _ball(radius: float, rows: int = 40) -> Mesh:
    """A ball of quads between two poles, closed."""
    polar, turn = np.linspace(0, np.pi, rows + 1)[1:-1], np.linspace(0, 2 * np.pi, 2 * rows, endpoint=False)
    p, t = np.meshgrid(polar, turn, indexing="ij")
    ring = np.stack([np.sin(p) * np.cos(t), np.sin(p) * np.sin(t), np.cos(p)], axis=-1).reshape(-1, 3)
    number = np.arange(len(ring)).reshape(p.shape)
    right = np.roll(number, -1, axis=1)
    a, b, c, d = (each.ravel() for each in (number[:-1], number[1:], right[1:], right[:-1]))
    top, bottom = len(ring), len(ring) + 1
    caps = [np.stack([np.full(2 * rows, top), number[0], right[0]], 1)]
    caps.append(np.stack([np.full(2 * rows, bottom), right[-1], number[-1]], 1))
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1), *caps])
    return Mesh(radius * np.concatenate([ring, [[0, 0, 1], [0, 0, -1]]]), faces.astype(np.int32))


def _square(half: float, count: int = 40) -> Mesh:
    """A flat square that looks along +z."""
    i, j = np.meshgrid(np.arange(count + 1), np.arange(count + 1), indexing="ij")
    place = np.stack([i.ravel(), j.ravel()], axis=1) * 2 * half / count - half
    corner = (np.arange(count)[:, None] * (count + 1) + np.arange(count)).ravel()
    over = corner + count + 1
    faces = np.concatenate([np.stack([corner, over, over + 1], 1), np.stack([corner, over + 1, corner + 1], 1)])
    return Mesh(np.c_[place, np.zeros(len(place))], faces.astype(np.int32))


def test_a_shrunken_ball_grows_back_to_its_outlines() -> None:
    pixel = 5 / _cameras(1.0, 48)[0].K[0, 0]
    found, moved = fit_to_silhouettes(_ball(1 - pixel), [_ball_outline(each) for each in _cameras(1.0, 48)])
    left = (np.linalg.norm(found.vertices, axis=1) - 1) / pixel
    assert abs(left.mean()) < 0.25  # of one pixel
    assert left.std() < 0.2
    assert openings(found).loops == 0
    assert 0.7 * pixel < moved.mean() < 1.3 * pixel


def test_an_open_border_moves_out_and_the_middle_stays() -> None:
    cameras = _cameras(0.4)
    pixel = 5 / cameras[0].K[0, 0]
    sheet = _square(1 - 1.5 * pixel)
    found, moved = fit_to_silhouettes(sheet, [_square_outline(each) for each in cameras])
    border = shape_of(sheet).border
    left = (np.abs(found.vertices[border, :2]).max(axis=1) - 1) / pixel
    assert abs(np.median(left)) < 0.3  # of 1.5 pixels
    assert np.abs(found.vertices[:, 2]).max() < 1e-3 * pixel
    middle = np.abs(sheet.vertices[:, :2]).max(axis=1) < 0.4
    assert moved[middle].max() < 0.1 * pixel


def test_pictures_whose_border_cuts_the_surface_say_nothing() -> None:
    sheet, cameras = _square(0.9), _cameras(0.4)
    whole = [outline_of(each, np.ones((each.height, each.width), np.float32), _KNOWN) for each in cameras]
    assert fit_to_silhouettes(sheet, whole)[0].vertices.tobytes() == sheet.vertices.tobytes()
    assert fit_to_silhouettes(sheet, [])[0] is sheet


def test_far_and_lonely_outlines_move_nothing() -> None:
    cameras = _cameras(0.4)
    pixel = 5 / cameras[0].K[0, 0]
    far = fit_to_silhouettes(_square(1 - 12 * pixel), [_square_outline(each) for each in cameras])
    assert far[1].max() == 0
    two = fit_to_silhouettes(_square(1 - pixel), [_square_outline(each) for each in cameras[:2]])
    assert two[1].max() == 0


def test_what_was_moved_is_less_sure() -> None:
    count = np.full(4, 3, np.int32)
    found = Evidence(count, 0 * count, np.full(4, 0.8, np.float32))
    less = less_sure(found, np.array([0.0, 0.1, 0.2, 0.5]), 0.1)
    assert np.allclose(less.confidence, [0.8, 0.4, 0.0, 0.0], atol=1e-6)
    assert less.confidence.dtype == np.float32
    assert less.observations is count


def test_no_face_turns_over() -> None:
    sheet = _square(1.0, 10)
    move = np.zeros_like(sheet.vertices)
    move[60, 0] = 0.5  # over its neighbour
    move[0, 2] = 0.01
    free = unfolded(sheet, move)
    assert not free[60]
    assert free[0]
