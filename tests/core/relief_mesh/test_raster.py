"""Which polygon each pixel sees: every kernel against linear equations solved pixel by pixel and face by face."""

from __future__ import annotations

import numpy as np
import pytest
from kernel_runs import on_all_thread_counts

from ibrpipe.core.relief_mesh.raster import bound_faces, draw_faces, edge_plane, side_of
from ibrpipe.types import Camera

CAMERA = Camera.look_at((0.2, -0.3, -3.0), (0, 0, 0), (0, 1, 0), 50.0, 13, 11)


def triangles(count, seed=0):
    """Vertices counted from the eye and corners of triangles before, around and behind the camera."""
    rng = np.random.default_rng(seed)
    vertices = rng.uniform(-1.5, 1.5, (3 * count, 3)) * (1, 1, 2.4)
    return vertices - CAMERA.center, np.arange(3 * count).reshape(-1, 3)


def shares(vertices, corners):
    """(h, w, F, 3): how a pixel's direction is made of each face's corners; a ray meets the face if none is below 0."""
    x, y = np.meshgrid(np.arange(CAMERA.width) + 0.5, np.arange(CAMERA.height) + 0.5)
    directions = np.stack([x, y, np.ones_like(x)], axis=-1) @ CAMERA.world_from_pixel.T
    inverse = np.linalg.inv(np.swapaxes(vertices[corners], 1, 2))
    return np.einsum("fij,yxj->yxfi", inverse, directions)


def drawn(vertices, corners, after, limit, both=True):
    size = CAMERA.height, CAMERA.width
    bounds = np.empty((len(corners), 4), np.int32)
    bound_faces(vertices, corners, CAMERA.K @ CAMERA.R, both, CAMERA.width, CAMERA.height, bounds)
    layer, face = np.empty(size), np.empty(size, np.int32)
    found = draw_faces(vertices, corners, bounds, CAMERA.world_from_pixel, after, limit, layer, face)
    return layer, face, np.array(found)


def test_an_edges_plane_is_the_cross_product_whichever_way_the_edge_runs():
    vertices, _ = triangles(4)
    for i, j in ((0, 5), (5, 0), (3, 2)):
        plane = edge_plane(vertices, i, j)
        np.testing.assert_allclose(plane, np.cross(vertices[i], vertices[j]), rtol=1e-12, atol=1e-15)
        np.testing.assert_array_equal(plane, -np.array(edge_plane(vertices, j, i)))  # to the bit: no cracks


def test_the_side_of_a_plane_is_a_scalar_product():
    plane, point = (0.3, -2.0, 0.7), np.array([1.5, 0.25, -4.0])
    assert side_of(plane, *point) == pytest.approx(np.dot(plane, point))
    assert side_of((1.0, 0.0, 0.0), 0.0, 3.0, 5.0) == 0.0


@pytest.mark.parametrize("both", [True, False])
def test_bounds_hold_every_pixel_that_a_face_covers_and_little_more(both):
    vertices, corners = triangles(60)
    bounds = np.empty((len(corners), 4), np.int32)
    bound_faces(vertices, corners, CAMERA.K @ CAMERA.R, both, CAMERA.width, CAMERA.height, bounds)
    volume = np.linalg.det(vertices[corners])
    share = shares(vertices, corners)
    covered = (share >= 0).all(axis=3)
    seen = 0
    for f, (x0, x1, y0, y1) in enumerate(bounds):
        if volume[f] > 0 and not both:
            assert x0 > x1
            continue
        rows, columns = np.nonzero(covered[:, :, f])
        assert ((rows >= y0) & (rows <= y1) & (columns >= x0) & (columns <= x1)).all()
        pixels = vertices[corners[f]] @ (CAMERA.K @ CAMERA.R).T
        if (pixels[:, 2] > 0).all():
            at = pixels[:, :2] / pixels[:, 2:]
            assert x0 > at[:, 0].min() - 1.6 or x0 == 0
            assert x1 < at[:, 0].max() + 0.6
            assert y0 > at[:, 1].min() - 1.6 or y0 == 0
            assert y1 < at[:, 1].max() + 0.6
        elif (pixels[:, 2] <= 0).all():
            assert x0 > x1
        seen += len(rows)
    assert seen > 100


@pytest.mark.parametrize("seed", [1, 2])
def test_drawn_depths_equal_the_solved_equations_whatever_the_threads(seed):
    vertices, corners = triangles(25, seed)
    size, rng = (CAMERA.height, CAMERA.width), np.random.default_rng(seed)
    after = np.where(rng.random(size) < 0.5, 0.0, 2.5)
    limit = np.where(rng.random(size) < 0.5, np.inf, 4.0).astype(np.float32)
    layer, face, found = on_all_thread_counts(lambda: drawn(vertices, corners, after, limit))
    share = shares(vertices, corners)
    with np.errstate(divide="ignore"):
        depth = np.where((share >= 0).all(axis=3), 1 / share.sum(axis=3), np.inf)
    depth[(depth <= after[..., None]) | (depth >= limit[..., None])] = np.inf
    np.testing.assert_allclose(layer, depth.min(axis=2), rtol=1e-9)
    np.testing.assert_array_equal(face, np.where(np.isfinite(layer), depth.argmin(axis=2), -1))
    assert found == (face >= 0).sum()
    assert 20 < found < face.size


def test_no_faces_and_a_face_turned_away():
    size = CAMERA.height, CAMERA.width
    after, limit = np.zeros(size), np.full(size, np.inf, np.float32)
    layer, face, found = drawn(np.zeros((0, 3)), np.zeros((0, 3), np.int64), after, limit)
    assert np.isinf(layer).all()
    assert (face == -1).all()
    assert found == 0
    away = np.array([[-1, -1, 3], [1, -1, 3], [0, 1, 3]]) @ CAMERA.R
    counts = [drawn(away, np.array([order]), after, limit, False)[2] for order in ((0, 1, 2), (0, 2, 1))]
    assert sorted(np.array(counts) > 0) == [False, True]
