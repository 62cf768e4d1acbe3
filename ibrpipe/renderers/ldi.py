"""The `ldi` renderer: nearest hit over all fields, then colour, then (where there are any) spiral residuals.

Source: gong-yang, sec. 5: the view-independent picture is complete before the residual pass starts. The surface that
is hit, the two searches, and the departures from the paper stand in ``docs/renderers/ldi.md``.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from time import perf_counter
from typing import Any

import numba
import numpy as np

from ibrpipe.core import ldi_shade, patch_project, patch_search
from ibrpipe.errors import RendererError
from ibrpipe.renderers import residual_pass
from ibrpipe.renderers.api import Prepared, Source
from ibrpipe.renderers.api import prepare as prepare_source
from ibrpipe.renderers.epipolar_maps import EYE, Map, cast_map, height_map
from ibrpipe.renderers.fields import HeightField, PatchField, build_field
from ibrpipe.renderers.patch_blocks import Blocks, pack_blocks
from ibrpipe.renderers.pyramids import Sheet, build_sheets
from ibrpipe.types import Array, Camera, DepthImage, Frame, LayeredDepthImage, ReliefTexture, SpiralTexture

Texture = ReliefTexture | DepthImage | LayeredDepthImage | SpiralTexture

SEARCHES = ("auto", "patches", "lines", "quadtree")
#: cells or patches per pixel above which `auto` asks the rays rather than the patches
CROWDED = 16


@dataclass(frozen=True, eq=False)
class Scene:
    """All fields of a prepared source.

    Patches of layered images are numbered in the order of `patches`; the cells of height fields follow.

    Attributes
    ----------
    patches : tuple of (texture number, PatchField)
    heights : tuple of (texture number, HeightField, number of its first cell)
    residuals : Tables of the residual pass, or None
    """

    patches: tuple[tuple[int, PatchField], ...]
    heights: tuple[tuple[int, HeightField, int], ...]
    residuals: residual_pass.Tables | None

    @property
    def bytes(self) -> int:
        """Bytes held beyond the sources."""
        fields = [field for _, field in self.patches] + [field for _, field, _ in self.heights]
        held = sum(field.bytes for field in fields) + sum(one.bytes for one in self.maps)
        return held + (self.residuals.bytes if self.residuals else 0)

    @property
    def cells(self) -> int:
        """Cells and patches of all fields."""
        return int(self.firsts[-1]) + sum(field.cells for _, field, _ in self.heights)

    @cached_property
    def firsts(self) -> Array:
        """(F + 1,) int64: number of every layered image's first patch."""
        return np.cumsum([0] + [len(field.corners) for _, field in self.patches])

    @cached_property
    def records(self) -> tuple[Array, Array]:
        """(P, 8) int32 column, row, field, 0, samples of every patch, and (S, 4) float32 colours; joined."""
        fields = [field for _, field in self.patches]
        shifts = np.cumsum([0] + [len(field.color) for field in fields])
        records = np.zeros((int(self.firsts[-1]), 8), np.int32)
        for number, field in enumerate(fields):
            own = records[self.firsts[number] : self.firsts[number + 1]]
            own[:, :2], own[:, 2] = field.cells, number
            own[:, 4:] = np.where(field.samples >= 0, field.samples + shifts[number], -1)
        return records, np.concatenate([field.color for field in fields])

    @cached_property
    def blocks(self) -> Blocks:
        """All patches as the projecting search takes them."""
        return pack_blocks([field for _, field in self.patches])

    @cached_property
    def pictures(self) -> list[Array]:
        """Working memory of finished frames, for the next ones."""
        return []

    @cached_property
    def maps(self) -> tuple[Map, ...]:
        """Height fields with the bounds of their blocks, for the search along lines."""
        made = (height_map(field, base) for _, field, base in self.heights)
        return tuple(one for one in made if one is not None)

    @cached_property
    def sheets(self) -> list[Sheet]:
        """Pyramids of all fields, for the ray search."""
        parts = [build_sheets(field, int(n)) for (_, field), n in zip(self.patches, self.firsts, strict=False)]
        parts += [build_sheets(field, base) for _, field, base in self.heights]
        return [sheet for part in parts for sheet in part]


@dataclass(frozen=True, eq=False)
class Hits:
    """Nearest hit of every pixel: camera depth (H, W) float32 (+inf = none) and number (H, W) uint32."""

    depth: Array
    ids: Array


def prepare(textures: tuple[Texture, ...]) -> Scene:
    """Build the fields of all textures, and the residual pass' tables where there are residuals."""
    fields = [(number, build_field(texture)) for number, texture in enumerate(textures)]
    layered = tuple((number, field) for number, field in fields if isinstance(field, PatchField))
    base = sum(len(field.corners) for _, field in layered)
    heights = []
    for number, field in fields:
        if isinstance(field, HeightField):
            heights.append((number, field, base))
            base += field.cells
    if base >= 2**32 - 1:
        raise RendererError(
            f"the sources have {base} cells together; 4294967294 can be told apart: render fewer at once"
        )
    modelled = any(isinstance(texture, SpiralTexture) and texture.residuals is not None for texture in textures)
    return Scene(layered, tuple(heights), residual_pass.prepare(textures) if modelled else None)


def draw(
    scene: Scene,
    camera: Camera,
    outputs: tuple[str, ...],
    residuals: bool = True,
    threads: int = 0,
    search: str = "auto",
) -> Frame:
    """Render one frame; see `ibrpipe.render`."""
    *_, frame = _passes(scene, camera, outputs, residuals, threads, search)
    return frame


def render_progressive(source: Source, camera: Camera, threads: int = 0) -> Iterator[Frame]:
    """Yield the view-independent frame, then (where the source has residuals) the complete one.

    Source: gong-yang, sec. 5.1, "progressive": the first frame is complete before the residual pass starts.
    """
    prepared = source if isinstance(source, Prepared) else prepare_source(source, "ldi")
    scene = prepare_source(prepared, "ldi").data
    for frame in _passes(scene, camera, ("color", "depth", "alpha"), True, threads, "auto"):
        color = None if frame.color is None else frame.color.copy()
        yield Frame(color, frame.depth, frame.alpha, frame.stats)


def _passes(
    scene: Scene, camera: Camera, outputs: tuple[str, ...], residuals: bool, threads: int, search: str
) -> Iterator[Frame]:
    """Yield the view-independent frame and then, in the same colour array, the complete one."""
    began = perf_counter()
    stats: dict[str, Any] = {"rays": camera.width * camera.height}
    with limited_threads(threads):
        hits = find_hits(scene, camera, search)
        color, known = shade_hits(scene, hits, camera) if {"color", "alpha"} & set(outputs) else (None, None)
        if known is not None:
            stats["hits"] = int(np.count_nonzero(known))
        stats["milliseconds"] = 1e3 * (perf_counter() - began)
        yield _frame(hits, color, known, outputs, stats)
        if color is not None and known is not None and "color" in outputs and residuals and scene.residuals is not None:
            stats["without_residual"] = residual_pass.add(scene.residuals, color, hits.depth, camera, known)
            stats["milliseconds"] = 1e3 * (perf_counter() - began)
            yield _frame(hits, color, known, outputs, stats)


def _frame(
    hits: Hits, color: Array | None, known: Array | None, outputs: tuple[str, ...], stats: dict[str, Any]
) -> Frame:
    return Frame(
        color if "color" in outputs else None,
        hits.depth if "depth" in outputs else None,
        known if "alpha" in outputs else None,
        dict(stats),
    )


@contextmanager
def limited_threads(threads: int) -> Iterator[None]:
    """Run the kernels of this block on `threads` threads (0 = as many as Numba has)."""
    before, most = numba.get_num_threads(), numba.config.NUMBA_NUM_THREADS
    if threads < 0 or threads > most:
        raise RendererError(f"threads is {threads}; give 0 (all) or 1 to {most}")
    numba.set_num_threads(threads or before)
    try:
        yield
    finally:
        numba.set_num_threads(before)


def find_hits(scene: Scene, camera: Camera, search: str = "auto") -> Hits:
    """Find the nearest hit of every pixel's ray over all fields.

    Parameters
    ----------
    search : {"auto", "patches", "lines", "quadtree"}
        Project the patches, search height fields along whole epipolar lines (layered images are projected), or walk
        every ray through the pyramids; all find the same hits. "auto" takes lines for height fields.

    Raises
    ------
    RendererError
        Unknown search.
    """
    if search not in SEARCHES:
        raise RendererError(f"search is {search!r}; choose among: {', '.join(SEARCHES)}")
    pixels = camera.width * camera.height
    by_rays = search == "quadtree" or (search == "auto" and int(scene.firsts[-1]) > CROWDED * pixels)
    if scene.patches and not by_rays:
        depth, ids = _project(scene, camera)
    else:
        depth = np.full((camera.height, camera.width), np.inf, np.float32)
        ids = np.full(depth.shape, 2**32 - 1, np.uint32)
    if by_rays:
        for sheet in scene.sheets:
            sheet.search(camera, depth, ids)
    elif search == "patches" and scene.heights:
        _project_heights(scene, camera, depth, ids)
    else:
        for one in scene.maps:
            cast_map(one, camera, depth, ids)
    return Hits(depth, ids)


def _project(scene: Scene, camera: Camera) -> tuple[Array, Array]:
    """Return depth and number of the nearest hit of every pixel with the patches of layered images."""
    places = [field.place for _, field in scene.patches]
    starts, turns = (np.stack(part) for part in zip(*(place.rays(camera) for place in places), strict=True))
    pixels = np.stack([place.pixels(camera) for place in places])
    eyes = np.array([EYE * field.reach for _, field in scene.patches])
    signs = np.sign(np.linalg.det(pixels[:, :, :3])) * np.sign(starts[:, 3])  # the line to an eye behind a frame's
    perspective = np.array([place.perspective for place in places])
    parts, (columns, rows) = numba.get_num_threads(), (camera.width, camera.height)
    memory = scene.pictures.pop() if scene.pictures else np.empty(0, np.int64)
    if len(memory) < parts * columns * rows:
        memory = np.empty(parts * columns * rows, np.int64)
    keys = memory[: parts * columns * rows].reshape(parts, columns * rows)
    patch_project.project_patches(
        *scene.blocks.arrays, pixels, pack_rays(starts, turns), eyes, signs, perspective, columns, rows, keys
    )
    depth, ids = np.empty((rows, columns), np.float32), np.empty((rows, columns), np.uint32)
    patch_project.merge_pictures(keys, columns, depth, ids)
    scene.pictures.append(memory)
    return depth, ids


def _project_heights(scene: Scene, camera: Camera, depth: Array, ids: Array) -> None:
    """Lower `depth` and `ids` where height fields are hit nearer."""
    parts = numba.get_num_threads()
    depths, numbers = np.full((parts, *depth.shape), np.inf, np.float32), np.empty((parts, *ids.shape), np.uint32)
    depths[0], numbers[:] = depth, ids
    for _, field, base in scene.heights:
        start, turn = field.place.rays(camera)
        rows, columns = field.height.shape
        descending = (bool(start[1] > 0.5 * rows), bool(start[0] > 0.5 * columns))
        patch_search.project_heights(
            field.height, field.low, field.high, field.place.pixels(camera), pack_rays(start, turn), EYE * field.reach,
            descending, base, depths, numbers,
        )  # fmt: skip
    if parts > 1:
        patch_search.merge(depths, numbers)
    depth[:], ids[:] = depths[0], numbers[0]


def pack_rays(start: Array, turn: Array) -> Array:
    """(..., 16) float64: start (..., 4), then turn (..., 4, 3) row by row, for the projecting kernels."""
    return np.concatenate([start, turn.reshape(*turn.shape[:-2], 12)], axis=-1)


def shade_hits(scene: Scene, hits: Hits, camera: Camera) -> tuple[Array, Array]:
    """Return the view-independent colour (H, W, 3) of `hits` and where it is known (H, W), float32."""
    color, known = np.zeros((*hits.depth.shape, 3), np.float32), np.zeros(hits.depth.shape, np.float32)
    if scene.patches:
        rays = [field.place.rays(camera) for _, field in scene.patches]
        starts, turns = (np.stack(part) for part in zip(*rays, strict=True))
        records, colors = scene.records
        ldi_shade.shade_patches(hits.depth, hits.ids, records, starts, turns, colors, color, known)
    for _, field, base in scene.heights:
        start, turn = field.place.rays(camera)
        ldi_shade.shade_heights(hits.depth, hits.ids, base, start, turn, field.color, color, known)
    return color, known
