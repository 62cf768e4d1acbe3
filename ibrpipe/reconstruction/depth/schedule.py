"""The order of work: from coarse to fine, first by the photos alone, then also by the neighbours' depth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ibrpipe.io.views import View
from ibrpipe.reconstruction.depth.settings import DepthConfig
from ibrpipe.types import Array, Camera


@dataclass(frozen=True)
class Pass:
    """One round over all views.

    Attributes
    ----------
    number : int
    shrink : int
        Pictures are this many times smaller than the depth maps.
    consistent : bool
        The neighbours' depth of the round before counts too.
    sweeps : int
    sweep_number : int
        Number of sweeps before; the view selection grows stricter with it.
    reach : float
        How far planes are changed in the first sweep, pixels of motion.
    """

    number: int
    shrink: int
    consistent: bool
    sweeps: int
    sweep_number: int
    reach: float


def map_size(camera: Camera, max_size: int) -> tuple[int, int]:
    """(width, height) of a view's depth map."""
    return shrunk_size(camera.width, camera.height, max(camera.width, camera.height) / max_size)


def shrunk_size(width: int, height: int, shrink: float) -> tuple[int, int]:
    """(width, height) of a picture made `shrink` times smaller; never larger, at least 1."""
    factor = max(shrink, 1.0)
    return max(round(width / factor), 1), max(round(height / factor), 1)


def passes(longest: int, config: DepthConfig) -> tuple[Pass, ...]:
    """Rounds for depth maps whose longest side is `longest` pixels."""
    shrink = 1
    while longest / shrink > config.coarsest:
        shrink *= 2
    found = [Pass(0, shrink, False, config.iterations, 0, 4.0)]
    if config.consistency > 0:
        found += [Pass(1, shrink, True, 2, 10, 0.7), Pass(2, shrink, True, 2, 15, 0.7)]
    while shrink > 1:
        shrink //= 2
        for k in range(2):
            found.append(Pass(len(found), shrink, config.consistency > 0, 1, 20 + 5 * k, 0.7 * 0.6**k))
    return tuple(found)


def rounds_of(cameras: Sequence[Camera], config: DepthConfig) -> tuple[Pass, ...]:
    """Rounds over the views of `cameras`."""
    return passes(max(max(map_size(camera, config.max_size)) for camera in cameras), config)


def megapixels(views: Sequence[View], max_size: int, shrink: int) -> float:
    """Millions of pixels of all views' depth maps, made `shrink` times smaller."""
    sizes = (shrunk_size(*map_size(view.camera, max_size), shrink) for view in views)
    return sum(width * height for width, height in sizes) / 1e6


def enlarged(state: Array, valid: Array) -> Array:
    """Carry planes over to a larger picture.

    Parameters
    ----------
    state : (4, h, w) float32
        Planes q, a, b and their cost; q = 0 is unknown.
    valid : (H, W) uint8

    Returns
    -------
    (4, H, W) float32
        Every valid pixel continues the plane of the nearest known pixel.
    """
    from scipy.ndimage import distance_transform_edt

    height, width = valid.shape
    out = np.zeros((4, height, width), np.float32)
    out[3] = np.inf
    known = state[0] > 0
    if not known.any():
        return out
    nearest = distance_transform_edt(~known, return_distances=False, return_indices=True)
    scale_y, scale_x = state.shape[1] / height, state.shape[2] / width
    y, x = (np.arange(height) + 0.5) * scale_y, (np.arange(width) + 0.5) * scale_x
    at = np.ix_(y.astype(np.int64), x.astype(np.int64))
    row, column = nearest[0][at], nearest[1][at]
    q, a, b, cost = state[:, row, column]
    moved = q + a * (x[None, :] - (column + 0.5)) + b * (y[:, None] - (row + 0.5))
    moved = np.clip(moved, state[0][known].min(), state[0].max())
    planes = np.stack([moved, a * scale_x, b * scale_y, cost]).astype(np.float32)
    return np.where(valid > 0, planes, out)
