"""Hierarchies of parts: what is refused, their order, bounds and counts."""

from __future__ import annotations

import numpy as np
import pytest

import ibrpipe
from ibrpipe.errors import ShapeError, ValueRangeError
from ibrpipe.types import Instances, Light, Lighting, Mesh, PaintedMesh, Part, ReliefTexture, Scene
from ibrpipe.types.camera import Camera, ParallelFrame
from ibrpipe.types.renderable import enclosing_points
from ibrpipe.types.textures import DepthImage


def triangle(offset=0.0):
    mesh = Mesh(np.array([[0, 0, 0], [1, 0, 0], [0, 2, 0]]) + offset, np.array([[0, 1, 2]]))
    return PaintedMesh(mesh, np.full((3, 3), 0.5, np.float32))


def move(x, y, z, scale=1.0):
    matrix = np.diag([scale, scale, scale, 1.0])
    matrix[:3, 3] = x, y, z
    return matrix


def small_scene():
    leaf = Part("leaf", (triangle(),))
    twig = Part("twig", (triangle(),), children=(Instances("leaf", np.stack([move(0, 0, 1), move(0, 0, 2, -2.0)])),))
    return Scene(
        [Part("root", children=(Instances("twig", np.stack([move(10 * n, 0, 0) for n in range(3)])),)), twig, leaf],
        "root",
    )


def test_parts_stand_before_those_that_hold_copies_of_them():
    assert list(small_scene().parts) == ["leaf", "twig", "root"]
    assert ibrpipe.Scene is Scene


def test_counts_need_no_expansion():
    scene = small_scene()
    assert scene.sub_objects == {"leaf": 1, "twig": 3, "root": 10}
    assert scene.polygons == {"leaf": 1, "twig": 3, "root": 9}


def test_a_billion_copies_are_counted():
    parts = [Part("0", (triangle(),))]
    for level in range(9):
        parts.append(Part(str(level + 1), children=(Instances(str(level), np.tile(np.eye(4), (10, 1, 1))),)))
    assert Scene(parts, "9").polygons["9"] == 10**9


def test_bounds_enclose_the_flattened_part():
    scene = small_scene()
    points = np.concatenate([each.mesh.vertices for each in scene.flattened("root")])
    assert len(points) == 27
    np.testing.assert_allclose(scene.bounds["root"].low, points.min(axis=0))
    np.testing.assert_allclose(scene.bounds["root"].high, points.max(axis=0))
    assert (np.linalg.norm(points - scene.bounds["root"].center, axis=1) <= scene.bounds["root"].radius + 1e-12).all()


def test_faces_stay_outward_under_a_mirror():
    scene = Scene(
        [Part("leaf", (triangle(),)), Part("root", children=(Instances("leaf", np.diag([1.0, 1.0, -1.0, 1.0])),))],
        "root",
    )
    (flat,) = scene.flattened("root")
    a, b, c = flat.mesh.vertices[flat.mesh.faces[0]]
    assert np.cross(b - a, c - a)[2] == -2.0


def test_an_empty_part_is_empty():
    scene = Scene([Part("nothing"), Part("root", children=(Instances("nothing", np.eye(4)),))], "root")
    assert scene.bounds["root"].empty
    assert scene.bounds["root"].radius == 0.0
    assert scene.flattened("root") == []


@pytest.mark.parametrize(
    ("parts", "root", "told"),
    [
        ([Part("a"), Part("a")], "a", "two parts are called 'a'"),
        ([Part("tree")], "trees", "root 'trees' is no part; did you mean \"tree\""),
        ([Part("a", children=(Instances("b", np.eye(4)),))], "a", "copies of 'b', which is no part"),
        ([Part("a", children=(Instances("a", np.eye(4)),))], "a", "copies of itself"),
        (
            [Part("a", children=(Instances("b", np.eye(4)),)), Part("b", children=(Instances("a", np.eye(4)),))],
            "a",
            r"copies of itself \(a > b > a\)",
        ),
    ],
)
def test_a_wrong_hierarchy_is_refused(parts, root, told):
    with pytest.raises(ValueRangeError, match=told):
        Scene(parts, root)


@pytest.mark.parametrize(
    ("matrix", "error", "told"),
    [
        (np.eye(3), ShapeError, r"must be \(N, 4, 4\)"),
        (np.full((4, 4), np.nan), ValueRangeError, "matrix 0 of 'leaf' holds NaN"),
        (np.diag([1.0, 1.0, 1.0, 2.0]), ValueRangeError, "affine"),
    ],
)
def test_a_wrong_matrix_is_refused(matrix, error, told):
    with pytest.raises(error, match=told):
        Instances("leaf", matrix)


def test_singular_and_mirrored_matrices_are_taken():
    assert len(Instances("leaf", np.stack([np.diag([1.0, 0, 0, 1.0]), np.diag([-1.0, 1, 1, 1])]))) == 2


@pytest.mark.parametrize("name", ["", " a", "a/b"])
def test_a_wrong_name_is_refused(name):
    with pytest.raises(ValueRangeError, match="a part is called"):
        Part(name)


def test_paint_and_lights_are_checked():
    mesh = triangle().mesh
    with pytest.raises(ShapeError, match=r"color must be \(3, 3\)"):
        PaintedMesh(mesh, np.zeros((2, 3)))
    with pytest.raises(ValueRangeError, match="negative light"):
        PaintedMesh(mesh, np.full((3, 3), -1.0))
    with pytest.raises(ValueRangeError, match=r"shininess is 0\.5"):
        PaintedMesh(mesh, np.zeros((3, 3)), shininess=0.5)
    with pytest.raises(ValueRangeError, match="direction must not be"):
        Light(np.zeros(3))
    with pytest.raises(ValueRangeError, match="ambient light is"):
        Lighting(ambient=np.array([-1.0, 0, 0]))
    np.testing.assert_allclose(Light(np.array([0.0, 0, 5])).direction, (0, 0, 1))


def test_captured_sources_are_enclosed():
    frame = ParallelFrame((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1))
    relief = ReliefTexture(frame, np.zeros((2, 3, 3)), np.array([[1, 2, 3], [4, 5, np.nan]]))
    points = enclosing_points(relief)
    np.testing.assert_array_equal(points.min(axis=0), (0, 0, 1))
    np.testing.assert_array_equal(points.max(axis=0), (3, 2, 5))
    camera = Camera.look_at((0, 0, 0), (0, 0, 1), up=(0, -1, 0), width=4, height=2)
    points = enclosing_points(DepthImage(camera, np.zeros((2, 4, 3)), np.full((2, 4), 2.0)))
    np.testing.assert_allclose(points[:, 2], 2.0)
    scene = Scene([Part("root", sources=(relief,))], "root")
    assert scene.bounds["root"].high[2] == 5


def test_uses_count_the_copies_of_all_levels():
    assert small_scene().uses == {"leaf": 6, "twig": 3, "root": 1}
    unused = Scene([Part("a", (triangle(),)), Part("b", children=(Instances("a", np.eye(4)),)), Part("c")], "c")
    assert unused.uses == {"a": 0, "b": 0, "c": 1}


def test_bounds_of_turned_boxes_are_those_of_their_corners():
    rng = np.random.default_rng(4)
    matrices = np.tile(np.eye(4), (5, 1, 1))
    matrices[:, :3] = rng.normal(size=(5, 3, 4))
    scene = Scene([Part("leaf", (triangle(1.0),)), Part("root", children=(Instances("leaf", matrices),))], "root")
    low, high = scene.bounds["leaf"].low, scene.bounds["leaf"].high
    corners = np.array([(x, y, z) for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])])
    moved = (corners @ matrices[:, :3, :3].transpose(0, 2, 1) + matrices[:, None, :3, 3]).reshape(-1, 3)
    np.testing.assert_allclose(scene.bounds["root"].low, moved.min(axis=0))
    np.testing.assert_allclose(scene.bounds["root"].high, moved.max(axis=0))


def test_deep_hierarchies_are_taken_apart():
    parts = [Part("0", (triangle(),))]
    parts += [Part(str(n + 1), children=(Instances(str(n), move(0, 0, 1)),)) for n in range(3000)]
    (flat,) = Scene(parts, "3000").flattened("3000")
    np.testing.assert_array_equal(flat.mesh.vertices, triangle().mesh.vertices + np.array([0, 0, 3000]))
