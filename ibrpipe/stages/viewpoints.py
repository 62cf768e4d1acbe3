"""Which cameras a path means for a given asset and capture."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ibrpipe.errors import ConfigError, ValueRangeError
from ibrpipe.io.paths import CameraPath, is_orbit, orbit, parse_orbit, read_path
from ibrpipe.io.views import ViewSet
from ibrpipe.types import Array, Asset, Camera, LayeredDepthImage


def camera_path(text: str, asset: Asset, views: ViewSet) -> CameraPath:
    """Return the cameras that `text` means (see `ibrpipe.io.paths`).

    Raises
    ------
    ConfigError
        The path has no camera.
    """
    own = {"test": views.test, "train": views.train, "all": (*views.train, *views.test)}
    if text in own:
        path: CameraPath = tuple((view.name, view.camera) for view in own[text])
    elif is_orbit(text):
        photos = [view.camera for view in (*views.train, *views.test)]
        path = orbit(parse_orbit(text), asset_bounds(asset), photos)
    else:
        path = read_path(Path(text))
    if not path:
        raise ConfigError(
            f"render: the path {text!r} has no camera; hold photos out (ingest.hold_out_every) or choose train or orbit"
        )
    return path


def asset_bounds(asset: Asset) -> tuple[Array, Array]:
    """Return the lowest and highest corner (3,) of all samples of an asset, world."""
    points = [_sample_positions(texture.layers) for texture in asset.textures]
    points = [each for each in points if len(each)]
    if not points:
        raise ValueRangeError("the asset holds no sample, so there is nothing to look at; make it anew")
    return np.min([each.min(axis=0) for each in points], axis=0), np.max([each.max(axis=0) for each in points], axis=0)


def _sample_positions(layers: LayeredDepthImage) -> Array:
    """World positions (S, 3) of the samples of a layered depth image."""
    counts = np.diff(layers.offsets, axis=1)
    row, column = np.repeat(np.indices(counts.shape).reshape(2, -1), counts.ravel(), axis=1) + 0.5
    depth = layers.depth.astype(np.float64)
    if isinstance(layers.frame, Camera):
        rays = np.stack([column, row, np.ones_like(row)], axis=1) @ layers.frame.world_from_pixel.T
        return layers.frame.center + depth[:, None] * rays
    return layers.frame.origin + np.stack([column, row, depth], axis=1) @ layers.frame.world_from_local.T
