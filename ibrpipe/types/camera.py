"""Pinhole cameras and parallel frames."""

from __future__ import annotations

import math
import numbers
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from ibrpipe.errors import ValueRangeError
from ibrpipe.types.arrays import Array, finite_array, numbers_of

#: pixels of a picture at the most
MOST_PIXELS = 1 << 30


@dataclass(frozen=True, eq=False)
class Camera:
    """A pinhole camera.

    Attributes
    ----------
    K : (3, 3) float64
        Calibration matrix in pixels; last row 0 0 1. Pixel (0, 0)'s centre is at (0.5, 0.5).
    cam_from_world : (3, 4) float64
        Rotation and translation, world to camera, OpenCV axes, scene units.
    width, height : int
        Size in pixels.

    Raises
    ------
    ShapeError, ValueRangeError
        Wrong shapes, NaN, a size below 1, a focal length that is not positive, or a left part that is no rotation.
    """

    K: Array
    cam_from_world: Array
    width: int
    height: int

    def __repr__(self) -> str:
        """Return size, focal length and place."""
        size, focal = f"{self.width} x {self.height}", f"focal length {self.K[0, 0]:.6g} pixels"
        return f"Camera({size}, {focal}, at {numbers_of(self.center)})"

    def __post_init__(self) -> None:
        object.__setattr__(self, "K", finite_array("K", self.K, (3, 3)))
        object.__setattr__(self, "cam_from_world", finite_array("cam_from_world", self.cam_from_world, (3, 4)))
        for name in ("width", "height"):
            object.__setattr__(self, name, _pixels(name, getattr(self, name)))
        if self.width < 1 or self.height < 1:
            raise ValueRangeError(f"camera size is {self.width} x {self.height}; both must be at least 1 pixel")
        if self.width * self.height > MOST_PIXELS:
            raise ValueRangeError(
                f"camera size is {self.width} x {self.height}; at most {MOST_PIXELS >> 20} megapixels are rendered"
            )
        if not (self.K[0, 0] > 0 and self.K[1, 1] > 0):
            raise ValueRangeError(f"focal lengths are {self.K[0, 0]}, {self.K[1, 1]} px; both must be positive")
        if not np.allclose(self.K[2], (0.0, 0.0, 1.0)) or self.K[1, 0] != 0.0:
            raise ValueRangeError("K must be upper triangular with last row 0 0 1")
        if np.abs(self.R @ self.R.T - np.eye(3)).max() > 1e-4 or np.linalg.det(self.R) < 0:
            raise ValueRangeError("the left 3x3 of cam_from_world must be a rotation (orthonormal, determinant +1)")

    @property
    def R(self) -> Array:
        """Rotation, world to camera, (3, 3) float64."""
        return self.cam_from_world[:, :3]

    @property
    def t(self) -> Array:
        """Translation, world to camera, (3,) float64."""
        return self.cam_from_world[:, 3]

    @property
    def center(self) -> Array:
        """Centre of projection in the world, (3,) float64."""
        return -self.R.T @ self.t

    @property
    def pixel_from_world(self) -> Array:
        """(3, 4) float64: this @ (X, Y, Z, 1) of a world point is (x z, y z, z), pixel (x, y) and camera z."""
        return self.K @ self.cam_from_world

    @property
    def cam_from_pixel(self) -> Array:
        """(3, 3) float64: direction of pixel (x, y) in the camera's frame is this @ (x, y, 1); its z is 1."""
        return np.linalg.inv(self.K)

    @property
    def world_from_pixel(self) -> Array:
        """(3, 3) float64: world direction of pixel (x, y) is this @ (x, y, 1); its camera z is 1."""
        return self.R.T @ self.cam_from_pixel

    def pixel_centers(self) -> Array:
        """Coordinates x, y of all pixels' centres in the picture, (H, W, 2) float64 pixels."""
        return np.stack(np.meshgrid(np.arange(self.width) + 0.5, np.arange(self.height) + 0.5), axis=-1)

    def pixel_rays(self, pixels: ArrayLike | None = None, frame: Literal["world", "camera"] = "world") -> Array:
        """Directions of the rays through points of the picture, (..., 3) float64; their camera z is 1.

        Parameters
        ----------
        pixels : (..., 2) array_like, optional
            x, y in pixels; pixel (0, 0)'s centre is at (0.5, 0.5). All pixels' centres if not given: (H, W, 3).
        frame : {"world", "camera"}
            Whose axes the directions are in.
        """
        points = self.pixel_centers() if pixels is None else np.asarray(pixels, np.float64)
        matrix = self.world_from_pixel if frame == "world" else self.cam_from_pixel
        return np.concatenate([points, np.ones((*points.shape[:-1], 1))], axis=-1) @ matrix.T

    def resized(self, width: int, height: int) -> Camera:
        """Return the same view at another size in pixels."""
        scale = np.diag([width / self.width, height / self.height, 1.0])
        return Camera(scale @ self.K, self.cam_from_world, width, height)

    @classmethod
    def look_at(
        cls,
        eye: ArrayLike,
        target: ArrayLike,
        up: ArrayLike = (0.0, 0.0, 1.0),
        fov_y_deg: float = 40.0,
        width: int = 640,
        height: int = 480,
    ) -> Camera:
        """Return a camera at `eye` looking at `target`, with world vector `up` pointing up in the picture."""
        _check_view(eye, target, up, fov_y_deg)
        eye64, forward = np.asarray(eye, float), np.asarray(target, float) - np.asarray(eye, float)
        length = np.linalg.norm(forward)
        if not length > 0:
            raise ValueRangeError("eye and target are the same point; move one of them")
        forward = forward / length
        right = np.cross(forward, np.asarray(up, float))
        if np.linalg.norm(right) < 1e-12:
            right = np.cross(forward, (0.0, 1.0, 0.0) if abs(forward[1]) < 0.9 else (1.0, 0.0, 0.0))
        right = right / np.linalg.norm(right)
        R = np.stack([right, np.cross(forward, right), forward])
        focal = height / (2.0 * np.tan(np.radians(fov_y_deg) / 2.0))
        K = [[focal, 0.0, width / 2.0], [0.0, focal, height / 2.0], [0.0, 0.0, 1.0]]
        return cls(np.array(K), np.concatenate([R, (-R @ eye64)[:, None]], axis=1), width, height)


def _check_view(eye: ArrayLike, target: ArrayLike, up: ArrayLike, fov_y_deg: float) -> None:
    for name, value in (("eye", eye), ("target", target), ("up", up)):
        finite_array(name, value, (3,))
    if not isinstance(fov_y_deg, numbers.Real) or not 0 < fov_y_deg < 180:
        raise ValueRangeError(f"fov_y_deg is {fov_y_deg!r}; it must be more than 0 and less than 180 degrees")


def _pixels(name: str, value: object) -> int:
    """Return a size as a whole number."""
    number = float(value) if isinstance(value, numbers.Real) else math.nan
    if not number.is_integer():
        raise ValueRangeError(f"{name} is {value!r}; it must be a whole number of pixels")
    return int(number)


@dataclass(frozen=True, eq=False)
class ParallelFrame:
    """A parallel projection: ``X = origin + u*a + v*b + d*f`` (oliveira2000, fig. 4).

    Attributes
    ----------
    origin : (3,) float64
        World point of u = v = d = 0, the outer corner of texel (0, 0), whose centre is at u = v = 0.5.
    a, b : (3,) float64
        World vectors of one texel along u (columns) and v (rows); they need not be orthogonal.
    f : (3,) float64
        Unit vector along which depth (or height) d is counted, scene units; need not be orthogonal to a and b.
    """

    origin: Array
    a: Array
    b: Array
    f: Array

    def __repr__(self) -> str:
        """Return origin, directions of the texels and of depth."""
        return (
            f"ParallelFrame(origin {numbers_of(self.origin)}, a {numbers_of(self.a)}, b {numbers_of(self.b)}, "
            f"f {numbers_of(self.f)})"
        )

    def __post_init__(self) -> None:
        for name in ("origin", "a", "b", "f"):
            object.__setattr__(self, name, finite_array(name, getattr(self, name), (3,)))
        if abs(np.linalg.norm(self.f) - 1.0) > 1e-6:
            raise ValueRangeError(f"f must be a unit vector, got length {np.linalg.norm(self.f)}; normalise it")
        volume = abs(np.linalg.det(self.world_from_local))
        if not volume > 1e-9 * np.linalg.norm(self.a) * np.linalg.norm(self.b):
            raise ValueRangeError("a, b and f are linearly dependent: the support rectangle is degenerate")

    @property
    def world_from_local(self) -> Array:
        """(3, 3) float64 matrix with columns a, b, f."""
        return np.stack([self.a, self.b, self.f], axis=1)

    @property
    def local_from_world(self) -> Array:
        """(3, 3) float64 inverse of `world_from_local`; apply it to X - origin."""
        return np.linalg.inv(self.world_from_local)
