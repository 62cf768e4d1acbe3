"""The packed photo set of a tiny capture: projections, depths, masks, subsets, and what it says of the surface."""

from __future__ import annotations

import numpy as np
import pytest

from ibrpipe.capture.photo_set import load_photos
from ibrpipe.core.color import srgb_decode
from ibrpipe.errors import CaptureError
from ibrpipe.io.views import load_view, read_views


def test_every_photo_is_packed(measured):
    ball = measured("ball")
    photos, views = ball.photos, read_views(ball.folder / "views.json").train
    assert len(photos.cameras) == len(views) == 14
    for p, view in enumerate(views):
        color, mask = load_view(view)
        own = slice(photos.starts[p], photos.starts[p + 1])
        np.testing.assert_allclose(srgb_decode(photos.code[own]), color.reshape(-1, 3), atol=2e-6)
        np.testing.assert_array_equal(photos.mask[own], mask.ravel())
        np.testing.assert_allclose(photos.centers[p], view.camera.center)
        x = np.array([0.1, -0.2, 0.3, 1.0])
        np.testing.assert_allclose(photos.projection[p] @ x, view.camera.K @ view.camera.cam_from_world @ x)


def test_depth_is_that_of_the_ball(measured):
    """Closed form: the nearer root of |eye + z way| = 1, up to the sag of the mesh's faces."""
    photos = measured("ball").photos
    for p, camera in enumerate(photos.cameras):
        depth = photos.depth[photos.starts[p] : photos.starts[p + 1]].reshape(camera.height, camera.width)
        x, y = np.meshgrid(np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5)
        way = np.stack([x, y, np.ones_like(x)], -1) @ camera.world_from_pixel.T
        a, b, c = (way * way).sum(-1), way @ camera.center, camera.center @ camera.center - 1
        square = b * b - a * c
        well_inside = square > 0.15 * a
        np.testing.assert_allclose(
            depth[well_inside], (-b[well_inside] - np.sqrt(square[well_inside])) / a[well_inside], atol=2.5e-3
        )
        assert np.isinf(depth[square < 0]).all()


def test_a_subset_is_as_if_only_those_were_loaded(measured):
    ball = measured("ball")
    chosen = [9, 2, 5]
    views = read_views(ball.folder / "views.json").train
    alone, part = load_photos([views[i] for i in chosen], ball.caster), ball.photos.subset(chosen)
    rng = np.random.default_rng(90)
    points = rng.normal(size=(300, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    for one, other in zip(
        (*alone.blend(points, points, points), *alone.diffuse(points, points)),
        (*part.blend(points, points, points), *part.diffuse(points, points)),
    ):
        np.testing.assert_array_equal(one, other)


def test_only_photos_on_its_side_see_a_point(measured):
    photos = measured("ball").photos
    rng = np.random.default_rng(91)
    points = rng.normal(size=(200, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    color, spread, count = photos.diffuse(points, points)
    above = (points @ photos.centers.T > 1.0).sum(axis=1)  # the tangent plane decides on a unit ball
    assert (count <= above).all()
    assert (count >= above - 4).all()  # grazing photos and silhouettes may be refused
    assert np.isnan(color[count == 0]).all()
    assert (spread >= 0).all()


def test_without_photos_the_capture_is_refused(measured):
    with pytest.raises(CaptureError, match="no training photos"):
        load_photos([], measured("ball").caster)
