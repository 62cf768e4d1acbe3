"""What the `epipolar` renderer does: inverse warping along whole epipolar lines (schaufler1999).

Every field of a source is a map (the paper's reference image); all maps lower one picture of depths. Which surface is
hit, the searches and the departures from the paper stand in ``docs/renderers/epipolar.md``.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from time import perf_counter
from typing import Any

import numpy as np

from ibrpipe.renderers.buffers import borrow
from ibrpipe.renderers.epipolar.options import EpipolarOptions, Search
from ibrpipe.renderers.epipolar.samples import Raster, build_raster, cast_raster, shade_raster
from ibrpipe.renderers.fields import Field, PatchField
from ibrpipe.renderers.frames import limited_threads, make_frame
from ibrpipe.renderers.scene import Hits, Scene, shade_hits
from ibrpipe.renderers.scene import prepare as prepare_scene
from ibrpipe.renderers.search.epipolar_lines import EYE, Map, cast_map, patch_map
from ibrpipe.types import Array, Camera, Frame, LayeredDepthImage, Texture
from ibrpipe.types.layers import opaque
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

    @property
    def bytes(self) -> int:
        """Bytes held beyond the sources."""
        return self.scene.bytes + sum(one.bytes for one in self.maps if isinstance(one.field, PatchField))


def prepare(textures: tuple[GridSource, ...]) -> Maps:
    """Build the fields of all textures and the bounds of their blocks."""
    layered = tuple(texture.layers if isinstance(texture, Texture) else texture for texture in textures)
    plain = tuple(opaque(each) if isinstance(each, LayeredDepthImage) else each for each in layered)
    scene = prepare_scene(plain)
    patched = [patch_map(field, int(n)) for (_, field), n in zip(scene.patches, scene.firsts, strict=False)]
    return Maps(scene, (*(one for one in patched if one is not None), *scene.maps), plain)


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
