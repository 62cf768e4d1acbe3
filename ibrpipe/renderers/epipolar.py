"""The `epipolar` renderer: inverse warping along whole epipolar lines (schaufler1999).

Every field of a source is a map (the paper's reference image); all maps lower one picture of depths. Which surface is
hit, the searches and the departures from the paper stand in ``docs/renderers/epipolar.md``.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from time import perf_counter
from typing import Any

import numba
import numpy as np

from ibrpipe.core import epipolar_bounds, epipolar_cast, epipolar_lines, epipolar_patches, epipolar_sweep, patches
from ibrpipe.core.quadtree import STEPS, plan_levels
from ibrpipe.errors import RendererError
from ibrpipe.renderers import ldi
from ibrpipe.renderers.epipolar_samples import Raster, build_raster, cast_raster, shade_raster
from ibrpipe.renderers.fields import Field, HeightField, PatchField
from ibrpipe.types import Array, Camera, DepthImage, Frame, LayeredDepthImage, ReliefTexture, SpiralTexture

Texture = ReliefTexture | DepthImage | LayeredDepthImage | SpiralTexture

SEARCHES = ("exact", "nearest", "linear")
#: greatest width of a line in the picture (pixels), least in the reference (cells), blocks per width of a line
SPACING, FINEST, COARSENESS = 2.0, 0.5, 1.0


@dataclass(frozen=True, eq=False)
class Map:
    """One field with the bounds of its blocks of cells.

    Attributes
    ----------
    field : HeightField or PatchField
    base : int
        Number of its first cell or patch.
    box : (4,) float64
        Columns and rows of cells, least and greatest depth.
    grid : (2,) float64
        Lowest depth of the bounds, depth per step.
    nodes, meta : see :mod:`ibrpipe.core.epipolar_bounds`
    starts : (cells + 1,) int64
        First patch of every cell; empty for height fields.
    """

    field: Field
    base: int
    box: Array
    grid: Array
    nodes: Array
    meta: Array
    starts: Array

    @property
    def bytes(self) -> int:
        """Bytes held beyond the field."""
        return self.nodes.nbytes + self.starts.nbytes


@dataclass(frozen=True, eq=False)
class Maps:
    """All maps of a prepared source; `scene` knows their colours."""

    scene: ldi.Scene
    maps: tuple[Map, ...]
    textures: tuple[Texture, ...]

    @cached_property
    def rasters(self) -> tuple[tuple[int, Raster], ...]:
        """First layers of all textures, for the sampled searches, each with the number of its first sample."""
        fields: list[tuple[int, Field]] = [*self.scene.patches, *((n, field) for n, field, _ in self.scene.heights)]
        made = [build_raster(self.textures[n], field, ldi.EYE * field.reach) for n, field in fields]
        bases = np.cumsum([0] + [raster.depth.size for raster in made])
        return tuple((int(base), raster) for base, raster in zip(bases, made, strict=False))

    @property
    def bytes(self) -> int:
        """Bytes held beyond the sources."""
        return self.scene.bytes + sum(one.bytes for one in self.maps)


def prepare(textures: tuple[Texture, ...]) -> Maps:
    """Build the fields of all textures and the bounds of their blocks."""
    plain = tuple(texture.layers if isinstance(texture, SpiralTexture) else texture for texture in textures)
    scene = ldi.prepare(plain)
    layered = [_patch_map(field, int(n)) for (_, field), n in zip(scene.patches, scene.firsts, strict=False)]
    heights = [_height_map(field, base) for _, field, base in scene.heights]
    return Maps(scene, tuple(one for one in layered + heights if one is not None), plain)


def _height_map(field: HeightField, base: int) -> Map | None:
    rows, columns = field.height.shape[0] - 1, field.height.shape[1] - 1
    low, high = float(np.fmin.reduce(field.low, axis=None)), float(np.fmax.reduce(field.high, axis=None))
    if not low <= high:
        return None
    meta, grid, nodes = _empty_bounds(rows, columns, low, high)
    epipolar_bounds.bound_heights(field.height, grid[0], 1.0 / grid[1], meta, nodes)
    epipolar_bounds.bound_above(nodes, meta)
    pad = max(1e-6 * (high - low), 1e-9 * field.reach)  # rays that end on the surface end beyond it
    return Map(field, base, np.array([columns, rows, low - pad, high + pad]), grid, nodes, meta, np.empty(0, np.int64))


def _patch_map(field: PatchField, base: int) -> Map | None:
    if len(field.corners) == 0:
        return None
    columns, rows = (int(n) + 1 for n in field.cells.max(axis=0))
    near, far = np.empty(len(field.corners)), np.empty(len(field.corners))
    patches.measure_patches(field.corners, field.masks, near, far)
    low, high = float(near.min()), float(far.max())
    counts = np.bincount(field.cells[:, 1].astype(np.int64) * columns + field.cells[:, 0], minlength=rows * columns)
    starts = np.concatenate([[0], np.cumsum(counts)])
    meta, grid, nodes = _empty_bounds(rows, columns, low, high)
    epipolar_bounds.bound_patches(starts, near, far, grid[0], 1.0 / grid[1], meta, nodes)
    epipolar_bounds.bound_above(nodes, meta)
    pad = max(1e-6 * (high - low), 1e-9 * max(abs(low), abs(high)))
    return Map(field, base, np.array([columns, rows, low - pad, high + pad]), grid, nodes, meta, starts)


def _empty_bounds(rows: int, columns: int, low: float, high: float) -> tuple[Array, Array, Array]:
    """Return meta, grid and unfilled nodes for a field of `rows` x `columns` cells."""
    meta = plan_levels(rows, columns)
    pad = max(1e-6 * (high - low), 1e-9 * max(abs(low), abs(high)), 1e-290)
    grid = np.array([low - pad, (high - low + 2.0 * pad) / STEPS])
    return meta, grid, np.empty(int(meta[-1, 0]) + 1, np.uint32)


def draw(maps: Maps, camera: Camera, outputs: tuple[str, ...], search: str = "exact", threads: int = 0) -> Frame:
    """Render one frame; see `ibrpipe.render`."""
    if search not in SEARCHES:
        raise RendererError(f"search is {search!r}; choose among: {', '.join(SEARCHES)}")
    began = perf_counter()
    stats: dict[str, Any] = {"rays": camera.width * camera.height}
    with ldi.limited_threads(threads):
        hits = find_hits(maps, camera, search, stats)
        color, known = None, None
        if {"color", "alpha"} & set(outputs):
            color, known = _shade(maps, hits, camera, search)
            stats["hits"] = int(np.count_nonzero(known))
    stats["milliseconds"] = 1e3 * (perf_counter() - began)
    return Frame(
        color if "color" in outputs else None,
        hits.depth if "depth" in outputs else None,
        known if "alpha" in outputs else None,
        stats,
    )


def _shade(maps: Maps, hits: ldi.Hits, camera: Camera, search: str) -> tuple[Array, Array]:
    """Return colour (H, W, 3) of hits and where it is known (H, W), float32."""
    if search == "exact":
        return ldi.shade_hits(maps.scene, hits, camera)
    color, known = np.zeros((*hits.depth.shape, 3), np.float32), np.zeros(hits.depth.shape, np.float32)
    for base, raster in maps.rasters:
        shade_raster(raster, camera, search, base, hits, color, known)
    return color, known


def find_hits(maps: Maps, camera: Camera, search: str = "exact", stats: dict[str, Any] | None = None) -> ldi.Hits:
    """Find the nearest hit of every pixel's ray over all maps."""
    depth = np.full((camera.height, camera.width), np.inf, np.float32)
    ids = np.full(depth.shape, 2**32 - 1, np.uint32)
    lines = 0
    if search == "exact":
        for one in maps.maps:
            lines += _cast_map(one, camera, depth, ids)
    else:
        for base, raster in maps.rasters:
            lines += cast_raster(raster, camera, search, base, depth, ids)
    if stats is not None:
        stats["lines"] = lines
    return ldi.Hits(depth, ids)


def sweep_map(
    one: Map, camera: Camera, spacing: float = SPACING, finest: float = FINEST, coarseness: float = COARSENESS
) -> tuple[Array, Array]:
    """Lay the epipolar lines of one map and sweep them: (sectors, table) of :mod:`ibrpipe.core.epipolar_sweep`."""
    start, turn = one.field.place.rays(camera)
    sectors, edges, entries = epipolar_lines.lay_lines(
        start, turn, one.field.place.pixels(camera), (one.box[0], one.box[1]), (camera.width, camera.height),
        spacing, finest, coarseness, (one.box[2], one.box[3]),
    )  # fmt: skip
    table = np.full(entries, np.inf, np.float32)
    table[0] = -np.inf
    groups = np.zeros(5, np.int64)
    groups[1:] = np.cumsum(-(-sectors[:, epipolar_lines.LINES].astype(np.int64) // epipolar_sweep.GROUP))
    if groups[4]:
        epipolar_sweep.sweep_lines(
            sectors, edges, one.nodes, one.meta, one.grid, groups, numba.get_num_threads(), table
        )  # fmt: skip
    return sectors, table


def _cast_map(one: Map, camera: Camera, depth: Array, ids: Array) -> int:
    """Lower `depth` and `ids` where one map is hit nearer; return how many lines were swept."""
    field, parts = one.field, numba.get_num_threads()
    start, turn = field.place.rays(camera)
    sectors, table = sweep_map(one, camera)
    eye = ldi.EYE * field.reach
    if isinstance(field, HeightField):
        epipolar_cast.cast_heights(
            field.height.ravel(), field.height.shape[1], one.nodes, one.meta, one.grid, start, turn, one.box, eye,
            sectors, table, one.base, parts, depth, ids,
        )  # fmt: skip
    else:
        epipolar_patches.cast_patches(
            one.starts, field.corners, field.masks, one.nodes, one.meta, one.grid, start, turn, one.box, eye,
            sectors, table, one.base, parts, depth, ids,
        )  # fmt: skip
    return int(sectors[:, epipolar_lines.LINES].sum())
