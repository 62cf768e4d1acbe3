"""Where an asset is, and where cameras look."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ibrpipe.errors import ValueRangeError
from ibrpipe.types.arrays import Array
from ibrpipe.types.camera import Camera
from ibrpipe.types.texture import Texture
from ibrpipe.types.textures import LayeredDepthImage

#: What the names of textures begin with that stand for what lies behind all surface
BACKGROUND = "background"


def bounds_of(textures: Sequence[Texture], info: Mapping[str, Any]) -> tuple[Array, Array]:
    """Return the lowest and highest corner (3,) of all samples, world; a background does not count.

    Raises
    ------
    ValueRangeError
        There is no sample.
    """
    points = placed_samples(textures, info)
    if not len(points):
        raise ValueRangeError("the asset holds no sample, so there is nothing to look at; make it anew")
    return points.min(axis=0), points.max(axis=0)


def placed_samples(textures: Sequence[Texture], info: Mapping[str, Any]) -> Array:
    """World positions (S, 3) float64 of the samples of all textures but those of a background."""
    entries = info.get("textures") or [{}] * len(textures)
    placed = [
        sample_positions(texture.layers)
        for texture, entry in zip(textures, entries, strict=True)
        if not str(entry.get("name", "")).startswith(BACKGROUND)
    ]
    return np.concatenate([np.zeros((0, 3)), *placed])


def ball_around(points: Array) -> tuple[Array, float]:
    """Return the middle (3,) of the box around points (N, 3), N > 0, and how far they are from it; 1 instead of 0."""
    center = 0.5 * (points.min(axis=0) + points.max(axis=0))
    return center, float(np.linalg.norm(points - center, axis=1).max()) or 1.0


def meeting_point(cameras: Sequence[Camera]) -> tuple[Array, float]:
    """Return the point nearest to all cameras' axes, and the distance of the farthest camera."""
    centers = np.stack([camera.center for camera in cameras])
    axes = np.stack([camera.R[2] for camera in cameras])
    across = np.eye(3) - axes[:, :, None] * axes[:, None, :]
    matrix, target = across.sum(axis=0), (across @ centers[:, :, None]).sum(axis=0)[:, 0]
    point = np.linalg.lstsq(matrix, target, rcond=None)[0]
    radius = float(np.linalg.norm(centers - point, axis=1).max())
    grain = 1e-6 * radius  # the last bits differ from run to run
    return np.round(point / grain) * grain, float(np.round(radius / grain) * grain)


def sample_positions(layers: LayeredDepthImage) -> Array:
    """World positions (S, 3) float64 of the samples of a layered depth image."""
    counts = np.diff(layers.offsets, axis=1)
    row, column = np.repeat(np.indices(counts.shape).reshape(2, -1), counts.ravel(), axis=1) + 0.5
    depth = layers.depth.astype(np.float64)
    if isinstance(layers.frame, Camera):
        rays = layers.frame.pixel_rays(np.stack([column, row], axis=1))
        return layers.frame.center + depth[:, None] * rays
    return layers.frame.origin + np.stack([column, row, depth], axis=1) @ layers.frame.world_from_local.T
