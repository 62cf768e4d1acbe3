"""What photos see of a surface, against closed forms."""

import numpy as np
import pytest
import trimesh

from ibrpipe.capture.coverage import agreement, seen_points, spread_points
from ibrpipe.embree import MeshCaster
from ibrpipe.types import Camera, Mesh


def ball(subdivisions=4):
    shape = trimesh.creation.icosphere(subdivisions=subdivisions, radius=1.0)
    return Mesh(shape.vertices, shape.faces)


def square(z, side=1.0):
    half = side / 2
    return [[-half, -half, z], [half, -half, z], [half, half, z], [-half, half, z]], [[0, 1, 2], [0, 2, 3]]


def wall(z=0.0, side=1.0):
    vertices, faces = square(z, side)
    return Mesh(vertices, faces)


def above(height=4.0, fov=60.0):
    return Camera.look_at((0, 0, height), (0, 0, 0), (0, 1, 0), fov, 200, 200)


def everything(camera):
    return np.ones((camera.height, camera.width), np.float32)


def test_points_are_spread_evenly_by_area():
    points = spread_points(ball(), 4000)
    assert np.abs(points.position.mean(axis=0)).max() < 0.01
    assert np.allclose(np.linalg.norm(points.position, axis=1), 1.0, atol=0.01)
    assert (np.sum(points.normal * points.position, axis=1) > 0.99).all()
    for cut in (-0.5, 0.0, 0.7):  # Archimedes: the area above z is proportional to 1 - z
        assert (points.position[:, 2] > cut).mean() == pytest.approx((1 - cut) / 2, abs=0.01)


def test_a_photo_sees_the_cap_that_geometry_says():
    points, camera = spread_points(ball(), 20000), above(4.0)
    seen = seen_points(points, camera, everything(camera), MeshCaster(ball()))
    # seen at less than 80 degrees off the normal: polar angle below t with t + asin(sin(t_ray)) ... solved numerically
    angle = np.linspace(0, np.pi / 2, 100001)
    towards = np.stack([-np.sin(angle), 4.0 - np.cos(angle)])
    cosine = (towards * [np.sin(angle), np.cos(angle)]).sum(axis=0) / np.linalg.norm(towards, axis=0)
    share = (1 - np.cos(angle[cosine > np.cos(np.radians(80))].max())) / 2
    assert seen.mean() == pytest.approx(share, abs=0.004)


def test_what_stands_in_front_hides():
    (v1, f1), (v2, f2) = square(0.0), square(1.0, 0.5)
    mesh = Mesh(v1 + v2, f1 + [[a + 4 for a in face] for face in f2])
    points, camera = spread_points(mesh, 20000), above(4.0)
    seen = seen_points(points, camera, everything(camera), MeshCaster(mesh))
    lower = points.position[:, 2] < 0.5
    assert seen[~lower].all()
    # the small square's shadow on the large one, seen from 4: 0.5 x 4 / 3 wide
    assert (~seen[lower]).mean() == pytest.approx((0.5 * 4 / 3) ** 2, abs=0.01)


def test_either_side_is_seen_and_masked_parts_are_not():
    points, camera = spread_points(wall(), 5000), above(4.0)
    below = Camera.look_at((0, 0, -4.0), (0, 0, 0), (0, 1, 0), 60, 200, 200)
    caster = MeshCaster(wall())
    assert seen_points(points, camera, everything(camera), caster).all()
    assert seen_points(points, below, everything(below), caster).all()
    mask = everything(camera)
    mask[:, :100] = 0
    assert seen_points(points, camera, mask, caster).mean() == pytest.approx(0.5, abs=0.01)


def test_outside_the_picture_nothing_is_seen():
    narrow = above(4.0, fov=2 * np.degrees(np.arctan(0.25 / 4)))
    points = spread_points(wall(), 20000)
    seen = seen_points(points, narrow, everything(narrow), MeshCaster(wall()))
    assert seen.mean() == pytest.approx(0.25, abs=0.01)


def test_agreement_of_mask_and_outline():
    camera, caster = above(4.0, fov=2 * np.degrees(np.arctan(1 / 4))), MeshCaster(wall())
    mask = np.zeros((200, 200), np.float32)
    mask[50:150, 50:150] = 1
    overlap, backs, _ = agreement(camera, mask, caster)
    assert overlap == pytest.approx(1.0, abs=0.03)
    assert backs == 0
    mask[:] = 0
    mask[50:150, 100:200] = 1
    assert agreement(camera, mask, caster)[0] == pytest.approx(1 / 3, abs=0.03)


def test_backs_are_told():
    flipped = Mesh(ball().vertices, ball().faces[:, ::-1])
    camera = above()
    assert agreement(camera, everything(camera), MeshCaster(flipped))[1] == 1
    assert agreement(camera, everything(camera), MeshCaster(ball()))[1] == 0
