"""How the samples of layered depth images lie in memory, and layered images of one depth per texel."""

from __future__ import annotations

import numpy as np

from ibrpipe.types.arrays import Array
from ibrpipe.types.camera import Camera, ParallelFrame
from ibrpipe.types.textures import LayeredDepthImage, ReliefTexture


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


def layers_of_relief(relief: ReliefTexture) -> LayeredDepthImage:
    """Return the layered form of a relief texture: one sample per opaque texel, seen from where its f points."""
    frame = relief.frame
    flipped = ParallelFrame(frame.origin, frame.a, frame.b, -frame.f)
    return single_layer(flipped, -relief.height, relief.color, relief_normals(relief), observed=True)


def relief_normals(relief: ReliefTexture) -> Array:
    """Return (H, W, 3) float32 unit normals on the side of f; one-sided steps beside holes, level where all are."""
    frame, tangents = relief.frame, []
    for axis, texel in ((1, frame.a), (0, frame.b)):
        step = _slopes(relief.height.astype(np.float64), axis)
        tangents.append(texel + step[..., None] * frame.f)
    normal = np.cross(*tangents) * np.sign(np.linalg.det(frame.world_from_local))
    length = np.linalg.norm(normal, axis=-1, keepdims=True)
    return (normal / np.where(length > 0, length, np.nan)).astype(np.float32)


def _slopes(height: Array, axis: int) -> Array:
    """Mean of the steps to both neighbours along an axis, the one that exists, or 0."""
    step = np.diff(height, axis=axis)
    edge = np.full_like(np.take(height, [0], axis), np.nan)
    both = np.stack([np.concatenate([edge, step], axis), np.concatenate([step, edge], axis)])
    known = np.isfinite(both)
    return np.where(known, both, 0.0).sum(axis=0) / np.maximum(known.sum(axis=0), 1)
