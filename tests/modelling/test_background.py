"""What photos show behind all surface, on far planes: a small square before a painted wall far away."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ibrpipe.capture.photo_set import PhotoSet
from ibrpipe.core.color import srgb_encode
from ibrpipe.embree import MeshCaster
from ibrpipe.modelling.background import TRIED, best_distance, make_background
from ibrpipe.renderers.api import render
from ibrpipe.types import Asset, Camera, Mesh, Texture

SQUARE = Mesh(
    np.array([[-1.0, 0.0, -1.0], [1.0, 0.0, -1.0], [1.0, 0.0, 1.0], [-1.0, 0.0, 1.0]]),
    np.array([[0, 1, 2], [0, 2, 3]], np.int32),
)
EYES = [(x, -5.0, z) for x in (-1.0, 0.0, 1.0) for z in (-0.5, 0.5)]


def camera(eye: tuple[float, float, float], toward: float = 20.0) -> Camera:
    return Camera.look_at(eye, (0.0, toward, 0.0), fov_y_deg=50.0, width=64, height=48)


def painted(points: np.ndarray) -> np.ndarray:
    """Smooth linear colours of a wall, by world x and z."""
    x, z = points[..., 0], points[..., 2]
    return np.stack([0.5 + 0.3 * np.sin(x), 0.5 + 0.3 * np.cos(0.8 * z), 0.4 + 0.2 * np.sin(x + z)], axis=-1)


def shown(view: Camera, wall: float) -> np.ndarray:
    """What a camera sees of the wall at y = `wall`, (H, W, 3) linear."""
    rays = view.pixel_rays()
    along = (wall - view.center[1]) / rays[..., 1]
    return painted(view.center + rays * along[..., None])


def photo_set(cameras: list[Camera], pictures: list[np.ndarray]) -> PhotoSet:
    caster = MeshCaster(SQUARE)
    count = 64 * 48
    return PhotoSet(
        tuple(cameras),
        np.stack([each.pixel_from_world for each in cameras]),
        np.stack([each.center for each in cameras]),
        np.array([(48, 64)] * len(cameras), np.int32),
        np.arange(len(cameras) + 1, dtype=np.int64) * count,
        np.concatenate([srgb_encode(each.astype(np.float32), np.inf).reshape(-1, 3) for each in pictures]),
        np.concatenate([caster.cast_camera(each).t.ravel() for each in cameras]).astype(np.float32),
        np.ones(count * len(cameras), np.float32),
    )


def test_a_wall_is_found_at_the_distance_where_photos_agree_and_shown_from_a_new_place():
    reach = np.sqrt(25 + 1 + 1)
    wall = 3.0 * reach - 5.0
    cameras = [camera(eye) for eye in EYES]
    found = make_background(photo_set(cameras, [shown(each, wall) for each in cameras]), SQUARE)
    assert found is not None
    assert len(found.layers) == 1
    assert found.distance == pytest.approx(TRIED[3] * reach, rel=0.02)
    assert found.spread < 0.01
    layers = found.layers[0]
    assert (layers.depth == np.float32(found.distance)).all()
    assert np.diff(layers.offsets, axis=1).max() == 1
    new = camera((0.3, -5.0, 0.1))
    frame = render(Asset((Texture(layers),)), new, "ldi")
    covered = frame.alpha >= 0.5
    assert covered.mean() > 0.9
    assert np.abs(frame.color - shown(new, wall))[covered].mean() < 0.01
    assert np.median(frame.depth[covered]) == pytest.approx(wall + 5.0, rel=0.03)


def test_surface_is_no_background_and_masked_photos_have_none():
    cameras = [camera(eye) for eye in EYES[:1]]
    red = np.broadcast_to([0.9, 0.0, 0.0], (48, 64, 3)).copy()
    photos = photo_set(cameras, [red])
    hit = np.isfinite(photos.depth)
    green = srgb_encode(np.array([[0.0, 0.9, 0.0]], np.float32), np.inf)
    found = make_background(replace(photos, code=np.where(hit[:, None], green, photos.code)), SQUARE)
    assert 0.02 < hit.mean() < 0.5
    assert all(layers.color[:, 1].max() < 0.05 for layers in found.layers)  # nothing of the square's green
    assert make_background(replace(photos, mask=hit.astype(np.float32)), SQUARE) is None


def test_photos_that_look_all_ways_get_the_faces_of_a_cube():
    ways = [(0, 20, 0), (20, 0, 0), (0, -20, 0), (-20, 0, 0)]
    cameras = [Camera.look_at((0.0, -5.0, 0.0), way, fov_y_deg=60.0, width=64, height=48) for way in ways]
    found = make_background(photo_set(cameras, [np.full((48, 64, 3), 0.2)] * 4), SQUARE)
    assert 4 <= len(found.layers) <= 6
    for layers in found.layers:
        rays = layers.frame.pixel_rays(frame="camera")
        assert np.abs(rays[..., :2]).max() <= 1.05
    asset = Asset(tuple(Texture(layers) for layers in found.layers))
    behind = render(asset, cameras[2], "ldi")
    assert (behind.alpha >= 0.5).mean() > 0.9
    assert np.abs(behind.color[behind.alpha >= 0.5] - 0.2).max() < 0.01


def test_the_distance_is_that_of_the_best_agreement_the_farthest_of_equals():
    assert best_distance([(0.2, 90), (0.1, 100), (0.3, 100)]) == 1
    assert best_distance([(0.1, 100), (0.1, 100), (0.1, 100), (0.3, 100)]) == 2


def test_what_hardly_any_photos_share_is_no_agreement():
    assert best_distance([(0.0, 3), (0.1, 100), (0.2, 80)]) == 1
    assert best_distance([(None, 0), (None, 0), (None, 0)]) == 2
    cameras = [camera(eye) for eye in EYES[:1]]
    found = make_background(photo_set(cameras, [np.full((48, 64, 3), 0.3)]), SQUARE)
    assert found.spread is None
    reach = np.linalg.norm(SQUARE.vertices - cameras[0].center, axis=1).max()
    assert found.distance == pytest.approx(TRIED[-1] * reach)
