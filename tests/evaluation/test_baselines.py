"""Lumigraph and median on a plane seen by a few photos of one colour each: everything can be worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest

from ibrpipe.capture.photo_set import PhotoSet
from ibrpipe.core.color import srgb_decode
from ibrpipe.embree import MeshCaster
from ibrpipe.evaluation.baselines import render_median, render_ulr
from ibrpipe.types import Camera, Mesh

#: display codes of the photos, one colour each
CODES = np.array([[0.9, 0.1, 0.2], [0.1, 0.8, 0.3], [0.2, 0.3, 0.7], [0.5, 0.5, 0.5], [0.3, 0.9, 0.9]], np.float32)
EYES = np.array([[0.0, 0.0, 4.0], [1.0, 0.2, 4.0], [-0.9, 0.7, 4.0], [0.3, -1.4, 4.0], [2.0, 1.5, 3.5]])


@pytest.fixture(scope="module")
def caster():
    corners = [[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]
    return MeshCaster(Mesh(np.array(corners, float), np.array([[0, 1, 2], [0, 2, 3]])), threads=1)


def camera_at(eye, width=40, height=30):
    return Camera.look_at(eye, (0.0, 0.0, 0.0), up=(0.0, 1.0, 0.0), fov_y_deg=40.0, width=width, height=height)


def photo_set(caster, blocked=()):
    cameras = tuple(camera_at(eye) for eye in EYES)
    sizes = np.array([(c.height, c.width) for c in cameras], np.int32)
    starts = np.concatenate([[0], np.cumsum(sizes.astype(np.int64).prod(axis=1))])
    pixels = int(sizes[0].prod())
    mask = np.ones((len(EYES), pixels), np.float32)
    mask[list(blocked)] = 0.0
    return PhotoSet(
        cameras,
        np.stack([c.K @ c.cam_from_world for c in cameras]),
        np.stack([c.center for c in cameras]),
        sizes,
        starts,
        np.repeat(CODES, pixels, axis=0),
        np.concatenate([caster.cast_camera(c).t.ravel() for c in cameras]),
        mask.ravel(),
    )


def by_hand(camera, row, column, photos):
    """Colour of one pixel as display code: weights dot_i - dot_4 over the photos allowed."""
    ray = camera.pixel_rays()[row, column]
    point = camera.center - ray * camera.center[2] / ray[2]
    toward = (camera.center - point) / np.linalg.norm(camera.center - point)
    to_photos = EYES[photos] - point
    dots = (to_photos / np.linalg.norm(to_photos, axis=1, keepdims=True)) @ toward
    best = np.argsort(-dots)[:4]
    weights = dots[best] - dots[best[3]]
    return (weights / weights.sum()) @ CODES[photos][best]


@pytest.mark.parametrize("blocked", [(), (1,)])
def test_lumigraph_blends_the_four_best_by_angle(caster, blocked):
    camera = camera_at((0.4, 0.3, 3.8))
    frame = render_ulr(camera, caster, photo_set(caster, blocked))
    allowed = [p for p in range(5) if p not in blocked]
    for row, column in ((15, 20), (12, 17), (18, 24)):
        expected = srgb_decode(by_hand(camera, row, column, allowed))
        np.testing.assert_allclose(frame.color[row, column], expected, atol=2e-6)


def test_median_is_the_median_of_each_channel(caster):
    frame = render_median(camera_at((0.1, 0.2, 3.5)), caster, photo_set(caster))
    np.testing.assert_allclose(frame.color[15, 20], srgb_decode(np.median(CODES, axis=0)), atol=2e-6)


def test_depth_and_coverage(caster):
    camera = camera_at((0.0, 0.0, 4.0))
    frame = render_ulr(camera, caster, photo_set(caster))
    hit = np.isfinite(frame.depth)
    assert 0 < hit.sum() < hit.size
    np.testing.assert_allclose(frame.depth[hit], 4.0, rtol=1e-6)
    assert (frame.alpha[~hit] == 0).all()
    assert (frame.color[~hit] == 0).all()
    assert frame.alpha[15, 20] == 1


@pytest.mark.parametrize("render", [render_ulr, render_median])
def test_what_no_photo_sees_is_black_and_uncovered(caster, render):
    frame = render(camera_at((0.0, 0.0, 4.0)), caster, photo_set(caster, blocked=range(5)))
    assert (frame.color == 0).all()
    assert (frame.alpha == 0).all()
    assert frame.stats["unseen"] == np.isfinite(frame.depth).sum() > 0


def test_a_surface_seen_from_its_back_is_shaded_by_photos_of_that_side(caster):
    frame = render_ulr(camera_at((0.1, 0.1, -4.0)), caster, photo_set(caster))
    assert np.isfinite(frame.depth[15, 20])
    assert frame.alpha[15, 20] == 0  # all photos are on the other side
