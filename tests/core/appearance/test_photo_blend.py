"""Which photos see a point, and the blend of the best four, against plain twins."""

from __future__ import annotations

import numpy as np
import photo_twin
import pytest
from kernel_runs import on_all_thread_counts
from photo_scene import constant_photos, random_photos, random_points

from ibrpipe.core.appearance.photo_blend import CLEAN, HIDDEN, USABLE, blend_photos, blend_weights, focal_length, see

NAMES = {"hidden": HIDDEN, "usable": USABLE, "clean": CLEAN}
COS_MIN, SLACK = 0.05, 2.0


def blended(photos, points, normals, directions, cos_min=COS_MIN, slack=SLACK, most=4, falloff=0.0, sharpness=0.0):
    color, count = np.empty((len(points), 3), np.float32), np.empty(len(points), np.int32)
    rules = np.array([cos_min, slack, falloff, sharpness])
    blend_photos(points, normals, directions, photo_twin.packed(photos), most, rules, color, count)
    return color, count


def unit(vectors):
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def test_visibility_as_twin():
    photos = random_photos(5, 1)
    packed = photo_twin.packed(photos)
    views = *packed[:4], *packed[5:]
    points, normals = random_points(200, 2)
    counts = dict.fromkeys(NAMES, 0)
    for point, normal in zip(points, normals):
        for p, photo in enumerate(photos):
            filled = np.zeros((2, 4, 2))
            place, upward = tuple(point), tuple(normal.astype(float))
            quality = see(place, upward, p, views, COS_MIN, SLACK, filled, 1)
            corners = filled[1]
            assert not filled[0].any()
            name, wanted = photo_twin.seen_color(photo, point, normal, COS_MIN, SLACK)
            counts[name] += 1
            assert quality == NAMES[name]
            if quality != HIDDEN:
                assert corners[:, 1].sum() == pytest.approx(1.0)
                got = (corners[:, 1:] * packed[4][corners[:, 0].astype(int)]).sum(axis=0)
                np.testing.assert_allclose(got, wanted, atol=1e-6)
    assert min(counts.values()) > 30


@pytest.mark.parametrize(
    ("most", "falloff", "sharpness"),
    [(2, 0, 0), (3, 0, 0), (4, 0, 0), (6, 0, 0), (4, 1, 0), (3, 0.5, 0), (4, 0, 0.5), (6, 1, 0.75)],
)
def test_blend_as_twin_whatever_the_threads(most, falloff, sharpness):
    photos = random_photos(9, 3)
    points, normals = random_points(300, 4)
    directions = unit(np.random.default_rng(5).normal((0, 0, 1), 0.5, (300, 3)))
    color, count = on_all_thread_counts(
        lambda: blended(photos, points, normals, directions, most=most, falloff=falloff, sharpness=sharpness)
    )
    rules = COS_MIN, SLACK, most, falloff, sharpness
    wanted = [photo_twin.blend(photos, *row, *rules) for row in zip(points, normals, directions)]
    np.testing.assert_array_equal(count, [used for _, used in wanted])
    assert set(count) == set(range(most + 1))
    np.testing.assert_allclose(color, [value for value, _ in wanted], atol=1e-5)


def test_blend_of_no_points_and_of_a_point_nobody_sees():
    photos = random_photos(3, 6)
    color, count = blended(photos, np.empty((0, 3)), np.empty((0, 3), np.float32), np.empty((0, 3)))
    assert color.shape == (0, 3)
    assert count.shape == (0,)
    color, count = blended(photos, np.array([[0, 0, 50.0]]), np.array([[0, 0, 1]], np.float32), np.array([[0, 0, 1.0]]))
    assert np.isnan(color).all()
    assert count[0] == 0


@pytest.mark.parametrize("count", [1, 2, 3, 4])
def test_blend_weights_as_twin(count):
    rng = np.random.default_rng(7)
    for _ in range(50):
        dots, weights = np.full(4, np.nan), np.empty(4)
        dots[:count] = np.sort(rng.uniform(-1, 1, count))[::-1]
        blend_weights(dots, count, weights)
        np.testing.assert_allclose(weights[:count], photo_twin.blend_weights(dots[:count]), atol=1e-12)
        assert weights[:count].sum() == pytest.approx(1)
        if count == 4:
            assert weights[3] == 0  # a photo has faded to nothing before another takes its place


@pytest.mark.parametrize("count", [1, 2, 3, 4])
def test_equal_angles_share_equally(count):
    dots, weights = np.full(4, 0.7), np.empty(4)
    blend_weights(dots, count, weights)
    np.testing.assert_allclose(weights[:count], 1 / count, rtol=1e-6)


def test_looking_along_a_photo_gives_its_colour():
    """With the other photos far round, weights follow dot_i - dot_4 exactly."""
    eyes = [(0.0, 0.0, 3.0), (1.5, 0, 3), (0, 1.5, 3), (-2.5, 0, 3)]
    colors = np.eye(4)[:, :3]
    photos = constant_photos(colors, eyes)
    point, normal = np.zeros((1, 3)), np.array([[0, 0, 1]], np.float32)
    color, count = blended(photos, point, normal, np.array([[0, 0, 1.0]]))
    dots = np.array([3 / np.linalg.norm(eye) for eye in eyes])
    weights = (dots - dots[3]) / (dots - dots[3]).sum()
    np.testing.assert_allclose(color[0], weights @ colors, atol=1e-6)
    assert count[0] == 4


def test_what_stands_before_never_bleeds_in():
    """Half of a photo shows another, nearer surface: only the other pixels are read."""
    (photo,) = constant_photos([(0.2, 0.4, 0.6)], [(0.0, 0.0, 3.0)])
    photo.color[:, 5:] = 1.0
    photo.depth[:, 5:] = 1.0
    points = np.stack([np.linspace(-0.9, 0.9, 60), np.zeros(60), np.zeros(60)], axis=1)
    normals, directions = np.tile(np.float32([0, 0, 1]), (60, 1)), np.tile([0, 0, 1.0], (60, 1))
    color, count = blended([photo], points, normals, directions)
    assert 20 < count.sum() < 50
    np.testing.assert_allclose(color[count > 0], np.tile((0.2, 0.4, 0.6), (count.sum(), 1)), atol=1e-6)


def test_focal_length_of_a_projection():
    (photo,) = random_photos(1, 8)
    camera = photo.camera
    assert focal_length((camera.K @ camera.cam_from_world)[None], 0) == pytest.approx(camera.K[0, 0])
