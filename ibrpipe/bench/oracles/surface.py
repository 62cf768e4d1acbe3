"""The surface of a source as a plain list of patches in float64, for the oracle.

Which patches a source has is defined in ``docs/renderers/ldi.md``; corners may be given in float64 instead of the
stored float32, so that what storing costs can be told from what rendering costs.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from ibrpipe.renderers.fields import HeightField, build_field
from ibrpipe.types import Array, Camera, DepthImage, LayeredDepthImage, ParallelFrame, ReliefTexture, Texture
from ibrpipe.types.layers import offsets_of
from ibrpipe.types.renderable import GridSource


@dataclass(frozen=True, eq=False)
class Surface:
    """Bilinear patches over the cells of one frame.

    Attributes
    ----------
    frame : ParallelFrame or Camera
    shift : float
        Texel coordinate u (and v) of cell coordinate 0: 0.5 for height fields, -0.5 for layered images.
    shape : (int, int)
        Rows and columns of cells.
    cells : (P, 2) int64
        Column and row of every patch, ascending by row, then column.
    corners : (P, 4) float64
        Field depths of the corners (0, 0), (1, 0), (0, 1), (1, 1).
    masks : (P,) uint8
        Bit c: corner c is a sample, and its quadrant counts.
    samples : (P, 4) int64
        Row of `color` of every corner, -1 = none.
    color : (S, 3) float32
    front : int
        1: only hits from the side of the image plane count, -1: only those from the other side, 0: all.
    """

    frame: ParallelFrame | Camera
    shift: float
    shape: tuple[int, int]
    cells: Array
    corners: Array
    masks: Array
    samples: Array
    color: Array
    front: int

    @cached_property
    def starts(self) -> Array:
        """(rows * columns + 1,) int64: first patch of every cell."""
        rows, columns = self.shape
        number = self.cells[:, 1] * columns + self.cells[:, 0]
        return np.searchsorted(number, np.arange(rows * columns + 1)).astype(np.int64)

    @property
    def perspective(self) -> bool:
        """Field depth is -1/z of a camera, not the depth along f."""
        return isinstance(self.frame, Camera)

    @property
    def texel(self) -> float:
        """Longer edge of a texel in scene units; of a perspective frame at its median depth."""
        if isinstance(self.frame, Camera):
            focal = min(self.frame.K[0, 0], self.frame.K[1, 1])
            depth = np.median(-1.0 / self.corners) if len(self.corners) else 1.0
            return float(depth / focal)
        return float(max(np.linalg.norm(self.frame.a), np.linalg.norm(self.frame.b)))

    @property
    def grain(self) -> float:
        """Field depth of one texel: scene units in a parallel frame, a share of the depth in a perspective one."""
        if isinstance(self.frame, Camera):
            return float(1.0 / min(self.frame.K[0, 0], self.frame.K[1, 1]))
        return self.texel

    def moved(self, steps: float) -> Surface:
        """Return the surface moved by `steps` texels of depth."""
        move = steps * self.grain * (np.abs(self.corners) if self.perspective else 1.0)
        return replace(self, corners=self.corners + move) if steps else self

    def rays(self, camera: Camera) -> tuple[Array, Array]:
        """Cell coordinates (x, y, n, q) of a pixel's ray are ``start (4,) + t * Q_of (4, 3) @ (px, py, 1)``."""
        return self.place(camera.center), self.turned(camera.world_from_pixel)

    def turned(self, directions: Array) -> Array:
        """Return (4, N) homogeneous cell coordinates of (3, N) world directions."""
        if isinstance(self.frame, Camera):
            x, y, q = self.frame.K @ self.frame.R @ directions
            n = np.zeros_like(q)
        else:
            x, y, n = np.linalg.solve(self.frame.world_from_local, directions)
            q = np.zeros_like(n)
        return np.stack([x - self.shift * q, y - self.shift * q, n, q])

    def place(self, points: Array) -> Array:
        """Return (..., 4) homogeneous cell coordinates of (..., 3) world points: u = x/q, v = y/q, depth = n/q."""
        origin = self.frame.center if isinstance(self.frame, Camera) else self.frame.origin
        flat = (np.asarray(points, np.float64) - origin).reshape(-1, 3).T
        found = self.turned(flat)
        found += np.array([[0.0], [0.0], [-1.0], [0.0]]) if self.perspective else self._unit
        return found.T.reshape(*np.shape(points)[:-1], 4)

    @property
    def _unit(self) -> Array:
        return np.array([[-self.shift], [-self.shift], [0.0], [1.0]])

    def world(self, u: Array, v: Array, depth: Array) -> Array:
        """Return (..., 3) world points of cell coordinates u, v and field depth."""
        u, v = u + self.shift, v + self.shift
        if isinstance(self.frame, Camera):
            z = -1.0 / depth
            return self.frame.center + z[..., None] * (
                np.stack([u, v, np.ones_like(u)], axis=-1) @ self.frame.world_from_pixel.T
            )
        return self.frame.origin + np.stack([u, v, depth], axis=-1) @ self.frame.world_from_local.T


def build_surface(source: GridSource, heights: Array | None = None) -> Surface:
    """Build the surface of one source.

    Parameters
    ----------
    source : ReliefTexture, DepthImage, LayeredDepthImage or Texture
    heights : (H, W) float64, optional
        Heights of a relief texture before they were stored as float32.
    """
    field = build_field(source)
    if isinstance(field, HeightField):
        assert isinstance(source, ReliefTexture)
        return height_surface(source, source.height if heights is None else heights)
    if isinstance(source, Texture):
        source = source.layers
    order = np.lexsort((field.cells[:, 0], field.cells[:, 1]))
    rows, columns = source.height.shape if isinstance(source, ReliefTexture) else _shape(source)
    frame: Any = source.camera if isinstance(source, DepthImage) else source.frame
    return Surface(
        frame,
        -0.5,
        (rows + 1, columns + 1),
        field.cells[order].astype(np.int64),
        field.corners[order].astype(np.float64) * (-1.0 if field.pose.away else 1.0),
        field.masks[order],
        field.samples[order].astype(np.int64),
        np.ascontiguousarray(field.color[:, :3]),
        -1 if field.pose.away else 1,
    )


def _shape(source: DepthImage | LayeredDepthImage) -> tuple[int, int]:
    return source.depth.shape if isinstance(source, DepthImage) else source.shape


def height_surface(source: ReliefTexture, heights: Array) -> Surface:
    """Return the patches of a height field: the cells whose four corners are finite."""
    h = np.asarray(heights, np.float64)
    rows, columns = h.shape[0] - 1, h.shape[1] - 1
    corners = np.stack([h[:-1, :-1], h[:-1, 1:], h[1:, :-1], h[1:, 1:]], axis=-1)
    row, column = np.nonzero(np.isfinite(corners).all(axis=-1))
    texel = np.arange(h.size).reshape(h.shape)
    samples = np.stack([texel[row + (c >> 1), column + (c & 1)] for c in range(4)], axis=-1)
    masks = np.full(len(row), 15, np.uint8)
    cells, color = np.stack([column, row], axis=-1), source.color.reshape(-1, 3)
    return Surface(source.frame, 0.5, (rows, columns), cells, corners[row, column], masks, samples, color, 0)


def first_layer(source: LayeredDepthImage) -> LayeredDepthImage:
    """Return the layered image with the first sample of every texel alone."""
    starts, counts = source.offsets[:, :-1], np.diff(source.offsets, axis=1)
    keep = starts[counts > 0]
    offsets, observers = offsets_of(counts > 0), None if source.observers is None else source.observers[keep]
    return LayeredDepthImage(
        source.frame, offsets, source.depth[keep], source.color[keep], source.normal[keep], observers
    )
