"""The oracle of scenes of copies, against areas, depths and light that are known."""

from __future__ import annotations

import numpy as np
import pytest

from ibrpipe.bench.oracles.copies import cast_scene
from ibrpipe.synthetic.instanced.pieces import painted_box, placed
from ibrpipe.types import Camera, Instances, Light, Lighting, Part, Scene

CAMERA = Camera.look_at((0, 0, 10), (0, 0, 0), up=(0, 1, 0), fov_y_deg=53.13, width=40, height=40)  # focal length 40


def boxes(*places, lighting=None):
    box = Part("box", (painted_box((-0.5, -0.5, -1), (0.5, 0.5, 0), (0.5, 0.25, 0.1)),))
    matrices = np.stack([placed(place) for place in places])
    return Scene([box, Part("root", children=(Instances("box", matrices),))], "root", lighting)


def test_area_depth_and_light_are_those_of_a_square():
    lighting = Lighting(np.full(3, 0.2), (Light((0, 0.6, 0.8), (0.5, 1.0, 0.0)),))
    found = cast_scene(boxes((0, 0, 0), lighting=lighting), CAMERA, 1e-3, 16)
    focal = CAMERA.K[0, 0]
    assert found.cover.sum() == pytest.approx((focal / 10) ** 2, rel=0.02)
    inside = found.cover == 1
    assert inside.sum() == 16
    np.testing.assert_allclose(found.depth[inside], 10.0)
    wanted = np.array([0.5, 0.25, 0.1]) * (0.2 + np.array([0.5, 1.0, 0.0]) * 0.8)
    np.testing.assert_allclose(found.color[inside], np.tile(wanted, (16, 1)), rtol=1e-6)
    assert np.isinf(found.depth[found.cover < 0.4]).all()


def test_nearer_copies_hide_farther_ones_and_what_is_before_the_near_plane_is_not_seen():
    scene = boxes((0, 0, 0), (0, 0, 4.0))
    assert cast_scene(scene, CAMERA, 1e-3, 4).depth.min() == pytest.approx(6.0)
    assert cast_scene(scene, CAMERA, 6.5, 4).depth.min() == pytest.approx(7.0)  # the inside of the nearer box
    assert cast_scene(scene, CAMERA, 7.5, 4).depth.min() == pytest.approx(10.0)


def test_boxes_leave_out_nothing():
    from ibrpipe.bench.oracles import copies, triangles

    rng = np.random.default_rng(3)
    corners = rng.uniform(-2, 2, (8, 3, 3)) + np.array([0, 0, 1.5])
    rays = np.concatenate([rng.uniform(-1, 1, (300, 2)), np.ones((300, 1))], axis=1)
    found = []
    for boxes_of in (copies._boxes(corners), np.tile([-np.inf, np.inf, -np.inf, np.inf], (8, 1))):
        depth, face = np.full(300, np.inf), np.full(300, -1, np.int64)
        triangles.nearest_triangles(rays, corners, boxes_of, 0.1, depth, face)
        found.append((depth, face))
    np.testing.assert_array_equal(found[0][0], found[1][0])
    np.testing.assert_array_equal(found[0][1], found[1][1])
    hit = found[0][1] >= 0
    assert 100 < hit.sum() < 300
    point = rays[hit] * found[0][0][hit, None]
    a, b, c = (corners[found[0][1][hit], n] for n in range(3))
    np.testing.assert_allclose(np.einsum("ni,ni->n", np.cross(b - a, c - a), point - a), 0, atol=1e-9)
