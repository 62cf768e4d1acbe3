"""Fields: what the searches need of one source, built once by `prepare`.

A field is a grid of cells with bilinear patches in homogeneous coordinates (see :mod:`ibrpipe.core.rays`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ibrpipe.core.ldi import patches, project_heights
from ibrpipe.errors import RendererError
from ibrpipe.types import Array, Camera, DepthImage, LayeredDepthImage, ParallelFrame, ReliefTexture, Texture
from ibrpipe.types.layers import single_layer
from ibrpipe.types.renderable import GridSource

#: steps between neighbours of unknown normal, in texels, above which they are not connected
UNKNOWN_GAP = 4.0
#: steepest slope that a normal may predict, in texels of depth per texel
STEEPEST = 4.0
#: the same of samples that fill their texel in part: thin things bend within it, and steep planes stick out as spikes
STEEPEST_RIM = 1.0


@dataclass(frozen=True, eq=False)
class Pose:
    """Where a field lies: homogeneous coordinates of a world point X are ``linear @ (X - origin) + shift``.

    Attributes
    ----------
    linear, origin, shift : (4, 3), (3,), (4,) float64
    perspective : bool
        Field depth is -1/z of a perspective frame, not the depth itself.
    away : bool
        Field depth has its sign turned, so that the surface is met from greater depth.
    """

    linear: Array
    origin: Array
    shift: Array
    perspective: bool
    away: bool = False

    def field_from_pixel(self, camera: Camera) -> tuple[Array, Array]:
        """Rays in homogeneous field coordinates: at camera depth t, ``start + t * directions @ (px, py, 1)``.

        Returns
        -------
        start : (4,) float64
            The eye.
        directions : (4, 3) float64
            Its columns are the directions for px, py and 1.
        """
        return self.linear @ (camera.center - self.origin) + self.shift, self.linear @ camera.world_from_pixel

    def pixel_from_field(self, camera: Camera) -> Array:
        """(3, 4) float64, (u, v, d, 1) to homogeneous pixels; the weight is camera depth (perspective: over own z)."""
        project = camera.K @ camera.R
        offset = project @ (self.origin - camera.center)
        if self.perspective:
            columns = project @ np.linalg.inv(self.linear[[0, 1, 3]])
            return np.stack([columns[:, 0], columns[:, 1], offset if self.away else -offset, columns[:, 2]], axis=1)
        columns = project @ np.linalg.inv(self.linear[:3])
        return np.concatenate([columns, (offset - columns @ self.shift[:3])[:, None]], axis=1)

    def limited(self, low: float, high: float, pad: float) -> tuple[float, float]:
        """Return a range of field depths padded on both sides; in a perspective frame it does not reach infinity, 0."""
        if not self.perspective:
            return low - pad, high + pad
        return (max(low - pad, 0.5 * low), high + pad) if self.away else (low - pad, min(high + pad, 0.5 * high))

    def turned(self) -> Pose:
        """Return the pose whose field depth has the other sign."""
        turn = np.array([1.0, 1.0, -1.0, 1.0])
        return replace(self, linear=self.linear * turn[:, None], shift=self.shift * turn, away=not self.away)

    @property
    def slack(self) -> float:
        """A millionth of a texel in field depth: what a level field is thick, so that one at depth 0 is met, too."""
        if self.perspective:
            return 0.0
        return 1e-6 * float(np.linalg.norm(np.linalg.inv(self.linear[:3])[:, :2], axis=0).min())

    def reach(self, columns: float, rows: float, depths: Array) -> float:
        """Size of the field in scene units, from its size in cells and its range of field depths."""
        if len(depths) == 0:
            return 0.0
        if self.perspective:
            return float(1.0 / np.abs(depths).min())
        sides = np.linalg.norm(np.linalg.inv(self.linear[:3]), axis=0) * (columns, rows, np.ptp(depths))
        return float(sides.max())


@dataclass(frozen=True, eq=False)
class HeightField:
    """A height field: `height` (H, W) float32 at texel centres, `color` (H, W, 3); bounds of its blocks of cells."""

    pose: Pose
    height: Array
    color: Array
    low: Array
    high: Array

    @cached_property
    def reach(self) -> float:
        """Size in scene units."""
        some = np.isfinite(self.low)
        rows, columns = self.height.shape
        return self.pose.reach(columns, rows, np.concatenate([self.low[some], self.high[some]]))

    @property
    def cells(self) -> int:
        """Number of cells."""
        return (self.height.shape[0] - 1) * (self.height.shape[1] - 1)

    @property
    def bytes(self) -> int:
        """Bytes held beyond the source itself."""
        return self.low.nbytes + self.high.nbytes


@dataclass(frozen=True, eq=False)
class PatchField:
    """The patches of a layered image.

    Attributes
    ----------
    corners : (P, 4) float32, field depths
    masks : (P,) uint8, which corners are samples
    cells : (P, 2) int32, column and row
    samples : (P, 4) int32, -1 = none
    color : (S, 4) float32, linear; fourth the coverage of the sample's texel, 0 where no photo saw the sample
    """

    pose: Pose
    corners: Array
    masks: Array
    cells: Array
    samples: Array
    color: Array

    @cached_property
    def reach(self) -> float:
        """Size in scene units."""
        columns, rows = self.cells.max(axis=0, initial=0) + 1
        return self.pose.reach(columns, rows, self.corners)

    @property
    def bytes(self) -> int:
        """Bytes held beyond the source itself."""
        return sum(part.nbytes for part in (self.corners, self.masks, self.cells, self.samples, self.color))


Field = HeightField | PatchField


def build_field(source: GridSource) -> Field:
    """Build the field of one source.

    Raises
    ------
    RendererError
        The source is of a kind that has no field.
    """
    if isinstance(source, Texture):
        source = source.layers
    if isinstance(source, ReliefTexture):
        if min(source.height.shape) > 1:
            return _height_field(source)
        return _patch_field(single_layer(source.frame, source.height, source.color), np.inf)
    if isinstance(source, DepthImage):
        return _patch_field(single_layer(source.camera, source.depth, source.color), UNKNOWN_GAP)
    if isinstance(source, LayeredDepthImage):
        return _patch_field(source, UNKNOWN_GAP)
    raise RendererError(
        f"cannot render a {type(source).__name__}; give a ReliefTexture, DepthImage, LayeredDepthImage, "
        "Texture, Asset, or a list of these"
    )


def faces_away(layers: LayeredDepthImage) -> bool:
    """Whether a layered image of one sample a texel shows a surface that is seen from greater depth.

    It does where most of its normals that are known point away from the image plane, as those of an object round the
    centre of projection do (the globe of schaufler1999).
    """
    if np.diff(layers.offsets, axis=1).max(initial=0) > 1:
        return False
    if isinstance(layers.frame, ParallelFrame):
        along = layers.normal @ layers.frame.f
    else:
        u, v = _texel_places(layers)
        rays = layers.frame.pixel_rays(np.stack([u, v], axis=-1))
        along = (layers.normal * rays).sum(axis=1)
    return bool((along > 0).sum() > (along < 0).sum())


def field_pose(frame: ParallelFrame | Camera, first: float, away: bool = False) -> Pose:
    """Texel coordinates (first, first) become cell coordinates (0, 0)."""
    if away:
        return field_pose(frame, first).turned()
    linear, shift = np.zeros((4, 3)), np.zeros(4)
    if isinstance(frame, Camera):
        linear[[0, 1, 3]] = frame.K @ frame.R
        linear[0] -= first * linear[3]
        linear[1] -= first * linear[3]
        shift[2] = -1.0
        return Pose(linear, frame.center, shift, True)
    linear[:3] = frame.local_from_world
    shift[:] = (-first, -first, 0.0, 1.0)
    return Pose(linear, frame.origin, shift, False)


def texel_size(field: PatchField) -> float:
    """Width of a texel on the surface of a layered image, scene units."""
    if not field.pose.perspective:
        return float(np.linalg.norm(np.linalg.inv(field.pose.linear[:3])[:, 0]))
    width = float(np.linalg.norm(np.linalg.inv(field.pose.linear[[0, 1, 3]])[:, 0]))
    return width * float(np.median(1.0 / np.abs(field.corners))) if len(field.corners) else width


def _height_field(source: ReliefTexture) -> HeightField:
    rows, columns = source.height.shape[0] - 1, source.height.shape[1] - 1
    blocks = (-(-rows // project_heights.BLOCK_ROWS), -(-columns // project_heights.BLOCK_COLUMNS))
    low, high = np.empty(blocks, np.float32), np.empty(blocks, np.float32)
    project_heights.bound_blocks(source.height, low, high)
    return HeightField(field_pose(source.frame, 0.5), source.height, source.color, low, high)


def _steps(layers: LayeredDepthImage) -> tuple[Array, Array, Array]:
    """Return (depth (S,), step (2, S), margin (2, 2)) in field depth; see :mod:`ibrpipe.core.ldi.patches`."""
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
    most = STEEPEST * texel
    if layers.coverage is not None:
        most = np.where(layers.coverage < 1, STEEPEST_RIM * texel, most)
    return depth, np.clip(step, -most, most).astype(np.float32), margin


def _texel_places(layers: LayeredDepthImage) -> tuple[Array, Array]:
    """Return u and v (S,) of every sample's texel centre."""
    rows, columns = layers.shape
    counts = np.diff(layers.offsets, axis=1).ravel()
    texel = np.repeat(np.arange(rows * columns), counts)
    return texel % columns + 0.5, texel // columns + 0.5


def _patch_field(layers: LayeredDepthImage, gap: float) -> PatchField:
    depth, step, margin = _steps(layers)
    away = faces_away(layers)
    if away:
        depth, step, margin = -depth, -step, margin * (1.0, -1.0)
    samples, cell = _patches(layers, depth, step, margin, gap)
    corners, masks = np.empty((len(samples), 4), np.float32), np.empty(len(samples), np.uint8)
    patches.fill_corners(samples, depth, step, corners, masks)
    columns = layers.shape[1] + 1
    cells = np.stack([cell % columns, cell // columns], axis=1).astype(np.int32)
    seen = np.ones(len(depth)) if layers.observers is None else layers.observers > 0
    filled = seen if layers.coverage is None else seen * layers.coverage
    color = np.column_stack([layers.color, filled]).astype(np.float32)
    return PatchField(field_pose(layers.frame, -0.5, away), corners, masks, cells, samples, color)


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
