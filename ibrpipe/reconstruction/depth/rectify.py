"""Two views turned to a common picture plane, so that a point lies in the same row of both.

The rows run along the line between the centres, whatever its direction, so that cameras beside, above or diagonal to
each other are all the same. A pair whose epipole lies in a picture, or so near that a turned picture would be much
larger than the photo, cannot be matched by rows and is refused.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ibrpipe.types import Array, Camera

#: a turned picture may have this many times the pixels of the part of the photo that it shows
LARGEST = 4.0
#: directions may be this far from the axis of the turned cameras, tangent of the angle
WIDEST = 3.0
#: disparities are searched in whole multiples of this, and where it were more than so many the pictures are shrunk
MULTIPLE, MOST = 16, 512


@dataclass(frozen=True, eq=False)
class Rectified:
    """A view and its partner, turned. Pixel (x, y) of the view is (x - d, y) in the partner; 0 <= d < disparities.

    Attributes
    ----------
    first, second : Camera
        At the centres of both views. Their pictures have one size; the first `disparities` columns of `first` are
        outside the wanted part.
    pixels, partner_pixels : (3, 3) float64
        Pixel of the turned picture, pixel centres at .5, to pixel of the view and of its partner.
    disparities : int
        A multiple of `MULTIPLE`.
    baseline : float
        Distance of the centres, scene units.
    """

    first: Camera
    second: Camera
    pixels: Array
    partner_pixels: Array
    disparities: int
    baseline: float

    @property
    def shift(self) -> float:
        """Disparity of what is infinitely far."""
        return float(self.first.K[0, 2] - self.second.K[0, 2])


def rectified(
    view: Camera, partner: Camera, box: tuple[int, int, int, int], near: float, far: float
) -> Rectified | None:
    """Turn a view and its partner; None where they cannot be matched by rows.

    Parameters
    ----------
    view, partner : Camera
    box : tuple of int
        x0, y0, x1, y1: the part of the view that is wanted, pixels.
    near, far : float
        Depth range of the view, along its z axis.
    """
    apart = view.R @ (partner.center - view.center)
    baseline = float(np.linalg.norm(apart))
    rotation = None if not baseline > 0 else _rotation(apart / baseline, view.R @ partner.R[2])
    if rotation is None:
        return None
    x, y = np.meshgrid(np.linspace(box[0], box[2], 5), np.linspace(box[1], box[3], 5))
    rays = view.pixel_rays(np.stack([x.ravel(), y.ravel()], axis=1), "camera")
    turned = rays @ rotation.T
    if (turned[:, 2] <= np.abs(turned[:, :2]).max(axis=1) / WIDEST).any():
        return None
    flat = turned[:, :2] / turned[:, 2:]
    inverse = np.concatenate([1 / (turned[:, 2] * depth) for depth in (near, far)])
    focal = min(
        _same_area(view, rotation, turned[len(turned) // 2]), MOST / (baseline * float(np.ptp(inverse)) + 1e-12)
    )
    low, high, disparity = flat.min(axis=0) * focal, flat.max(axis=0) * focal, focal * baseline * inverse
    least = float(np.floor(disparity.min())) - 1
    count = MULTIPLE * int(np.ceil((disparity.max() + 2 - least) / MULTIPLE))
    width, height = int(np.ceil(high[0] - low[0])) + count + 1, int(np.ceil(high[1] - low[1])) + 1
    wanted = max((box[2] - box[0]) * (box[3] - box[1]), 1)
    if (width - count) * height > LARGEST * wanted + 4 * (width + height):
        return None
    center = np.array([count - low[0], -low[1]])
    first = _camera(view, rotation, focal, center, width, height)
    second = _camera(partner, rotation @ view.R @ partner.R.T, focal, center + np.array([least, 0]), width, height)
    return Rectified(first, second, _between(first, view), _between(second, partner), count, baseline)


def _rotation(along: Array, other_axis: Array) -> Array | None:
    """Rotation from the view's frame: x along the baseline, z as near as can be to both axes; None where they cross."""
    middle = np.array([0.0, 0.0, 1.0]) + other_axis
    z = middle - (middle @ along) * along
    length = np.linalg.norm(z)
    if other_axis[2] < 0.2 or length < 1e-3:
        return None
    return np.stack([along, np.cross(z / length, along), z / length])


def _same_area(view: Camera, rotation: Array, middle: Array) -> float:
    """Focal length with which a pixel at the direction `middle` (turned frame) is as large as in the view."""
    local = rotation.T @ middle
    there = (np.linalg.norm(middle) / middle[2]) ** 3
    here = (np.linalg.norm(local) / local[2]) ** 3
    return float(np.sqrt(view.K[0, 0] * view.K[1, 1] * here / there))


def _camera(source: Camera, rotation: Array, focal: float, center: Array, width: int, height: int) -> Camera:
    K = np.array([[focal, 0, center[0]], [0, focal, center[1]], [0, 0, 1.0]])
    R = rotation @ source.R
    return Camera(K, np.column_stack([R, -R @ source.center]), width, height)


def _between(turned: Camera, source: Camera) -> Array:
    return source.K @ source.R @ turned.R.T @ turned.cam_from_pixel
