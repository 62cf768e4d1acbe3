"""Points that tie the photos of a dense workspace together.

COLMAP's fusion asks the model's points which photos see the same surface; a model without points fuses to nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from ibrpipe.io.cameras.colmap_write import ModelImage, SparseModel
from ibrpipe.io.cameras.lenses import Lens
from ibrpipe.types import Array, Camera

#: pixels of each depth map that become points, about
SAMPLES = 150
#: most difference of depth with which a photo sees a point, share
AGREES = 0.01


def samples_of(camera: Camera, depth: Array) -> Array:
    """Return world points (N, 3) at even pixels of a depth map (H, W), 0 = unknown."""
    step = max(1, int((depth.size / SAMPLES) ** 0.5))
    row, column = np.nonzero(depth[step // 2 :: step, step // 2 :: step] > 0)
    row, column = row * step + step // 2, column * step + step // 2
    rays = camera.pixel_rays(np.stack([column, row], axis=1) + 0.5)
    return camera.center + depth[row, column, None].astype(np.float64) * rays


def seen_in(camera: Camera, depth: Array, points: Array) -> tuple[Array, Array]:
    """Return which points (N, 3) a depth map (H, W) shows (M,), and where (M, 2), pixels."""
    x, y, z = camera.K @ (camera.R @ points.T + camera.t.reshape(3, 1))
    ahead = z > 0
    pixel = np.stack([x, y], axis=1) / np.where(ahead, z, 1.0)[:, None]
    inside = ahead & (pixel >= 0).all(axis=1) & (pixel < (depth.shape[1], depth.shape[0])).all(axis=1)
    index = np.flatnonzero(inside)
    found = depth[pixel[index, 1].astype(int), pixel[index, 0].astype(int)]
    index = index[np.abs(found - z[index]) <= AGREES * z[index]]
    return index, pixel[index]


def tied_model(names: Sequence[str], cameras: Sequence[Camera], read: Callable[[int], Array]) -> SparseModel:
    """Return the model of photos and the points of their depth maps that at least two of them show.

    Parameters
    ----------
    names : sequence of str
    cameras : sequence of Camera
        Of the size of the maps.
    read : callable
        Returns the depth map (H, W) of a photo by its number; 0 = unknown. One at a time, twice each.
    """
    points = np.concatenate([samples_of(camera, read(number)) for number, camera in enumerate(cameras)])
    images = []
    for number, (name, camera) in enumerate(zip(names, cameras, strict=True)):
        index, pixel = seen_in(camera, read(number), points)
        images.append(ModelImage(name, number, np.asarray(camera.cam_from_world), pixel, index))
    lenses = tuple(Lens("PINHOLE", (c.K[0, 0], c.K[1, 1], c.K[0, 2], c.K[1, 2]), c.width, c.height) for c in cameras)
    grey = np.full((len(points), 3), 128, np.uint8)
    return SparseModel(lenses, tuple(images), points, grey, np.zeros(len(points))).only(names)
