"""Pinhole cameras: where pixels lie in the picture and where their rays go."""

from __future__ import annotations

import numpy as np
import pytest

from ibrpipe.types import Camera

AIMED = Camera(
    np.array([[31.0, 0.4, 3.7], [0.0, 29.0, 2.2], [0.0, 0.0, 1.0]]),
    Camera.look_at((1.3, -2.1, 0.8), (0.1, 0.2, -0.3)).cam_from_world,
    7,
    5,
)


def test_the_centre_of_the_first_pixel_is_half_a_pixel_in():
    centers = AIMED.pixel_centers()
    assert centers.shape == (5, 7, 2)
    assert centers.dtype == np.float64
    for row in range(5):
        for column in range(7):
            assert centers[row, column].tolist() == [column + 0.5, row + 0.5]


def test_a_point_on_a_pixels_ray_projects_to_the_pixels_centre():
    rays = AIMED.pixel_rays()
    assert rays.shape == (5, 7, 3)
    assert rays.dtype == np.float64
    for row in range(5):
        for column in range(7):
            seen = AIMED.K @ (AIMED.R @ (AIMED.center + 2.5 * rays[row, column]) + AIMED.t)
            np.testing.assert_allclose(seen, [2.5 * (column + 0.5), 2.5 * (row + 0.5), 2.5], rtol=1e-12)


@pytest.mark.parametrize("shape", [(2,), (9, 2), (3, 4, 2), (0, 2)])
def test_rays_of_chosen_places_are_those_of_the_matrix(shape):
    places = np.random.default_rng(4).uniform(-3.0, 9.0, shape)
    rays = AIMED.pixel_rays(places)
    assert rays.shape == (*shape[:-1], 3)
    for place, ray in zip(places.reshape(-1, 2), rays.reshape(-1, 3), strict=True):
        np.testing.assert_allclose(ray, AIMED.world_from_pixel @ (*place, 1.0), rtol=1e-13, atol=1e-15)


def test_rays_are_those_of_grids_laid_by_hand_bit_by_bit():
    camera = Camera.look_at((0.3, -1.0, 2.0), (0, 0, 0), width=53, height=37)
    x, y = np.meshgrid(np.arange(53) + 0.5, np.arange(37) + 0.5)
    by_hand = np.stack([x, y, np.ones_like(x)], axis=-1) @ camera.world_from_pixel.T
    assert camera.pixel_rays().tobytes() == by_hand.tobytes()
    row, column = np.nonzero(np.random.default_rng(1).random((37, 53)) < 0.3)
    some = np.stack([column + 0.5, row + 0.5, np.ones(len(row))], axis=1) @ camera.world_from_pixel.T
    assert camera.pixel_rays(np.stack([column, row], axis=1) + 0.5).tobytes() == some.tobytes()


def test_whole_numbers_are_corners_of_pixels():
    np.testing.assert_allclose(AIMED.pixel_rays([3, 2]), AIMED.world_from_pixel @ (3.0, 2.0, 1.0), rtol=1e-13)


def test_matrices_between_pixels_camera_and_world_undo_each_other():
    point = AIMED.center + 3.0 * AIMED.world_from_pixel @ (2.25, 4.5, 1.0)
    np.testing.assert_allclose(AIMED.pixel_from_world @ (*point, 1.0), [3.0 * 2.25, 3.0 * 4.5, 3.0], rtol=1e-12)
    np.testing.assert_allclose(AIMED.cam_from_pixel @ AIMED.K, np.eye(3), atol=1e-15)


def test_rays_in_the_cameras_frame_turn_into_those_of_the_world():
    rays = AIMED.pixel_rays(frame="camera")
    assert (rays[..., 2] == 1.0).all()
    np.testing.assert_allclose(rays @ AIMED.R, AIMED.pixel_rays(), rtol=1e-12, atol=1e-14)
    x, y = np.meshgrid(np.arange(7) + 0.5, np.arange(5) + 0.5)
    by_hand = np.stack([x, y, np.ones_like(x)], axis=-1) @ np.linalg.inv(AIMED.K).T
    assert rays.tobytes() == by_hand.tobytes()
