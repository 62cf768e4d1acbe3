"""How the samples of layered depth images lie in memory, and layered images of one depth per texel."""

from __future__ import annotations

import numpy as np

from ibrpipe.types.arrays import Array
from ibrpipe.types.camera import Camera, ParallelFrame
from ibrpipe.types.textures import LayeredDepthImage


def offsets_of(counts: Array) -> Array:
    """Return the offsets (H, W + 1) int64 of textures with `counts` (H, W) samples per texel."""
    ends = np.cumsum(counts, dtype=np.int64).reshape(counts.shape)
    return np.concatenate([np.r_[0, ends[:-1, -1]][:, None], ends], axis=1)


def single_layer(
    frame: ParallelFrame | Camera, depth: Array, color: Array, normal: Array | None = None, observed: bool = False
) -> LayeredDepthImage:
    """Return the layered form of one depth per texel.

    Parameters
    ----------
    frame : ParallelFrame or Camera
    depth : (H, W)
        Scene units; NaN or infinite = no sample.
    color : (H, W, 3)
    normal : (H, W, 3), optional
        Unit; left out = unknown.
    observed : bool
        Whether each sample counts as seen once; otherwise that is unknown.
    """
    there = np.isfinite(depth)
    count = int(there.sum())
    known = np.full((count, 3), np.nan, np.float32) if normal is None else normal[there]
    observers = np.ones(count, np.int32) if observed else None
    return LayeredDepthImage(frame, offsets_of(there), depth[there], color[there], known, observers)


def solid_samples(layers: LayeredDepthImage) -> Array:
    """Return which samples fill at least half of their texel, (S,) bool."""
    if layers.coverage is None:
        return np.ones(len(layers.depth), bool)
    solid: Array = layers.coverage >= 0.5
    return solid


def opaque(layers: LayeredDepthImage) -> LayeredDepthImage:
    """Return layers whose samples fill their texels, without those that fill less than half: for sharp edges."""
    if layers.coverage is None:
        return layers
    kept = solid_samples(layers)
    ends = np.concatenate([[0], np.cumsum(kept, dtype=np.int64)])
    observers = None if layers.observers is None else layers.observers[kept]
    return LayeredDepthImage(
        layers.frame, ends[layers.offsets], layers.depth[kept], layers.color[kept], layers.normal[kept], observers
    )


def pitch_of(layers: LayeredDepthImage) -> float:
    """Return the width of a texel, scene units; of a perspective frame that of the nearest sample, 1 without any."""
    if isinstance(layers.frame, Camera):
        focal = float(max(layers.frame.K[0, 0], layers.frame.K[1, 1]))
        return float(layers.depth.min()) / focal if len(layers.depth) else 1.0
    return float(min(np.linalg.norm(layers.frame.a), np.linalg.norm(layers.frame.b)))
