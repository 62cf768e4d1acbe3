"""The sampled searches of the `epipolar` renderer: nearest samples as published, or interpolated ones."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numba
import numpy as np

from ibrpipe.core.epipolar import lines, near, samples, sweep
from ibrpipe.renderers.buffers import borrow
from ibrpipe.renderers.fields import UNKNOWN_GAP, Field, HeightField, Pose
from ibrpipe.types import Array, Camera, DepthImage, LayeredDepthImage, ReliefTexture

#: greatest width of a line in the picture (pixels), least in the reference (texels)
SPACING, FINEST = {"nearest": 1.0, "linear": 1.0}, {"nearest": 0.5, "linear": 0.5}


@dataclass(frozen=True, eq=False)
class Raster:
    """The first layer of a map: one sample per texel.

    Attributes
    ----------
    pose : Pose
    depth : (rows, columns) float32
        Field depths where (u, v) are whole numbers; NaN = background.
    color : (rows, columns, 3) float32
    gaps : bool
        There is background in it, or there are steps that are no surface.
    steps : (3,) float64
        Greatest step between neighbours of one surface: a constant and a share of the field depth; and from which side
        it is seen: 1 = from lesser depth, -1 = from greater, 0 = from both.
    ends : (2,) float64
        Least and greatest field depth, a little apart.
    eye : float
        Camera depth that still belongs to the eye.
    """

    pose: Pose
    depth: Array
    color: Array
    gaps: bool
    steps: Array
    ends: Array
    eye: float

    @cached_property
    def slopes(self) -> tuple[Array, Array]:
        """Change of the field depth per column and row, (rows, columns): mean over neighbours of the same surface."""
        found = []
        for axis in (1, 0):
            one, other = (np.take(self.depth, part, axis) for part in (range(self.depth.shape[axis] - 1),
                                                                       range(1, self.depth.shape[axis])))  # fmt: skip
            most = self.steps[0] + self.steps[1] * np.maximum(np.abs(one), np.abs(other))
            step = np.where(np.abs(other - one) <= most, other - one, np.nan)
            edge = np.full_like(np.take(self.depth, [0], axis), np.nan)
            both = np.stack([np.concatenate([edge, step], axis), np.concatenate([step, edge], axis)])
            known = np.isfinite(both)
            found.append(np.where(known, both, 0.0).sum(axis=0) / np.maximum(known.sum(axis=0), 1))
        return found[0], found[1]


def build_raster(texture: Any, field: Field, eye: float) -> Raster:
    """Lay out the first layer of a texture in the coordinates of its field."""
    if isinstance(field, HeightField):
        ends = _ends(field.height, field.pose)
        return Raster(field.pose, field.height, field.color, _holes(field), np.array([np.inf, 0.0, 0.0]), ends, eye)
    depth, color = _first_layer(texture)
    pose = field.pose.turned() if field.pose.away else field.pose
    steps = np.append(_steps(pose), -1.0 if field.pose.away else 1.0)
    if pose.perspective:
        depth = (-1.0 / depth.astype(np.float64)).astype(np.float32)
    return Raster(
        pose,
        np.pad(depth, 1, constant_values=np.nan),
        np.ascontiguousarray(np.pad(color, ((1, 1), (1, 1), (0, 0))), np.float32),
        True,
        steps,
        _ends(depth, pose),
        eye,
    )


def _ends(depth: Array, pose: Pose) -> Array:
    """Return the least and the greatest field depth, moved apart by more than they are rounded."""
    some = depth[np.isfinite(depth)].astype(np.float64)
    if not len(some):
        return np.zeros(2)
    low, high = float(some.min()), float(some.max())
    pad = 1e-6 * (high - low) + 1e-9 * max(abs(low), abs(high)) + pose.slack
    return np.array(pose.limited(low, high, pad))


def _holes(field: HeightField) -> bool:
    return bool(np.isnan(field.height).any())


def _steps(pose: Pose) -> Array:
    """Return the greatest step within a surface: as many texels as renderer `ldi` links without normals."""
    if pose.perspective:  # a texel at depth z is z / focal wide, so -1/z changes by its share 1 / focal
        projection = pose.linear[[0, 1, 3]]
        focal = min(float(np.linalg.norm(np.cross(projection[2], row))) for row in projection[:2])
        return np.array([0.0, UNKNOWN_GAP / focal])
    texels = np.linalg.norm(np.linalg.inv(pose.linear[:3])[:, :2], axis=0)
    return np.array([UNKNOWN_GAP * float(texels.max()), 0.0])


def _first_layer(texture: Any) -> tuple[Array, Array]:
    """Return depth (H, W) with NaN for background and colour (H, W, 3)."""
    if isinstance(texture, ReliefTexture):
        return texture.height, texture.color
    if isinstance(texture, DepthImage):
        return texture.depth, texture.color
    layers: LayeredDepthImage = texture
    there = np.diff(layers.offsets, axis=1) > 0
    depth = np.full(there.shape, np.nan, np.float32)
    color = np.zeros((*there.shape, 3), np.float32)
    first = layers.offsets[:, :-1][there]
    depth[there], color[there] = layers.depth[first], layers.color[first]
    return depth, color


def cast_raster(raster: Raster, camera: Camera, search: str, base: int, depth: Array, ids: Array) -> int:
    """Lower `depth` and `ids` where one raster is nearer; return how many lines were swept."""
    start, directions = raster.pose.field_from_pixel(camera)
    pixels = raster.pose.pixel_from_field(camera)
    rows, columns = raster.depth.shape
    sectors, edges, entries = lines.lay_lines(
        start, directions, pixels, (columns - 1, rows - 1), (camera.width, camera.height),
        SPACING[search], FINEST[search], 0.0,
    )  # fmt: skip
    flat, linear, parts = raster.depth.ravel(), search == "linear", numba.get_num_threads()
    own, view = (flat, columns, raster.steps), (start, directions, pixels[2], raster.pose.perspective)
    near.meet_near(own, view, linear, _within(raster, start), raster.ends, raster.eye, base, depth, ids)
    groups = np.zeros(5, np.int64)
    groups[1:] = np.cumsum(-(-sectors[:, lines.LINES].astype(np.int64) // sweep.GROUP))
    if not groups[4]:
        return 0
    table = borrow("epipolar table", entries, np.float32, np.inf)
    samples.sweep_samples(sectors, edges, flat, columns, linear, raster.gaps, raster.steps, groups, parts, table)
    reach = raster.ends[1] - raster.ends[0]
    samples.pick_samples(own, view, (sectors, table), linear, reach, raster.eye, base, parts, depth, ids)
    return int(sectors[:, lines.LINES].sum())


def _within(raster: Raster, start: Array) -> bool:
    """Tell whether an eye may lie within the field, or within a few texels of it."""
    if not start[3] > 0.0:
        return False
    u, v, d = start[:3] / start[3]
    rows, columns = raster.depth.shape
    some = near.SHORT
    inside = -some <= u <= columns - 1 + some and -some <= v <= rows - 1 + some
    return bool(inside and raster.ends[0] <= d <= raster.ends[1])


def shade_raster(raster: Raster, camera: Camera, search: str, base: int, hits: Any, color: Array, known: Array) -> None:
    """Fill `color` and `known` where this raster is hit."""
    start, directions = raster.pose.field_from_pixel(camera)
    samples.shade_samples(
        hits.depth, hits.ids, base, start, directions, raster.depth.ravel(), raster.depth.shape[1], raster.color,
        search == "linear", color, known,
    )  # fmt: skip
