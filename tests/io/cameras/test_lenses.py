import numpy as np
import pytest

from ibrpipe.errors import CaptureError
from ibrpipe.io.cameras.lenses import Lens, known_models, photo_positions, undistorted_calibration
from ibrpipe.types import Camera

SIZE = (160, 120)
MODELS = {
    "SIMPLE_RADIAL": (100.0, 80.0, 60.0, -0.1),
    "RADIAL": (100.0, 80.0, 60.0, -0.1, 0.02),
    "OPENCV": (100.0, 101.0, 79.0, 61.0, -0.1, 0.02, 0.001, -0.002),
    "FULL_OPENCV": (100.0, 101.0, 79.0, 61.0, 0.1, 0.02, 0.001, -0.002, 0.01, 0.15, 0.02, 0.0),
    "OPENCV_FISHEYE": (110.0, 111.0, 79.0, 61.0, 0.02, -0.01, 0.001, 0.0),
    "SIMPLE_RADIAL_FISHEYE": (110.0, 80.0, 60.0, 0.02),
    "RADIAL_FISHEYE": (110.0, 80.0, 60.0, 0.02, -0.01),
    "FOV": (100.0, 100.0, 80.0, 60.0, 0.9),
    "THIN_PRISM_FISHEYE": (110.0, 110.0, 80.0, 60.0, 0.02, -0.01, 1e-4, 1e-4, 0.0, 0.0, 1e-4, 1e-4),
}


def opencv_positions(lens, camera):
    """The same look-up by OpenCV's own projection, for the models that it has."""
    import cv2

    rows, columns = np.mgrid[0 : camera.height, 0 : camera.width] + 0.5
    rays = np.stack([columns, rows, np.ones_like(rows)], axis=-1).reshape(-1, 3) @ np.linalg.inv(camera.K).T
    K = np.array([[lens.params[0], 0, lens.params[2]], [0, lens.params[1], lens.params[3]], [0, 0, 1.0]])
    bend = np.array(lens.params[4:])
    if lens.model == "OPENCV_FISHEYE":
        points, _ = cv2.fisheye.projectPoints(rays[:, None], np.zeros(3), np.zeros(3), K, bend)
    else:
        points, _ = cv2.projectPoints(rays[:, None], np.zeros(3), np.zeros(3), K, bend)
    return points.reshape(camera.height, camera.width, 2) - 0.5


def pinhole(lens, keep):
    K, width, height = undistorted_calibration(lens, keep)
    return Camera(K, np.eye(3, 4), width, height)


@pytest.mark.parametrize("model", ["OPENCV", "FULL_OPENCV", "OPENCV_FISHEYE"])
def test_positions_agree_with_opencv(model):
    lens = Lens(model, MODELS[model], *SIZE)
    camera = pinhole(lens, "inside")
    x, y = photo_positions(lens, camera)
    expected = opencv_positions(lens, camera)
    assert np.abs(x - expected[:, :, 0]).max() < 1e-3
    assert np.abs(y - expected[:, :, 1]).max() < 1e-3


@pytest.mark.parametrize("model", MODELS)
def test_inside_has_no_empty_margin_and_all_has_every_corner(model):
    lens = Lens(model, MODELS[model], *SIZE)
    assert lens.distorted
    x, _ = photo_positions(lens, pinhole(lens, "inside"))
    assert (x > -1e3).mean() > 0.999
    x, y = photo_positions(lens, pinhole(lens, "all"))
    met = x > -1e3
    reached = np.array([x[met].min(), y[met].min(), SIZE[0] - 1 - x[met].max(), SIZE[1] - 1 - y[met].max()])
    assert (reached < 1.0).all()


def test_centre_keeps_its_resolution_and_place():
    lens = Lens("OPENCV", MODELS["OPENCV"], *SIZE)
    for keep in ("all", "inside"):
        K, width, height = undistorted_calibration(lens, keep)
        assert (K[0, 0], K[1, 1]) == (100.0, 101.0)
        x, y = photo_positions(lens, Camera(K, np.eye(3, 4), width, height))
        column, row = int(K[0, 2]), int(K[1, 2])
        assert x[row, column] + 0.5 == pytest.approx(79.0 + column + 0.5 - K[0, 2], abs=0.01)
        assert y[row, column] + 0.5 == pytest.approx(61.0 + row + 0.5 - K[1, 2], abs=0.01)


def test_far_rays_do_not_fold_back_into_the_picture():
    # r (1 - 0.3 r^2) turns back at r = 1.05: rays beyond must not show the picture a second time
    lens = Lens("SIMPLE_RADIAL", (100.0, 80.0, 60.0, -0.3), *SIZE)
    wide = Camera([[40.0, 0, 80.0], [0, 40.0, 60.0], [0, 0, 1]], np.eye(3, 4), 160, 120)
    x, _ = photo_positions(lens, wide)
    columns, rows = np.meshgrid(np.arange(160) + 0.5, np.arange(120) + 0.5)
    radius = np.hypot(columns - 80.0, rows - 60.0) / 40.0
    assert (x[radius > 1.1] < -1e3).all()
    assert (x[radius < 0.6] > -1e3).all()


def test_pinholes_are_left_alone():
    for lens in (
        Lens("PINHOLE", (90.0, 91.0, 70.0, 50.0), *SIZE),
        Lens("SIMPLE_PINHOLE", (90.0, 70.0, 50.0), *SIZE),
        Lens("SIMPLE_RADIAL", (90.0, 70.0, 50.0, 0.0), *SIZE),
    ):
        assert not lens.distorted
        K, width, height = undistorted_calibration(lens)
        assert (width, height) == SIZE
        assert (K[0, 0], K[0, 2], K[1, 2]) == (90.0, 70.0, 50.0)


def test_a_fisheye_without_coefficients_is_still_no_pinhole():
    assert Lens("OPENCV_FISHEYE", (70.0, 70.0, 80.0, 60.0, 0.0, 0.0, 0.0, 0.0), *SIZE).distorted


def test_a_very_wide_lens_is_cut_at_60_degrees():
    lens = Lens("OPENCV_FISHEYE", (40.0, 40.0, 80.0, 60.0, 0.0, 0.0, 0.0, 0.0), *SIZE)
    K, width, height = undistorted_calibration(lens)
    assert width <= 2 * SIZE[0]
    assert height <= 2 * SIZE[1]
    assert width / 2 / K[0, 0] <= np.sqrt(3.0) + 0.5 / K[0, 0]


@pytest.mark.parametrize(
    ("model", "params", "size", "words"),
    [
        ("BANANA", (1.0,), SIZE, "'BANANA' is not known; expected one of .*OPENCV_FISHEYE"),
        ("EQUIRECTANGULAR", (160.0, 120.0), SIZE, "is not known"),
        ("PINHOLE", (1.0, 1.0, 1.0), SIZE, "takes 4 parameters, got 3"),
        ("PINHOLE", (-1.0, 1.0, 1.0, 1.0), SIZE, "focal length is -1 px; it must be positive"),
        ("PINHOLE", (1.0, np.nan, 1.0, 1.0), SIZE, "NaN"),
        ("PINHOLE", (1.0, 1.0, 1.0, 1.0), (0, 5), "at least 1 pixel"),
    ],
)
def test_bad_lenses_are_told(model, params, size, words):
    with pytest.raises(CaptureError, match=words):
        Lens(model, params, *size)


def test_all_but_the_sphere_are_known():
    assert set(MODELS) <= set(known_models())
    assert len(known_models()) >= 11
