"""Height fields as the relief renderer searches them: one sheet of texels in a box, with its pyramid."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ibrpipe.core.ldi.quadtree import EMPTY, STEPS
from ibrpipe.core.relief import exact, shade
from ibrpipe.core.relief import linear as relief_linear
from ibrpipe.core.relief.pyramid import build_pyramid
from ibrpipe.errors import RendererError
from ibrpipe.renderers.background_compile import BackgroundCompile, Kernel
from ibrpipe.renderers.fields import HeightField, Pose, field_pose
from ibrpipe.renderers.levels import halved, level_of
from ibrpipe.renderers.relief.options import ReliefOptions
from ibrpipe.renderers.search.epipolar_lines import Map, cast_map, height_map
from ibrpipe.types import Array, Camera, LayeredDepthImage, ParallelFrame, ReliefTexture, Texture
from ibrpipe.types.layers import opaque

#: steps between neighbouring samples of a layered image, in texels, above which they are not joined
GAP = 4.0
#: texels from which height fields are searched along epipolar lines: smaller ones march as fast without
LINES = 2**19

#: what a second process compiles at the first call
BACKGROUND = BackgroundCompile(
    (
        Kernel(
            "relief.exact", "search_exact",
            "(Array(int64, 1, 'A', readonly=True), uint32[::1], int64[::1], float64[::1], float64[::1], float64[::1], "
            "float64, boolean, int64[::1], float32[:,::1], float64[:,:,::1])",
        ),
    )
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class Field:
    """A height field in its box.

    Attributes
    ----------
    pose : Pose
        Texel (0, 0)'s centre is cell coordinate (0, 0).
    height : (H, W) float32, field depth; NaN = hole
    color : (H, W, 4) float32, linear; fourth 1 where the colour is known
    gap : float
        Steps above which neighbours are not joined.
    grid : (5,) float64
        Lowest depth of the bounds, steps per depth, least and greatest depth, texels per row.
    front : bool
        Only the side of lesser depth is seen.
    """

    pose: Pose
    height: Array
    color: Array
    gap: float
    grid: Array
    front: bool

    @cached_property
    def pyramid(self) -> tuple[Array, Array]:
        """Plan and nodes of :mod:`ibrpipe.core.relief.pyramid`."""
        return build_pyramid(self.height, self.grid[0], self.grid[1], self.gap)

    @cached_property
    def whole(self) -> bool:
        """No cell is a hole."""
        return _is_whole(*self.pyramid)

    @cached_property
    def lines(self) -> Map | None:
        """The field as the search along epipolar lines takes it; None for small fields and layered images."""
        if self.front or self.height.size < LINES or not self.grid[2] <= self.grid[3]:
            return None
        low, high = (np.full((1, 1), each, np.float32) for each in self.grid[2:4])
        return height_map(HeightField(self.pose, self.height, self.color, low, high), 0)

    def build(self) -> Field:
        """Build what the exact search needs."""
        if self.grid[2] <= self.grid[3] and self.lines is None:
            BACKGROUND.begin()
            _ = self.whole
        return self

    def level(self, number: int) -> Field:
        """Level of the pyramid: 2^number x 2^number texels averaged, colours with heights; at least two on a side."""
        return self if number <= 0 or min(self.height.shape) < 4 else self.half.level(number - 1)

    @cached_property
    def half(self) -> Field:
        """The next level."""
        height, color = halved(self.height[..., None], self.height)[..., 0], halved(self.color, self.height)
        linear, shift = self.pose.linear.copy(), self.pose.shift.copy()
        linear[:2] *= 0.5
        shift[:2] = 0.5 * (shift[:2] - 0.5)
        return laid_field(Pose(linear, self.pose.origin, shift, False), height, color, 2.0 * self.gap, self.front)

    def suited_level(self, camera: Camera) -> int:
        """Level at which texels are about as large as pixels, and none is larger."""
        low, high = self.grid[2:4]
        if not low <= high:
            return 0
        rows, columns = self.height.shape
        u, v = np.array([0, columns, columns, 0]) - 0.5, np.array([0, 0, rows, rows]) - 0.5
        corners = np.stack([u, v, np.full(4, 0.5 * (low + high)), np.ones(4)])
        return level_of(self.pose.pixel_from_field(camera) @ corners, rows, columns)

    @property
    def bytes(self) -> int:
        """Bytes held beyond the source itself."""
        lines = self.lines.bytes if self.lines else 0
        lines += self.half.bytes + self.half.height.nbytes + self.half.color.nbytes if "half" in self.__dict__ else 0
        return lines + (self.pyramid[1].nbytes if "pyramid" in self.__dict__ else 0)

    def search(self, camera: Camera, options: ReliefOptions, depth: Array, hit_cells: Array) -> None:
        """Lower `depth` (h, w) float32 where this field is hit nearer; `hit_cells` (h, w, 2) or empty: where."""
        if not self.grid[2] <= self.grid[3]:
            return
        if options.search == "exact" and self.lines is not None:
            _search_lines(self.lines, camera, depth, hit_cells)
            return
        start, directions = self.pose.field_from_pixel(camera)
        plan, nodes = self.pyramid
        window = np.array([0, camera.width, 0, camera.height])
        rays = np.ascontiguousarray(start[:3]), np.ascontiguousarray(directions[:3]).ravel()
        if options.search == "exact":
            padded = self.grid.copy()
            BACKGROUND.wait()
            padded[2], padded[3] = self.grid[0], self.grid[0] + STEPS / self.grid[1]
            exact.search_exact(
                pairs(self.height),
                nodes,
                plan,
                padded,
                *rays,
                float(self.front),
                self.whole,
                window,
                depth,
                hit_cells,
            )
            return
        side = -1.0 if self.front else self.outside(rays[0])
        relief_linear.search_linear(
            pairs(self.height),
            nodes,
            plan,
            self.grid,
            *rays,
            side,
            self.pace(camera, options),
            window,
            depth,
            hit_cells,
        )

    def pace(self, camera: Camera, options: ReliefOptions) -> Array:
        """Samples of the published search along the normal and at grazing angles, halvings, and what gives the angle.

        See :func:`ibrpipe.core.relief.linear.search_linear`.
        """
        most = options.linear_steps
        least = most if options.least_steps is None else min(options.least_steps, most)
        rays = camera.world_from_pixel
        square = rays.T @ rays
        return np.array([least, most, options.binary_steps, *(self.normal @ rays), *square[np.triu_indices(3)]])

    @cached_property
    def normal(self) -> Array:
        """(3,) float64 unit normal of the texture's plane, world."""
        across = np.linalg.inv(self.pose.linear[:3])
        normal = np.cross(across[:, 0], across[:, 1])
        unit: Array = normal / np.linalg.norm(normal)
        return unit

    def outside(self, eye: Array) -> float:
        """Return +1 where the eye (u, v, d) is above the height nearest to it, else -1; holes count as half way up."""
        rows, columns = self.height.shape
        i, j = int(np.clip(np.rint(eye[0]), 0, columns - 1)), int(np.clip(np.rint(eye[1]), 0, rows - 1))
        near = float(self.height[j, i])
        return 1.0 if eye[2] >= (near if np.isfinite(near) else 0.5 * (self.grid[2] + self.grid[3])) else -1.0


def _search_lines(lines: Map, camera: Camera, depth: Array, hit_cells: Array) -> None:
    """Lower `depth` along epipolar lines, as renderer `epipolar` does."""
    ids = np.full(depth.shape, 2**32 - 1, np.uint32)
    cast_map(lines, camera, depth, ids)
    if hit_cells.size:
        start, directions = lines.field.pose.field_from_pixel(camera)
        shade.place_hits(depth, ids, np.uint32(lines.box[0]), start, directions, hit_cells)


def pairs(height: Array) -> Array:
    """(H * W - 1,) int64: each texel's float32 with the one after it, as overlapping words of one memory."""
    words = np.frombuffer(height, np.int64, 1)
    return np.lib.stride_tricks.as_strided(words, (height.size - 1,), (4,), writeable=False)


def build_field(source: Any) -> Field:
    """Build the field of one texture.

    Raises
    ------
    RendererError
        Its frame is a perspective one, or it is too large.
    """
    if isinstance(source, Texture):
        source = source.layers
    if isinstance(source, ReliefTexture):
        known = np.ones((*source.height.shape, 1), np.float32)
        color = np.concatenate([source.color, known], axis=2)
        if min(source.height.shape) > 1:
            return laid_field(field_pose(source.frame, 0.5), source.height, color, np.inf, False)
        return _thin_field(source.frame, source.height, color)
    return _first_layer(source)


def laid_field(pose: Pose, height: Array, color: Array, gap: float, front: bool) -> Field:
    """Return the field of heights (H, W) and colours (H, W, 4) in a pose; see `Field`."""
    if height.size >= 2**29:
        raise RendererError(f"a texture of {height.shape[1]} x {height.shape[0]} texels is too large; cut it")
    some = np.isfinite(height)
    low, high = (float(height[some].min()), float(height[some].max())) if some.any() else (1.0, 0.0)
    pad = 1e-4 * max(high - low, 0.0) + 4.0 * float(np.spacing(np.float32(max(abs(low), abs(high))))) + pose.slack
    scale = STEPS / (max(high - low, 0.0) + 2.0 * pad)
    grid = np.array([low - pad, scale, low, high, height.shape[1]])
    return Field(
        pose,
        height,
        np.ascontiguousarray(color),
        gap,
        grid,
        front,
    ).build()


def _is_whole(plan: Array, nodes: Array) -> bool:
    rows, columns, across = int(plan[0]), int(plan[1]), int(plan[3])
    cells = nodes[len(nodes) - int(plan[2]) * across :].reshape(-1, across)[:rows, :columns]
    return not bool((cells == EMPTY).any())


def _thin_field(frame: ParallelFrame, height: Array, color: Array) -> Field:
    """Return the field of a texture one texel wide or high: every sample covers its texel, all neighbours are joined.

    Its grid has half the pitch: nodes at texel centres, between them, and on the outer border.
    """
    rows, columns = height.shape
    joined, shades = np.full((2 * rows + 1, 2 * columns + 1), np.nan, np.float32), np.zeros((1, 1, 4), np.float32)
    shades = np.zeros((*joined.shape, 4), np.float32)
    for j in range(joined.shape[0]):
        for i in range(joined.shape[1]):
            ys = {min(max((j - 1) // 2, 0), rows - 1), min(max(j // 2, 0), rows - 1)}
            xs = {min(max((i - 1) // 2, 0), columns - 1), min(max(i // 2, 0), columns - 1)}
            near = [(y, x) for y in ys for x in xs if np.isfinite(height[y, x])]
            if near and (j % 2 == 0 or i % 2 == 0 or np.isfinite(height[(j - 1) // 2, (i - 1) // 2])):
                joined[j, i] = np.mean([height[at] for at in near], dtype=np.float64)
                shades[j, i] = np.mean([color[at] for at in near], axis=0)
    pose = field_pose(frame, 0.0)
    linear, shift = pose.linear.copy(), pose.shift.copy()
    linear[:2] *= 2.0
    shift[:2] *= 2.0
    return laid_field(Pose(linear, pose.origin, shift, False), joined, shades, np.inf, True)


def _first_layer(layers: LayeredDepthImage) -> Field:
    if not isinstance(layers.frame, ParallelFrame):
        raise RendererError(
            "renderer 'relief' takes parallel frames; this texture has a perspective one: use renderer 'ldi'"
        )
    frame, layers = layers.frame, opaque(layers)
    first, some = layers.offsets[:, :-1], np.diff(layers.offsets, axis=1) > 0
    height, color = np.full(layers.shape, np.nan, np.float32), np.zeros((*layers.shape, 4), np.float32)
    height[some], color[some, :3] = layers.depth[first[some]], layers.color[first[some]]
    color[some, 3] = 1.0 if layers.observers is None else layers.observers[first[some]] > 0
    if min(layers.shape) == 1:
        return _thin_field(frame, height, color)
    texel = max(np.linalg.norm(frame.a), np.linalg.norm(frame.b))
    return laid_field(field_pose(frame, 0.5), height, color, GAP * float(texel), True)
