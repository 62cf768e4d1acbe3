"""The `ldi` renderer: nearest hit over all fields, then colour, then (where there are any) spiral residuals.

Source: gong-yang, sec. 5: the view-independent picture is complete before the residual pass starts. The surface that
is hit, and its departures from the paper, stand in ``docs/renderers/ldi.md``.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import import_module
from time import perf_counter
from typing import Any

import numba
import numpy as np

from ibrpipe.core import ldi_packets, ldi_shade
from ibrpipe.errors import RendererError
from ibrpipe.renderers.api import Prepared, Source
from ibrpipe.renderers.api import prepare as prepare_source
from ibrpipe.renderers.fields import Field, build_fields
from ibrpipe.types import Array, Camera, DepthImage, Frame, LayeredDepthImage, ReliefTexture, SpiralTexture

Texture = ReliefTexture | DepthImage | LayeredDepthImage | SpiralTexture

#: loaded only for textures with residuals
_RESIDUAL_PASS = "ibrpipe.renderers.residual_pass"

_NO_INDEX = np.empty((0, 0), np.int16)
_NO_PATCHES = np.empty((0, 0), np.int32)
_NO_PLACES = np.empty((0, 0, 2), np.float32)


@dataclass(frozen=True, eq=False)
class Fields:
    """All fields of a prepared source with their textures' numbers, and what the residual pass prepared for these."""

    fields: tuple[tuple[int, Field], ...]
    textures: tuple[Texture, ...]
    residuals: Any

    @property
    def bytes(self) -> int:
        """Bytes held beyond the sources."""
        return sum(field.bytes for _, field in self.fields)


@dataclass(frozen=True, eq=False)
class Hits:
    """What every pixel's ray meets first.

    Attributes
    ----------
    depth : (H, W) float32
        Along camera z, +inf = nothing.
    texture : (H, W) int16
        Index of the source that is hit, -1 = none; (0, 0) when it was not asked for.
    patch : (H, W) int32
        Cell (height fields) or patch (layered images) that is hit.
    place : (H, W, 2) float32
        Where in the cell, 0 to 1 along u and v.
    """

    depth: Array
    texture: Array
    patch: Array
    place: Array


def prepare(textures: tuple[Texture, ...]) -> Fields:
    """Build the pyramids of all textures, and the residual pass' tables where there are residuals."""
    tables = None
    if any(isinstance(texture, SpiralTexture) and texture.residuals is not None for texture in textures):
        tables = import_module(_RESIDUAL_PASS).prepare(textures)
    fields = tuple((number, field) for number, texture in enumerate(textures) for field in build_fields(texture))
    return Fields(fields, textures, tables)


def draw(fields: Fields, camera: Camera, outputs: tuple[str, ...], residuals: bool = True, threads: int = 0) -> Frame:
    """Render one frame; see `ibrpipe.render`."""
    *_, frame = _passes(fields, camera, outputs, residuals, threads)
    return frame


def render_progressive(source: Source, camera: Camera, threads: int = 0) -> Iterator[Frame]:
    """Yield the view-independent frame, then (where the source has residuals) the complete one.

    Source: gong-yang, sec. 5.1, "progressive": the first frame is complete before the residual pass starts.
    """
    prepared = source if isinstance(source, Prepared) else prepare_source(source, "ldi")
    yield from _passes(prepare_source(prepared, "ldi").data, camera, ("color", "depth", "alpha"), True, threads)


def _passes(fields: Fields, camera: Camera, outputs: tuple[str, ...], residuals: bool, threads: int) -> Iterator[Frame]:
    began = perf_counter()
    with limited_threads(threads):
        hits = find_hits(fields, camera, detail="color" in outputs)
        color = shade_hits(fields, hits) if "color" in outputs else None
        first = _frame(hits, color, outputs, began)
    if color is None or not residuals or fields.residuals is None:
        yield first
        return
    yield first
    with limited_threads(threads):
        full = color.copy()
        import_module(_RESIDUAL_PASS).add(fields.residuals, full, hits.depth, hits.texture, camera)
        yield _frame(hits, full, outputs, began)


def _frame(hits: Hits, color: Array | None, outputs: tuple[str, ...], began: float) -> Frame:
    hit = np.isfinite(hits.depth) if "alpha" in outputs else None
    stats: dict[str, Any] = {"rays": int(hits.depth.size), "milliseconds": 1e3 * (perf_counter() - began)}
    if hit is not None:
        stats["hits"] = int(np.count_nonzero(hit))
    return Frame(
        color, hits.depth if "depth" in outputs else None, None if hit is None else hit.astype(np.float32), stats
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


def find_hits(fields: Fields, camera: Camera, detail: bool = True) -> Hits:
    """Find the nearest hit of every pixel's ray over all fields.

    Parameters
    ----------
    detail : bool
        Also record which texture and patch is hit, and where; colour needs it.
    """
    shape = (camera.height, camera.width)
    depth = np.full(shape, np.inf, np.float32)
    index = np.full(shape, -1, np.int16) if detail else _NO_INDEX
    patch = np.empty(shape, np.int32) if detail else _NO_PATCHES
    place = np.empty((*shape, 2), np.float32) if detail else _NO_PLACES
    for number, field in _best_first(fields, camera):
        window = find_window(field, camera)
        if window[0] >= window[1] or window[2] >= window[3]:
            continue
        start = field.linear @ (camera.center - field.origin) + field.shift
        turn = field.linear @ camera.world_from_pixel
        ldi_packets.search_tiles(
            start, turn, field.box, field.grid, field.front, field.slopes, field.nodes, field.meta, *field.leaves,
            window, depth, index, number, patch, place,
        )  # fmt: skip
    return Hits(depth, index, patch, place)


def _best_first(fields: Fields, camera: Camera) -> list[tuple[int, Field]]:
    """Return the fields that face the camera first: what they hit shortens the search of the others."""
    facing = np.array([field.axis @ camera.R[2] for _, field in fields.fields])
    return [fields.fields[k] for k in np.argsort(-facing, kind="stable")]


def find_window(field: Field, camera: Camera) -> Array:
    """Return (x0, x1, y0, y1) int64: the pixels whose rays may meet the field's box."""
    whole = np.array([0, camera.width, 0, camera.height])
    if not field.box[2] <= field.box[3]:
        return np.zeros(4, np.int64)
    pixel = _box_in_camera(field, camera)
    if pixel is None or not (pixel[:, 2] > 1e-9 * np.abs(pixel).max()).all():
        return whole
    x, y = pixel[:, 0] / pixel[:, 2], pixel[:, 1] / pixel[:, 2]
    limits = np.array([x.min() - 1.0, x.max() + 1.0, y.min() - 1.0, y.max() + 1.0])
    window: Array = np.clip(limits, 0, whole[[1, 1, 3, 3]]).astype(np.int64)
    return window


def _box_in_camera(field: Field, camera: Camera) -> Array | None:
    """Return homogeneous pixels (8, 3) of the corners of the field's box."""
    u, v, d = np.meshgrid((0.0, field.box[0]), (0.0, field.box[1]), field.box[2:], indexing="ij")
    corners = np.stack([u.ravel(), v.ravel(), d.ravel()], axis=1)
    rows = field.linear
    if field.shift[3] == 0.0:  # perspective: d = -1/z, (x, y, q) = rows @ offset
        z = -1.0 / corners[:, 2]
        local = np.stack([corners[:, 0] * z, corners[:, 1] * z, z], axis=1)
        offset = np.linalg.solve(rows[[0, 1, 3]], local.T).T
    else:
        offset = np.linalg.solve(rows[:3], (corners - field.shift[:3]).T).T
    point = (offset + (field.origin - camera.center)) @ camera.R.T
    return point @ camera.K.T


def shade_hits(fields: Fields, hits: Hits) -> Array:
    """Return the (H, W, 3) view-independent colour of `hits`, 0 where nothing is hit."""
    color = np.zeros((*hits.depth.shape, 3), np.float32)
    window = np.array([0, hits.depth.shape[1], 0, hits.depth.shape[0]])
    done: set[int] = set()
    for number, field in fields.fields:
        if number in done:
            continue
        done.add(number)
        where = (hits.texture, number, hits.patch, hits.place, window)
        if len(field.samples):
            ldi_shade.shade_patches(*where, field.samples, field.color, color)
        else:
            ldi_shade.shade_heights(*where, field.color, color)
    return color
