"""Fields: what the ray search needs of one source, built once by `prepare`.

A field is a grid of cells with bilinear patches in homogeneous coordinates (see :mod:`ibrpipe.core.rays`), the pyramid
of their depth bounds, and the world-to-field matrix.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ibrpipe.core import patches, quadtree
from ibrpipe.errors import RendererError
from ibrpipe.types import Array, Camera, DepthImage, LayeredDepthImage, ParallelFrame, ReliefTexture, SpiralTexture

#: steps between neighbours of unknown normal, in texels, above which they are not connected
UNKNOWN_GAP = 4.0
#: steepest slope that a normal may predict, in texels of depth per texel
STEEPEST = 4.0

Source = ReliefTexture | DepthImage | LayeredDepthImage | SpiralTexture


@dataclass(frozen=True, eq=False)
class Field:
    """One source made ready for the ray search.

    Attributes
    ----------
    linear, origin, shift : (4, 3), (3,), (4,) float64
        Homogeneous field coordinates of a world point X are ``linear @ (X - origin) + shift``.
    box : (4,) float64
        Columns and rows of cells, least and greatest depth.
    grid : (2,) float64
        Lowest depth of the bounds and steps per depth.
    front : bool
        Only hits where the ray passes to greater depth count.
    nodes, meta : see :mod:`ibrpipe.core.quadtree`
    leaves : (height, starts, corners, masks)
        Texel heights of a height field (then `starts` is empty), or patches per cell.
    samples : (P, 4) int32
        Sample of each patch corner; empty for height fields.
    color : (H, W, 3) or (S, 3) float32
    """

    linear: Array
    origin: Array
    shift: Array
    box: Array
    grid: Array
    front: bool
    nodes: Array
    meta: Array
    leaves: tuple[Array, Array, Array, Array]
    samples: Array
    color: Array

    @property
    def bytes(self) -> int:
        """Bytes held beyond the source itself."""
        own = self.nodes.nbytes + self.samples.nbytes + sum(part.nbytes for part in self.leaves[1:])
        return own + self.linear.nbytes + self.meta.nbytes


def build_field(source: Source) -> Field:
    """Build the field of one source.

    Raises
    ------
    RendererError
        The source is of a kind that has no field.
    """
    if isinstance(source, SpiralTexture):
        source = source.layers
    if isinstance(source, ReliefTexture):
        return _height_field(source) if min(source.height.shape) > 1 else _layer_field(_thin_layers(source), np.inf)
    if isinstance(source, DepthImage):
        return _layer_field(_depth_layers(source), UNKNOWN_GAP)
    if isinstance(source, LayeredDepthImage):
        return _layer_field(source, UNKNOWN_GAP)
    raise RendererError(
        f"cannot render a {type(source).__name__}; give a ReliefTexture, DepthImage, LayeredDepthImage, "
        "SpiralTexture, Asset, or a list of these"
    )


def _transform(frame: ParallelFrame | Camera, first: float) -> tuple[Array, Array, Array]:
    """Return (linear, origin, shift): texel coordinate `first` becomes cell coordinate 0."""
    linear, shift = np.zeros((4, 3)), np.zeros(4)
    if isinstance(frame, Camera):
        linear[[0, 1, 3]] = frame.K @ frame.R
        linear[:2] -= first * linear[3]
        shift[2] = -1.0
        return linear, frame.center, shift
    linear[:3] = frame.local_from_world
    shift[:] = (-first, -first, 0.0, 1.0)
    return linear, frame.origin, shift


def _grid(near: float, far: float) -> tuple[Array, float, float]:
    """Return ((low, scale), least, greatest): the depth range padded, so that its ends are never grazed."""
    if not near <= far:
        return np.array([0.0, 1.0]), 1.0, 0.0
    pad = 1e-4 * (far - near) + 4.0 * float(np.spacing(np.float32(max(abs(near), abs(far), 1e-30))))
    low, high = near - pad, far + pad
    return np.array([low, quadtree.STEPS / (high - low)]), low, high


def _height_field(source: ReliefTexture) -> Field:
    height = source.height
    near, far = np.empty(len(height), np.float32), np.empty(len(height), np.float32)
    quadtree.measure_heights(height, near, far)
    grid, low, high = _grid(float(near.min()), float(far.max()))
    rows, columns = height.shape[0] - 1, height.shape[1] - 1
    meta = quadtree.plan_levels(rows, columns)
    nodes = np.empty(meta[-1, 0] + 1, np.uint32)
    quadtree.pack_heights(height, grid[0], grid[1], nodes)
    quadtree.build_levels(nodes, meta)
    linear, origin, shift = _transform(source.frame, 0.5)
    leaves = (height, np.empty(0, np.int32), np.empty((0, 4), np.float32), np.empty(0, np.uint8))
    box = np.array([columns, rows, low, high])
    samples = np.empty((0, 4), np.int32)
    return Field(linear, origin, shift, box, grid, False, nodes, meta, leaves, samples, source.color)


def _thin_layers(source: ReliefTexture) -> LayeredDepthImage:
    return _single_layers(source.frame, source.height, source.color)


def _depth_layers(source: DepthImage) -> LayeredDepthImage:
    return _single_layers(source.camera, source.depth, source.color)


def _single_layers(frame: ParallelFrame | Camera, depth: Array, color: Array) -> LayeredDepthImage:
    """Return the layered form of one depth per texel, NaN = none; normals unknown."""
    there = np.isfinite(depth)
    ends = np.cumsum(there, dtype=np.int64).reshape(depth.shape)
    offsets = np.concatenate([np.r_[0, ends[:-1, -1]][:, None], ends], axis=1)
    normal = np.full((int(there.sum()), 3), np.nan, np.float32)
    return LayeredDepthImage(frame, offsets, depth[there], color[there], normal)


def _steps(layers: LayeredDepthImage) -> tuple[Array, Array, Array]:
    """Return (depth (S,), step (2, S), margin (2, 2)) in field depth; see :mod:`ibrpipe.core.patches`."""
    frame, normal = layers.frame, layers.normal.astype(np.float64)
    with np.errstate(divide="ignore", invalid="ignore"):
        if isinstance(frame, ParallelFrame):
            depth = layers.depth
            along = normal @ np.stack([frame.a, frame.b, frame.f], axis=1)
            step = -along[:, :2].T / along[:, 2]
            margin = np.array([[np.linalg.norm(frame.a), 0.0], [np.linalg.norm(frame.b), 0.0]])
            texel = np.broadcast_to(margin[:, :1], step.shape)
        else:
            depth = (-1.0 / layers.depth.astype(np.float64)).astype(np.float32)
            texel_u, texel_v = _texel_places(layers)
            pixel = np.stack([texel_u, texel_v, np.ones_like(texel_u)], axis=1)
            along = normal @ frame.world_from_pixel
            step = depth * along[:, :2].T / (along * pixel).sum(axis=1)
            margin = np.array([[0.0, -1.0 / frame.K[0, 0]], [0.0, -1.0 / frame.K[1, 1]]])
            texel = margin[:, 1:] * depth
    return depth, np.clip(step, -STEEPEST * texel, STEEPEST * texel).astype(np.float32), margin


def _texel_places(layers: LayeredDepthImage) -> tuple[Array, Array]:
    """Return u and v (S,) of every sample's texel centre."""
    rows, columns = layers.shape
    counts = np.diff(layers.offsets, axis=1).ravel()
    texel = np.repeat(np.arange(rows * columns), counts)
    return texel % columns + 0.5, texel // columns + 0.5


def _layer_field(layers: LayeredDepthImage, gap: float) -> Field:
    rows, columns = layers.shape
    depth, step, margin = _steps(layers)
    links = np.full((4, len(depth)), -1, np.int32)
    patches.link_samples(layers.offsets, depth, step, margin, gap, links)
    counts = np.empty((rows + 1, columns + 1), np.int32)
    marks, none = np.zeros((2, len(depth)), np.uint8), np.empty((0, 4), np.int32)
    patches.walk_cells(layers.offsets, links, np.empty(0, np.int64), marks, counts, none)
    starts = np.concatenate([[0], np.cumsum(counts, dtype=np.int64)])
    samples = np.empty((int(starts[-1]), 4), np.int32)
    if len(samples):
        marks[:] = 0
        patches.walk_cells(layers.offsets, links, starts, marks, counts, samples)
    corners, masks = np.empty((len(samples), 4), np.float32), np.empty(len(samples), np.uint8)
    patches.fill_corners(samples, depth, step, corners, masks)
    starts = starts.astype(np.int32)
    meta, nodes, grid, low, high = _patch_pyramid(rows + 1, columns + 1, starts, corners, masks)
    linear, origin, shift = _transform(layers.frame, -0.5)
    box = np.array([columns + 1, rows + 1, low, high])
    leaves = (np.empty((0, 0), np.float32), starts, corners, masks)
    return Field(linear, origin, shift, box, grid, True, nodes, meta, leaves, samples, layers.color)


def _patch_pyramid(
    rows: int, columns: int, starts: Array, corners: Array, masks: Array
) -> tuple[Array, Array, Array, float, float]:
    near, far = np.empty(len(masks)), np.empty(len(masks))
    patches.measure_patches(corners, masks, near, far)
    grid, low, high = _grid(near.min(initial=np.inf), far.max(initial=-np.inf))
    meta = quadtree.plan_levels(rows, columns)
    nodes = np.empty(meta[-1, 0] + 1, np.uint32)
    patches.pack_patches(starts, near, far, grid[0], grid[1], nodes)
    quadtree.build_levels(nodes, meta)
    return meta, nodes, grid, low, high
