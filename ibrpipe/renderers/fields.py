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
    slopes : (4,) float64
        Least and greatest change of depth per cell along u, then along v.
    leaves : (height, cells, corners, masks)
        Texel heights of a height field (then `cells` is empty), or the patch of every cell (-1 = none).
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
    slopes: Array
    nodes: Array
    meta: Array
    leaves: tuple[Array, Array, Array, Array]
    samples: Array
    color: Array

    @property
    def axis(self) -> Array:
        """(3,) float64 unit world direction in which depth grows (along a perspective frame's optical axis)."""
        axis = self.linear[3] if self.shift[3] == 0.0 else np.linalg.inv(self.linear[:3])[:, 2]
        unit: Array = axis / np.linalg.norm(axis)
        return unit

    @property
    def bytes(self) -> int:
        """Bytes held beyond the source itself."""
        own = self.nodes.nbytes + self.leaves[1].nbytes
        return own + self.linear.nbytes + self.meta.nbytes


def build_fields(source: Source) -> list[Field]:
    """Build the fields of one source: one per sheet, patches that lie one behind the other are on different sheets.

    Raises
    ------
    RendererError
        The source is of a kind that has no field.
    """
    if isinstance(source, SpiralTexture):
        source = source.layers
    if isinstance(source, ReliefTexture):
        return [_height_field(source)] if min(source.height.shape) > 1 else _layer_fields(_thin_layers(source), np.inf)
    if isinstance(source, DepthImage):
        return _layer_fields(_depth_layers(source), UNKNOWN_GAP)
    if isinstance(source, LayeredDepthImage):
        return _layer_fields(source, UNKNOWN_GAP)
    raise RendererError(
        f"cannot render a {type(source).__name__}; give a ReliefTexture, DepthImage, LayeredDepthImage, "
        "SpiralTexture, Asset, or a list of these"
    )


def _transform(frame: ParallelFrame | Camera, first_u: float, first_v: float) -> tuple[Array, Array, Array]:
    """Return (linear, origin, shift): texel coordinates (first_u, first_v) become cell coordinates (0, 0)."""
    linear, shift = np.zeros((4, 3)), np.zeros(4)
    if isinstance(frame, Camera):
        linear[[0, 1, 3]] = frame.K @ frame.R
        linear[0] -= first_u * linear[3]
        linear[1] -= first_v * linear[3]
        shift[2] = -1.0
        return linear, frame.center, shift
    linear[:3] = frame.local_from_world
    shift[:] = (-first_u, -first_v, 0.0, 1.0)
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
    linear, origin, shift = _transform(source.frame, 0.5, 0.5)
    leaves = (height, np.empty(0, np.int32), np.empty((0, 4), np.float32), np.empty(0, np.uint8))
    box = np.array([columns, rows, low, high])
    samples = np.empty((0, 4), np.int32)
    return Field(linear, origin, shift, box, grid, False, np.zeros(4), nodes, meta, leaves, samples, source.color)


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


def _layer_fields(layers: LayeredDepthImage, gap: float) -> list[Field]:
    columns = layers.shape[1]
    depth, step, margin = _steps(layers)
    samples, cell = _patches(layers, depth, step, margin, gap)
    corners, masks = np.empty((len(samples), 4), np.float32), np.empty(len(samples), np.uint8)
    patches.fill_corners(samples, depth, step, corners, masks)
    near, far = np.empty(len(samples)), np.empty(len(samples))
    patches.measure_patches(corners, masks, near, far)
    fields = []
    for chosen in _sheets(cell, near + far):
        first_row, first_column = (cell[chosen] // (columns + 1)).min(), (cell[chosen] % (columns + 1)).min()
        row, column = cell[chosen] // (columns + 1) - first_row, cell[chosen] % (columns + 1) - first_column
        cells = np.full((row.max() + 1, column.max() + 1), -1, np.int32)
        cells[row, column] = chosen
        grid, low, high = _grid(float(near[chosen].min()), float(far[chosen].max()))
        meta = quadtree.plan_levels(*cells.shape)
        nodes = np.empty(meta[-1, 0] + 1, np.uint32)
        patches.pack_patches(cells.ravel(), near, far, grid[0], grid[1], nodes)
        quadtree.build_levels(nodes, meta)
        place = _transform(layers.frame, first_column - 0.5, first_row - 0.5)
        box = np.array([cells.shape[1], cells.shape[0], low, high])
        leaves = (np.empty((0, 0), np.float32), cells.ravel(), corners, masks)
        slopes = _slopes(corners[chosen])
        fields.append(Field(*place, box, grid, True, slopes, nodes, meta, leaves, samples, layers.color))
    return fields


def _patches(layers: LayeredDepthImage, depth: Array, step: Array, margin: Array, gap: float) -> tuple[Array, Array]:
    """Return samples (P, 4) int32 of every patch by corner, and the cell (P,) int64 of every patch."""
    rows, columns = layers.shape
    links = np.full((4, len(depth)), -1, np.int32)
    patches.link_samples(layers.offsets, depth, step, margin, gap, links)
    counts = np.empty((rows + 1, columns + 1), np.int32)
    patches.group_cells(layers.offsets, links, np.empty(0, np.int64), counts, np.empty((0, 4), np.int32))
    starts = np.concatenate([[0], np.cumsum(counts, dtype=np.int64)])
    samples = np.empty((int(starts[-1]), 4), np.int32)
    patches.group_cells(layers.offsets, links, starts, counts, samples)
    return samples, np.repeat(np.arange(counts.size), counts.ravel())


def _sheets(cell: Array, depth: Array) -> list[Array]:
    """Return the patches of each sheet: of every cell the nearest, the second nearest, and so on."""
    order = np.lexsort((depth, cell))
    new = np.r_[True, np.diff(cell[order]) > 0][: len(order)]
    starts = np.flatnonzero(new)
    rank = np.arange(len(order)) - np.repeat(starts, np.diff(np.r_[starts, len(order)]))
    return [order[rank == k] for k in range(int(rank.max(initial=-1)) + 1)]


def _slopes(corners: Array) -> Array:
    """Return least and greatest change of depth per cell along u, then along v, of bilinear patches (P, 4)."""
    c = corners.astype(np.float64)
    along_u, along_v = (
        np.stack([c[:, 1] - c[:, 0], c[:, 3] - c[:, 2]]),
        np.stack([c[:, 2] - c[:, 0], c[:, 3] - c[:, 1]]),
    )
    return np.array([along_u.min(), along_u.max(), along_v.min(), along_v.max()])
