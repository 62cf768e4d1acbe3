"""Smooth normals with creases against a plain twin that compares all corners with all others."""

from __future__ import annotations

import numpy as np
import photo_twin
import pytest
from kernel_runs import on_all_thread_counts

from ibrpipe.core.normals import _corner_normals, corner_angles, corner_normals, face_normals, incidence, weld

CUBE = np.array([(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
CUBE_FACES = np.array(
    [
        *[(0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1)],
        *[(2, 3, 7), (2, 7, 6), (0, 2, 6), (0, 6, 4), (1, 5, 7), (1, 7, 3)],
    ]
)


def bumpy_sheet(seed):
    """A 5 x 6 height field with a seam: the last column's vertices exist twice."""
    rng = np.random.default_rng(seed)
    x, y = np.meshgrid(np.arange(6.0), np.arange(5.0))
    vertices = np.stack([x.ravel(), y.ravel(), rng.random(30)], axis=1)
    corner = [r * 6 + c for r in range(4) for c in range(5)]
    faces = [f for i in corner for f in ((i, i + 1, i + 6), (i + 1, i + 7, i + 6))]
    doubled = np.concatenate([vertices, vertices[3::6]])
    faces = np.array(faces)
    split = (faces[:, 0] % 6 >= 3)[:, None] & (faces % 6 == 3)
    return doubled, np.where(split, 30 + faces // 6, faces)


@pytest.mark.parametrize("crease", [1.0, 25.0, 40.0, 80.0])
def test_as_twin_whatever_the_threads(crease):
    vertices, faces = bumpy_sheet(30)
    (found,) = on_all_thread_counts(lambda: (corner_normals(vertices, faces, crease),))
    np.testing.assert_allclose(found, photo_twin.corner_normals(vertices, faces, crease), atol=1e-6)
    assert found.dtype == np.float32


def test_a_cube_keeps_its_edges_and_a_blunt_crease_rounds_them():
    flat = face_normals(CUBE, CUBE_FACES)
    sharp = corner_normals(CUBE, CUBE_FACES, 40.0)
    np.testing.assert_allclose(sharp, np.repeat(flat[:, None], 3, axis=1), atol=1e-7)
    outward = (CUBE - 0.5) / np.linalg.norm(CUBE - 0.5, axis=1, keepdims=True)
    round_ = corner_normals(CUBE, CUBE_FACES, 91.0)
    np.testing.assert_allclose(round_, outward[CUBE_FACES], atol=1e-6)


def test_welding_joins_seams_only():
    number = weld(np.array([[0, 0, 0], [1, 0, 0], [0, 0, 0], [1, 0, 1e-9]], float))
    assert number[0] == number[2]
    assert len(set(number)) == 3


def test_incidence_lists_every_face_once_per_corner():
    starts, around = incidence(CUBE_FACES, 8)
    for vertex in range(8):
        wanted = [i for i, face in enumerate(CUBE_FACES) if vertex in face]
        np.testing.assert_array_equal(np.sort(around[starts[vertex] : starts[vertex + 1]]), wanted)


def test_angles_of_a_triangle_sum_to_pi():
    rng = np.random.default_rng(31)
    vertices = rng.random((9, 3))
    angles = corner_angles(vertices, np.arange(9).reshape(3, 3))
    np.testing.assert_allclose(angles.sum(axis=1), np.pi)
    np.testing.assert_allclose(corner_angles(CUBE, CUBE_FACES[:1]), np.radians([[45, 90, 45]]))


def test_faces_without_area_are_survived():
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [2, 0, 0]], float)
    faces = np.array([[0, 1, 2], [0, 1, 3]])
    found = corner_normals(vertices, faces)
    assert np.isfinite(found).all()
    np.testing.assert_allclose(found[0], np.tile((0, 0, 1), (3, 1)), atol=1e-7)


def test_the_kernel_itself_sums_the_faces_around_a_corner():
    """Faces around each vertex weighted by their angle there, whichever bend less than the crease; none, too."""
    rng = np.random.default_rng(32)
    corners = np.array([[0, 1, 2], [2, 1, 3], [0, 2, 4], [5, 6, 7]])
    unit, angles = rng.normal(size=(4, 3)), rng.random((4, 3))
    unit /= np.linalg.norm(unit, axis=1, keepdims=True)
    unit[3] = 0.0  # a face without area
    starts, around = incidence(corners, 8)
    for cosine in (-1.0, 0.0, 0.9):
        out = np.full((4, 3, 3), 7, np.float32)
        _corner_normals(corners, starts, around, unit, angles, cosine, out)
        for f, c in np.ndindex(4, 3):
            total = np.zeros(3)
            for g, d in np.argwhere(corners == corners[f, c]):
                if g == f or unit[f] @ unit[g] >= cosine:
                    total += angles[g, d] * unit[g]
            length = np.linalg.norm(total)
            np.testing.assert_allclose(out[f, c], total / length if length else unit[f], atol=1e-6)
    empty = np.empty((0, 3, 3), np.float32)
    none = np.empty((0, 3), np.int64)
    _corner_normals(none, np.zeros(1, np.int64), np.empty(0, np.int64), unit, angles, 0.0, empty)
