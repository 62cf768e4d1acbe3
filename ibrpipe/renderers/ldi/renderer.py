"""What the `ldi` renderer does: nearest hit over all fields, then colour, then (where there is any) view dependence.

Source: gong-yang, sec. 5: the view-independent picture is complete before the residual pass starts. The surface that
is hit, the two searches, and the departures from the paper stand in ``docs/renderers/ldi.md``.
"""

from __future__ import annotations

from collections.abc import Iterator
from time import perf_counter
from typing import Any

import numba
import numpy as np

from ibrpipe.core.ldi import project_heights
from ibrpipe.renderers.frames import limited_threads, make_frame
from ibrpipe.renderers.ldi.edge_rays import draw_means, edge_bands, trace_edges
from ibrpipe.renderers.ldi.levels import Level, levels_behind, mix
from ibrpipe.renderers.ldi.options import LdiOptions, Search
from ibrpipe.renderers.scene import Hits, Scene, shade_hits
from ibrpipe.renderers.search.epipolar_lines import EYE, cast_map
from ibrpipe.renderers.search.projection import pack_rays, project
from ibrpipe.renderers.view_dependence.component import Picture
from ibrpipe.types import Array, Camera, Frame

#: cells or patches per pixel above which `auto` asks the rays rather than the patches
CROWDED = 16


def draw(scene: Scene, camera: Camera, outputs: tuple[str, ...], options: LdiOptions) -> Frame:
    """Render one frame; see `ibrpipe.render`."""
    *_, frame = passes(scene, camera, outputs, options)
    return frame


def passes(scene: Scene, camera: Camera, outputs: tuple[str, ...], options: LdiOptions) -> Iterator[Frame]:
    """Yield the view-independent frame and then, in the same colour array, the complete one."""
    began = perf_counter()
    stats: dict[str, Any] = {"rays": camera.width * camera.height}
    with limited_threads(options.threads):
        hits = find_hits(scene, camera, options.search)
        if not ({"color", "alpha"} & set(outputs) or scene.soft):
            stats["milliseconds"] = 1e3 * (perf_counter() - began)
            yield make_frame(outputs, hits.depth, None, None, stats)
            return
        color, known = shade_hits(scene, hits, camera)
        stats["hits"] = int(np.count_nonzero(known))
        levels = [Level(hits.depth, hits.ids, color, known)]
        if scene.soft:
            levels += levels_behind(scene, camera, levels[0])
        mixed = mix(levels, scene.texel)
        stats["milliseconds"] = 1e3 * (perf_counter() - began)
        yield make_frame(outputs, mixed.depth, mixed.color, mixed.known, stats)
        if not (options.residuals and "color" in outputs and scene.components):
            return
        for level in reversed(levels):  # the figures are those of the nearest
            picture = Picture(scene, camera, level.color, level.depth, level.ids, level.known)
            for component in scene.components:
                stats.update(component.add(picture))
        if len(levels) > 1:
            mixed.color[:] = mix(levels, scene.texel).color
        stats["milliseconds"] = 1e3 * (perf_counter() - began)
        yield make_frame(outputs, mixed.depth, mixed.color, mixed.known, stats)


def traces_edges(scene: Scene, camera: Camera, options: LdiOptions) -> bool:
    """Say whether edges alone can be traced: height fields and searches by rays draw whole pictures."""
    return bool(scene.patches) and not scene.heights and not _by_rays(scene, camera, options.search)


def draw_adaptive(scene: Scene, camera: Camera, outputs: tuple[str, ...], options: LdiOptions) -> Frame:
    """Render one frame with several rays through pixels that show an edge."""
    frame = draw(scene, camera, ("color", "depth", "alpha"), options)
    color, depth, known = frame.color, frame.depth, frame.alpha
    assert color is not None
    assert depth is not None
    assert known is not None
    began, stats = perf_counter(), dict(frame.stats)
    with limited_threads(options.threads):
        stats["edge_pixels"] = 0
        for band in edge_bands(depth, known):
            edges = trace_edges(scene, camera, band)
            for edge in edges:
                for component in scene.components if options.residuals else ():
                    component.add(edge)
            draw_means(edges, color, known)
            stats["edge_pixels"] += len(edges[0].depth)
            stats["rays"] += edges[0].depth.size
    stats["milliseconds"] += 1e3 * (perf_counter() - began)
    return make_frame(outputs, depth, color, known, stats)


def find_hits(scene: Scene, camera: Camera, search: Search = "auto") -> Hits:
    """Find the nearest hit of every pixel's ray over all fields.

    Parameters
    ----------
    search : {"auto", "patches", "lines", "quadtree"}
        Project the patches, search height fields along whole epipolar lines (layered images are projected), or walk
        every ray through the pyramids; all find the same hits. "auto" takes lines for height fields.
    """
    by_rays = _by_rays(scene, camera, search)
    if scene.patches and not by_rays:
        depth, ids = project(scene, camera)
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


def _by_rays(scene: Scene, camera: Camera, search: Search) -> bool:
    crowded = int(scene.firsts[-1]) > CROWDED * camera.width * camera.height
    return search == "quadtree" or (search == "auto" and crowded)


def _project_heights(scene: Scene, camera: Camera, depth: Array, ids: Array) -> None:
    """Lower `depth` and `ids` where height fields are hit nearer."""
    parts = numba.get_num_threads()
    depths, numbers = np.full((parts, *depth.shape), np.inf, np.float32), np.empty((parts, *ids.shape), np.uint32)
    depths[0], numbers[:] = depth, ids
    for _, field, base in scene.heights:
        start, directions = field.pose.field_from_pixel(camera)
        rows, columns = field.height.shape
        descending = (bool(start[1] > 0.5 * rows), bool(start[0] > 0.5 * columns))
        view = (field.pose.pixel_from_field(camera), pack_rays(start, directions), EYE * field.reach)
        project_heights.project_heights(field.height, field.low, field.high, view, descending, base, depths, numbers)
    if parts > 1:
        project_heights.merge(depths, numbers)
    depth[:], ids[:] = depths[0], numbers[0]
