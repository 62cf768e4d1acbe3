"""What kernels know of a camera."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ibrpipe.types import Array, Camera, Lighting


@dataclass(frozen=True, eq=False)
class View:
    """A camera and the lights as it sees them.

    Attributes
    ----------
    pose : (12,) float64
        Camera from world, 3 x 4 row by row.
    calibration : (3, 3) float64
    near : float
        Nearest depth that is drawn, scene units.
    size : (2,) int
        Width, height.
    lights : (N, 3) float64
        Directions to the lights in the camera's frame.
    lighting : (1 + N, 3) float64
        Ambient light, colours of the lights.
    """

    pose: Array
    calibration: Array
    near: float
    size: tuple[int, int]
    lights: Array
    lighting: Array

    def limits(self, pixel_error: float) -> Array:
        """(9,) float64 as `ibrpipe.core.hierarchy.traverse.choose` takes them."""
        width, height = self.size
        corners = np.array([(x, y, 1.0) for x in (0.0, width) for y in (0.0, height)])
        slopes = corners @ np.linalg.inv(self.calibration).T
        focal = max(self.calibration[0, 0], self.calibration[1, 1])
        low, high = slopes.min(axis=0), slopes.max(axis=0)
        return np.array([focal, self.near, 1.0 / pixel_error, low[0], high[0], low[1], high[1], 0.0, 0.0])


def view_of(camera: Camera, lighting: Lighting, near: float) -> View:
    """Return what kernels need of `camera`, under `lighting`."""
    directions = np.array([light.direction for light in lighting.lights]).reshape(-1, 3)
    colors = np.array([light.color for light in lighting.lights]).reshape(-1, 3)
    return View(
        np.ascontiguousarray(camera.cam_from_world).ravel().copy(),
        np.array(camera.K),
        near,
        (camera.width, camera.height),
        np.ascontiguousarray(directions @ camera.R.T),
        np.concatenate([lighting.ambient[None], colors]),
    )
