"""Camera models with distortion: which pinhole camera replaces one, and where each of its pixels is in the photo.

Models and parameter orders are COLMAP's; the projection itself is pycolmap's own, so every perspective and fisheye
model that pycolmap knows works here.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Literal

import numpy as np

from ibrpipe.errors import CaptureError
from ibrpipe.native_imports import import_pycolmap
from ibrpipe.types import Array, Camera

Keep = Literal["all", "inside"]

#: An undistorted picture reaches at most this far from the axis (tangent of 60 degrees): fisheye rims are cut
WIDEST = math.sqrt(3.0)
#: ... and is at most this many times as wide or high as the photo
LARGEST = 2.0
#: Larger sizes are taken as damage
WIDEST_PHOTO = 200_000
_PINHOLES = ("SIMPLE_PINHOLE", "PINHOLE")
_EDGE_SAMPLES = 257


@dataclass(frozen=True)
class Lens:
    """A camera model without its pose.

    Attributes
    ----------
    model : str
        COLMAP's name, such as PINHOLE, SIMPLE_RADIAL, OPENCV_FISHEYE.
    params : tuple of float
        In COLMAP's order, pixels; pixel (0, 0)'s centre is at (0.5, 0.5).
    width, height : int
        Size of the photo in pixels.

    Raises
    ------
    CaptureError
        Unknown model, wrong number of parameters, NaN, a focal length or size that is not positive.
    """

    model: str
    params: tuple[float, ...]
    width: int
    height: int

    def __post_init__(self) -> None:
        if not (1 <= self.width <= WIDEST_PHOTO and 1 <= self.height <= WIDEST_PHOTO):
            size = f"{self.width} x {self.height}"
            raise CaptureError(f"camera size is {size}; both must be at least 1 pixel and at most {WIDEST_PHOTO}")
        if not all(math.isfinite(value) for value in self.params):
            raise CaptureError(f"camera parameters {list(self.params)} hold NaN or infinity; calibrate again")
        focal = _focal_lengths(self)
        if min(focal) <= 0:
            raise CaptureError(f"focal length is {min(focal):g} px; it must be positive, calibrate again")

    @property
    def distorted(self) -> bool:
        """Whether photos must be resampled to become a pinhole camera's."""
        if self.model in _PINHOLES:
            return False
        camera = _camera(self)
        return not (camera.is_perspective_pinhole() and camera.is_undistorted())

    @property
    def K(self) -> Array:
        """(3, 3) float64 calibration matrix, leaving distortion aside."""
        return np.asarray(_camera(self).calibration_matrix(), np.float64)


def pinhole_lens(camera: Camera) -> Lens:
    """Return the lens of a camera without skew."""
    params = (camera.K[0, 0], camera.K[1, 1], camera.K[0, 2], camera.K[1, 2])
    return Lens("PINHOLE", tuple(map(float, params)), camera.width, camera.height)


def known_models() -> tuple[str, ...]:
    """Names of all camera models that can be turned into a pinhole camera."""
    names = import_pycolmap().CameraModelId.__members__
    return tuple(name for name in names if name not in ("INVALID", "EQUIRECTANGULAR"))


def model_by_id(number: int) -> tuple[str, int]:
    """Name and number of parameters of the camera model that COLMAP's binary files call `number`.

    Raises
    ------
    CaptureError
        There is no such model, or it cannot be turned into a pinhole camera.
    """
    pycolmap = import_pycolmap()
    for name in known_models():
        if int(getattr(pycolmap.CameraModelId, name)) == number:
            return name, len(pycolmap.Camera.create_from_model_name(1, name, 1.0, 1, 1).params)
    raise CaptureError(
        f"camera model number {number} is not known; expected one of {', '.join(known_models())}: "
        "convert or undistort the photos first"
    )


def undistorted_calibration(lens: Lens, keep: Keep = "all") -> tuple[Array, int, int]:
    """Choose the pinhole camera that replaces a distorted one.

    The focal lengths stay, so that the picture's centre keeps its resolution; size and principal point follow from what
    is kept.

    Parameters
    ----------
    lens : Lens
    keep : {"all", "inside"}
        "all": every pixel of the photo (within 60 degrees of the axis, at most twice the photo's size); the picture has
        empty margins, which the mask leaves out. "inside": the largest centred part without empty margins.

    Returns
    -------
    K : (3, 3) float64
    width, height : int
    """
    K = lens.K
    if not lens.distorted:
        return K, lens.width, lens.height
    edges = [_edge(lens, side) for side in ("left", "right", "top", "bottom")]
    outer = keep == "all"
    left = _bound(edges[0][:, 0], -1, outer)
    right = _bound(edges[1][:, 0], 1, outer)
    top = _bound(edges[2][:, 1], -1, outer)
    bottom = _bound(edges[3][:, 1], 1, outer)
    width = _size(K[0, 0] * (right - left), lens.width)
    height = _size(K[1, 1] * (bottom - top), lens.height)
    center_x = _principal(K[0, 0], left, right, width)
    center_y = _principal(K[1, 1], top, bottom, height)
    return np.array([[K[0, 0], 0.0, center_x], [0.0, K[1, 1], center_y], [0.0, 0.0, 1.0]]), width, height


def photo_positions(lens: Lens, camera: Camera) -> tuple[Array, Array]:
    """Where each pixel centre of a pinhole `camera` lies in the photo taken by `lens`.

    Returns
    -------
    x, y : (H, W) float32
        Photo coordinates counted from the *centre* of pixel (0, 0), as OpenCV's remap counts; -1e4 outside the photo.
    """
    rays = camera.pixel_rays(camera.pixel_centers().reshape(-1, 2), "camera")
    found = np.asarray(_camera(lens).img_from_cam(rays), np.float64)
    with np.errstate(invalid="ignore"):
        inside = (found >= 0).all(axis=1) & (found[:, 0] <= lens.width) & (found[:, 1] <= lens.height)
    inside &= _returns(lens, rays, found, inside)
    found = np.where(inside[:, None], found - 0.5, -1e4).astype(np.float32)
    shape = (camera.height, camera.width)
    return found[:, 0].reshape(shape), found[:, 1].reshape(shape)


def directions_of(lens: Lens, pixels: Array) -> Array:
    """Where what photo pixels show lies on the plane z = 1 before the camera.

    Parameters
    ----------
    lens : Lens
    pixels : (N, 2) float64
        Pixel (0, 0)'s centre is at (0.5, 0.5).

    Returns
    -------
    (N, 2) float64
        NaN where the lens shows nothing.
    """
    return np.asarray(_camera(lens).cam_from_img(np.ascontiguousarray(pixels, np.float64)), np.float64)


def project(lens: Lens, points: Array) -> Array:
    """Where a lens shows points (N, 3) of the camera's own axes, (N, 2) float64 pixels; NaN behind the camera."""
    return np.asarray(_camera(lens).img_from_cam(np.ascontiguousarray(points, np.float64)), np.float64)


def _returns(lens: Lens, rays: Array, found: Array, inside: Array) -> Array:
    """Say which photo positions lead back to their ray: polynomials fold far rays over into the picture."""
    back = np.full((len(rays), 2), np.nan)
    back[inside] = np.asarray(_camera(lens).cam_from_img(np.ascontiguousarray(found[inside])), np.float64)
    with np.errstate(invalid="ignore"):
        return np.abs(back - rays[:, :2]).max(axis=1) < 1e-4 * (1.0 + np.abs(rays[:, :2]).max(axis=1))


def _edge(lens: Lens, side: str) -> Array:
    """Positions on the plane z = 1 of points along one edge of the photo, (N, 2) float64, NaN where none exists."""
    along = np.linspace(0.0, 1.0, _EDGE_SAMPLES)
    fixed = {"left": 0.0, "right": float(lens.width), "top": 0.0, "bottom": float(lens.height)}[side]
    upright = side in ("left", "right")
    varying = along * (lens.height if upright else lens.width)
    constant = np.full(_EDGE_SAMPLES, fixed)
    points = np.stack([constant, varying] if upright else [varying, constant], axis=1)
    return np.asarray(_camera(lens).cam_from_img(points), np.float64)


def _bound(values: Array, sign: int, outer: bool) -> float:
    """Farthest (or nearest, for "inside") of an edge's coordinates on its own side of the axis, within `WIDEST`."""
    distance = np.where(np.isfinite(values), sign * values, WIDEST)
    distance = np.clip(np.where(distance > 0, distance, WIDEST), 1e-3, WIDEST)
    return sign * float(distance.max() if outer else distance.min())


def _size(extent: float, photo: int) -> int:
    return max(1, min(math.ceil(extent - 1e-6), math.ceil(LARGEST * photo)))


def _principal(focal: float, low: float, high: float, size: int) -> float:
    """Principal point that centres the kept interval in `size` pixels."""
    return size / 2.0 - focal * (low + high) / 2.0


def _focal_lengths(lens: Lens) -> tuple[float, ...]:
    camera = _camera(lens)
    return tuple(float(lens.params[i]) for i in camera.focal_length_idxs())


@lru_cache(maxsize=64)
def _camera(lens: Lens) -> Any:
    pycolmap = import_pycolmap()
    if lens.model not in known_models():
        raise CaptureError(
            f"camera model {lens.model!r} is not known; expected one of {', '.join(known_models())}: "
            "convert or undistort the photos first"
        )
    expected = len(pycolmap.Camera.create_from_model_name(1, lens.model, 1.0, 1, 1).params)
    if len(lens.params) != expected:
        raise CaptureError(
            f"camera model {lens.model} takes {expected} parameters, got {len(lens.params)}: {list(lens.params)}"
        )
    return pycolmap.Camera(model=lens.model, width=lens.width, height=lens.height, params=list(lens.params))
