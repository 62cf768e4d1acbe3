"""Support rectangles: handedness, frames against rays, what faces them, boxes around meshes."""

from __future__ import annotations

import numpy as np
import pytest
from pydantic import ValidationError

from ibrpipe.errors import ConfigError
from ibrpipe.modelling.layers import keep_rule, with_rim
from ibrpipe.modelling.rectangles import Rectangle, RectangleConfig, bounding_box, box_faces, sized
from ibrpipe.modelling.rims import Fronts
from ibrpipe.types import Camera, Mesh


def turned(seed):
    """A random rotation, rows are axes."""
    q, r = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    q = q * np.sign(np.diag(r))
    return q if np.linalg.det(q) > 0 else q[[1, 0, 2]]


CENTER, HALF, TEXEL = np.array([1.0, -2.0, 0.5]), np.array([1.0, 0.4, 0.7]), 0.05
AXES = turned(80)
USER = RectangleConfig(name="user", origin=(-1, -0.5, 0), u=(2, 0, 0), v=(0, 1, 0), center=(0.2, 0.1, -3), texel=0.1)


def test_box_faces_are_right_handed_and_look_inward():
    for face in box_faces(CENTER, AXES, HALF, TEXEL):
        u, v = face.u / np.linalg.norm(face.u), face.v / np.linalg.norm(face.v)
        np.testing.assert_allclose(np.cross(u, v), face.f, atol=1e-12)
        middle = face.origin + face.u / 2 + face.v / 2
        axis = "xyz".index(face.name[1])
        outward = AXES[axis] * (1 if face.name[0] == "+" else -1)
        np.testing.assert_allclose(face.f, -outward, atol=1e-12)
        np.testing.assert_allclose(middle, CENTER + outward * (HALF[axis] + TEXEL), atol=1e-12)


def test_box_faces_hold_the_box_with_a_texel_to_spare():
    rng = np.random.default_rng(81)
    inside = CENTER + rng.uniform(-1, 1, (500, 3)) * HALF @ AXES
    for face in box_faces(CENTER, AXES, HALF, TEXEL):
        np.testing.assert_allclose(face.facing(inside, np.tile(-face.f, (500, 1))), 1.0)
        assert np.linalg.norm(face.u) / face.width == pytest.approx(TEXEL, rel=0.05)
        assert np.linalg.norm(face.v) / face.height == pytest.approx(TEXEL, rel=0.05)


def test_a_flat_box_still_has_six_faces():
    faces = box_faces(CENTER, AXES, np.array([1.0, 1.0, 0.0]), TEXEL)
    assert len(faces) == 6
    assert min(min(face.width, face.height) for face in faces) >= 2


@pytest.mark.parametrize("center", [None, (0.2, 0.1, -3)])
def test_a_frame_agrees_with_its_rays(center):
    """A point at any depth on a texel's ray projects back to that texel's centre, at that depth."""
    rectangle = sized(USER.model_copy(update={"center": center}), TEXEL)
    origins, ways = rectangle.rays()
    depth = np.random.default_rng(82).uniform(0.1, 5, len(origins)) + (3 if center else 0)
    points = origins + depth[:, None] * ways
    if center:
        camera = rectangle.frame
        assert isinstance(camera, Camera)
        assert (camera.width, camera.height) == (20, 10)
        local = points @ camera.R.T + camera.t
        u, v = (local @ camera.K.T)[:, :2].T / local[:, 2]
        found = local[:, 2]
    else:
        frame = rectangle.frame
        u, v, found = frame.local_from_world @ (points - frame.origin).T
    columns, rows = np.meshgrid(np.arange(20) + 0.5, np.arange(10) + 0.5)
    np.testing.assert_allclose(u, columns.ravel(), atol=1e-9)
    np.testing.assert_allclose(v, rows.ravel(), atol=1e-9)
    np.testing.assert_allclose(found, depth, atol=1e-9)


def test_a_perspective_ray_passes_its_texel_on_the_rectangle():
    rectangle = sized(USER, TEXEL)
    origins, ways = rectangle.rays()
    on_plane = origins + 3.0 * ways  # the centre of projection lies 3 before the rectangle
    np.testing.assert_allclose(on_plane[:, 2], 0, atol=1e-12)
    np.testing.assert_allclose(on_plane[0], (-1 + 0.05, -0.5 + 0.05, 0), atol=1e-12)
    np.testing.assert_allclose(on_plane[-1], (1 - 0.05, 0.5 - 0.05, 0), atol=1e-12)


def test_a_centre_before_the_rectangle_is_refused():
    rectangle = sized(USER.model_copy(update={"center": (0.0, 0.0, 1.0)}), TEXEL)
    with pytest.raises(ConfigError, match="'user': the centre must lie behind it"):
        _ = rectangle.frame


def test_edges_must_be_at_right_angles():
    for u, v in (((1, 0, 0), (0.1, 1, 0)), ((0, 0, 0), (0, 1, 0))):
        with pytest.raises(ValidationError, match="right angles"):
            RectangleConfig(name="skew", origin=(0, 0, 0), u=u, v=v)


@pytest.mark.parametrize("center", [None, (0.2, 0.1, -3)])
def test_facing_is_the_cosine_inside_and_minus_one_outside(center):
    rectangle = sized(USER.model_copy(update={"center": center}), TEXEL)
    rng = np.random.default_rng(83)
    points, normals = rng.uniform((-2, -1, -1), (2, 1, 2), (800, 3)), rng.normal(size=(800, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    found = rectangle.facing(points, normals)
    for point, normal, cosine in zip(points, normals, found):
        toward = np.array([0, 0, -1.0]) if center is None else np.array(center) - point
        at = point - toward * point[2] / toward[2]  # where the ray from the point to the texture meets its plane
        before = -1e9 if center is None else center[2]
        inside = abs(at[0]) <= 1 and abs(at[1]) <= 0.5 and point[2] >= (0 if center is None else before)
        wanted = normal @ toward / np.linalg.norm(toward) if inside else -1.0
        assert cosine == pytest.approx(wanted, abs=1e-9)
    assert 100 < (found == -1).sum() < 700


def test_keep_rule_gives_every_point_at_least_one_layer():
    faces = box_faces(CENTER, AXES, HALF, TEXEL)
    rng = np.random.default_rng(84)
    points, normals = CENTER + rng.uniform(-1, 1, (4000, 3)) * HALF @ AXES, rng.normal(size=(4000, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    kept = np.stack([keep_rule(i, faces, [40.0] * 6, points, normals) for i in range(6)])
    facing = np.stack([face.facing(points, normals) for face in faces])
    assert kept.any(axis=0).all()
    assert kept[facing.argmax(axis=0), np.arange(4000)].all()  # the one that it faces best is always among them
    assert not (kept & (facing <= 0)).any()
    steep = kept & (facing < np.cos(np.radians(40)))
    assert (facing[steep] == np.broadcast_to(facing.max(axis=0), facing.shape)[steep]).all()
    assert 0 < steep.sum() < 4000


def test_keep_rule_alone_keeps_all_that_faces_it():
    rectangle = box_faces(CENTER, AXES, HALF, TEXEL)[0]
    normals = np.stack([-rectangle.f, rectangle.f, 0.1 * -rectangle.f + rectangle.u])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    kept = keep_rule(0, [rectangle], [40.0], np.tile(CENTER, (3, 1)), normals)
    np.testing.assert_array_equal(kept, [True, False, True])


def fronts_at(ray, points, normals):
    zero = np.zeros(len(ray))
    return Fronts(ray, zero, points, normals, zero, zero)


def test_rim_is_the_next_texel_of_the_same_surface():
    """Against the definition, sample by sample, on three random layers of which some are kept."""
    face = box_faces(CENTER, AXES, HALF, TEXEL)[0]
    rng = np.random.default_rng(87)
    origins, ways = face.rays()
    ray = np.repeat(np.arange(len(origins)), rng.integers(0, 4, len(origins)))
    points = origins[ray] + np.sort(rng.uniform(0, 6 * face.texel, len(ray)))[:, None] * ways[ray]
    normals = rng.normal(size=(len(ray), 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    fronts = fronts_at(ray, points, normals)
    keep = rng.random(len(ray)) < 0.1
    wanted = keep.copy()
    row, column = np.divmod(ray, face.width)
    for i in np.flatnonzero(~keep):
        near = keep & (abs(row - row[i]) <= 1) & (abs(column - column[i]) <= 1) & (ray != ray[i])
        apart = points[near] - points[i]
        off = np.minimum(abs(apart @ normals[i]), abs((apart * normals[near]).sum(axis=1)))
        wanted[i] = (off <= face.texel).any()
    found = with_rim(keep, fronts, face)
    np.testing.assert_array_equal(found, wanted)
    assert keep.sum() < found.sum() < len(ray)


def test_rim_of_nothing_is_nothing():
    face = box_faces(CENTER, AXES, HALF, TEXEL)[0]
    some, none = np.ones(5, bool), np.zeros(5, bool)
    points = np.tile(CENTER, (5, 1))
    fronts = fronts_at(np.arange(5), points, points)
    assert not with_rim(none, fronts, face).any()
    np.testing.assert_array_equal(with_rim(some, fronts, face), some)


def cloud(axes, half, count=400):
    points = CENTER + np.random.default_rng(85).uniform(-1, 1, (count, 3)) * half @ axes
    corners = np.stack(np.meshgrid(*[(-1, 1)] * 3), -1).reshape(-1, 3) * half @ axes + CENTER
    points = np.concatenate([points, corners])
    return Mesh(points, np.arange(len(points) - len(points) % 3).reshape(-1, 3))


def test_the_oriented_box_is_found_where_it_pays():
    center, axes, half, why = bounding_box(cloud(AXES, HALF))
    np.testing.assert_allclose(center, CENTER, atol=1e-3)
    np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-9)
    assert np.linalg.det(axes) == pytest.approx(1)
    assert np.prod(half) == pytest.approx(np.prod(HALF), rel=0.01)
    assert why.startswith("oriented box")


def test_an_aligned_box_stays_aligned():
    center, axes, half, why = bounding_box(cloud(np.eye(3), HALF))
    np.testing.assert_array_equal(axes, np.eye(3))
    np.testing.assert_allclose((center, half), (CENTER, HALF))
    assert "axis-aligned" in why


def test_a_flat_mesh_has_a_box():
    mesh = Mesh(np.array([[0, 0, 1], [1, 0, 1], [0, 2, 1.0]]), np.array([[0, 1, 2]]))
    _, _, half, why = bounding_box(mesh)
    np.testing.assert_allclose(half, (0.5, 1, 0))
    assert "axis-aligned" in why


@pytest.mark.parametrize("center", [None, (0.2, 0.1, -3)])
def test_plain_values_and_back(center):
    rectangle = sized(USER.model_copy(update={"center": center}), TEXEL)
    back = Rectangle.from_json(rectangle.as_json())
    assert back.as_json() == rectangle.as_json()
    assert (back.width, back.height) == (20, 10)
