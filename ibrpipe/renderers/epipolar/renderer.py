"""What the `epipolar` renderer does: inverse warping along whole epipolar lines (schaufler1999).

Every field of a source is a map (the paper's reference image); all maps lower one picture of depths. Which surface is
hit, the searches and the departures from the paper stand in ``docs/renderers/epipolar.md``.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from time import perf_counter
from typing import Any

import numpy as np

from ibrpipe.renderers.buffers import borrow
from ibrpipe.renderers.epipolar.components import NOTHING, add_components, number_samples
from ibrpipe.renderers.epipolar.options import EpipolarOptions, Search
from ibrpipe.renderers.epipolar.samples import Raster, build_raster, cast_raster, shade_raster
from ibrpipe.renderers.fields import Field, PatchField
from ibrpipe.renderers.frames import limited_threads, make_frame
from ibrpipe.renderers.scene import Hits, Scene, shade_hits
from ibrpipe.renderers.scene import prepare as prepare_scene
from ibrpipe.renderers.search.epipolar_lines import EYE, Map, cast_map, patch_map
from ibrpipe.types import Array, Camera, Frame, LayeredDepthImage, Texture
from ibrpipe.types.layers import opaque, solid_samples
from ibrpipe.types.renderable import GridSource


@dataclass(frozen=True, eq=False)
class Maps:
    """All maps of a prepared source; `scene` knows their colours."""

    scene: Scene
    maps: tuple[Map, ...]
    textures: tuple[GridSource, ...]

    @cached_property
    def rasters(self) -> tuple[tuple[int, Raster], ...]:
        """First layers of all textures, for the sampled searches, each with the number of its first sample."""
        fields: list[tuple[int, Field]] = [*self.scene.patches, *((n, field) for n, field, _ in self.scene.heights)]
        made = [build_raster(self.textures[n], field, EYE * field.reach) for n, field in fields]
        bases = np.cumsum([0] + [raster.depth.size for raster in made])
        return tuple((int(base), raster) for base, raster in zip(bases, made, strict=False))

    @cached_property
    def patches(self) -> Array:
        """(N + 1,) uint32: a patch of every sample that the sampled searches number, then that of nothing."""
        numbers = [*(n for n, _ in self.scene.patches), *(n for n, _, _ in self.scene.heights)]
        firsts = [*self.scene.firsts[:-1], *(first for _, _, first in self.scene.heights)]
        fields: list[Field] = [field for _, field in self.scene.patches]
        fields += [field for _, field, _ in self.scene.heights]
        found = [
            number_samples(field, int(first), self.textures[n], raster.depth.size)
            for field, first, n, (_, raster) in zip(fields, firsts, numbers, self.rasters, strict=True)
        ]
        return np.concatenate([*found, np.array([NOTHING], np.uint32)])

    def patch_hits(self, hits: Hits) -> Hits:
        """Return hits of samples as hits of patches."""
        return Hits(hits.depth, self.patches[np.minimum(hits.ids, len(self.patches) - 1)])

    @property
    def bytes(self) -> int:
        """Bytes held beyond the sources."""
        return self.scene.bytes + sum(one.bytes for one in self.maps if isinstance(one.field, PatchField))


def prepare(textures: tuple[GridSource, ...]) -> Maps:
    """Build the fields of all textures and the bounds of their blocks."""
    solid = tuple(_solid(texture) for texture in textures)
    plain = tuple(texture.layers if isinstance(texture, Texture) else texture for texture in solid)
    scene = prepare_scene(solid)
    patched = [patch_map(field, int(n)) for (_, field), n in zip(scene.patches, scene.firsts, strict=False)]
    return Maps(scene, (*(one for one in patched if one is not None), *scene.maps), plain)


def _solid(source: GridSource) -> GridSource:
    """Return a source whose samples fill their texels."""
    if isinstance(source, LayeredDepthImage):
        return opaque(source)
    if isinstance(source, Texture) and source.layers.coverage is not None:
        kept = solid_samples(source.layers)
        parts = tuple(part.of_samples(kept) for part in source.components)
        return replace(source, layers=opaque(source.layers), components=parts)
    return source


def draw(maps: Maps, camera: Camera, outputs: tuple[str, ...], options: EpipolarOptions) -> Frame:
    """Render one frame; see `ibrpipe.render`."""
    began = perf_counter()
    stats: dict[str, Any] = {"rays": camera.width * camera.height}
    with limited_threads(options.threads):
        hits = find_hits(maps, camera, options.search, stats)
        color, known = None, None
        if {"color", "alpha"} & set(outputs):
            color, known = _shade(maps, hits, camera, options.search)
            stats["hits"] = int(np.count_nonzero(known))
            if options.residuals and "color" in outputs and maps.scene.components:
                met = hits if options.search == "exact" else maps.patch_hits(hits)
                stats.update(add_components(maps.scene, camera, met, color, known))
    stats["milliseconds"] = 1e3 * (perf_counter() - began)
    return make_frame(outputs, hits.depth, color, known, stats)


def _shade(maps: Maps, hits: Hits, camera: Camera, search: Search) -> tuple[Array, Array]:
    """Return colour (H, W, 3) of hits and where it is known (H, W), float32."""
    if search == "exact":
        return shade_hits(maps.scene, hits, camera)
    color, known = np.zeros((*hits.depth.shape, 3), np.float32), np.zeros(hits.depth.shape, np.float32)
    for base, raster in maps.rasters:
        shade_raster(raster, camera, search, base, hits, color, known)
    return color, known


def find_hits(maps: Maps, camera: Camera, search: Search = "exact", stats: dict[str, Any] | None = None) -> Hits:
    """Find the nearest hit of every pixel's ray over all maps; the numbers of hits are valid until the next call."""
    depth = np.full((camera.height, camera.width), np.inf, np.float32)
    ids = borrow("epipolar hits", depth.size, np.uint32, 2**32 - 1).reshape(depth.shape)
    lines = 0
    if search == "exact":
        for one in maps.maps:
            lines += cast_map(one, camera, depth, ids)
    else:
        for base, raster in maps.rasters:
            lines += cast_raster(raster, camera, search, base, depth, ids)
    if stats is not None:
        stats["lines"] = lines
    return Hits(depth, ids)
