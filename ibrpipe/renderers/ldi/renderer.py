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

from ibrpipe.core.ldi import project, project_heights
from ibrpipe.renderers.frames import limited_threads, make_frame
from ibrpipe.renderers.ldi.options import LdiOptions, Search
from ibrpipe.renderers.scene import Hits, Scene, shade_hits
from ibrpipe.renderers.search.epipolar_lines import EYE, cast_map
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
        color, known = shade_hits(scene, hits, camera) if {"color", "alpha"} & set(outputs) else (None, None)
        if known is not None:
            stats["hits"] = int(np.count_nonzero(known))
        stats["milliseconds"] = 1e3 * (perf_counter() - began)
        yield make_frame(outputs, hits.depth, color, known, stats)
        if not (options.residuals and "color" in outputs and scene.components):
            return
        if color is not None and known is not None:
            picture = Picture(scene, camera, color, hits.depth, hits.ids, known)
            for component in scene.components:
                stats.update(component.add(picture))
            stats["milliseconds"] = 1e3 * (perf_counter() - began)
            yield make_frame(outputs, hits.depth, color, known, stats)


def find_hits(scene: Scene, camera: Camera, search: Search = "auto") -> Hits:
    """Find the nearest hit of every pixel's ray over all fields.

    Parameters
    ----------
    search : {"auto", "patches", "lines", "quadtree"}
        Project the patches, search height fields along whole epipolar lines (layered images are projected), or walk
        every ray through the pyramids; all find the same hits. "auto" takes lines for height fields.
    """
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
    poses = [field.pose for _, field in scene.patches]
    starts, directions = (
        np.stack(part) for part in zip(*(pose.field_from_pixel(camera) for pose in poses), strict=True)
    )
    pixels = np.stack([pose.pixel_from_field(camera) for pose in poses])
    eyes = np.array([EYE * field.reach for _, field in scene.patches])
    signs = np.sign(np.linalg.det(pixels[:, :, :3])) * np.sign(starts[:, 3])  # the line to an eye behind a frame's
    perspective = np.array([pose.perspective for pose in poses])
    parts, (columns, rows) = numba.get_num_threads(), (camera.width, camera.height)
    memory = scene.pictures.pop() if scene.pictures else np.empty(0, np.int64)
    if len(memory) < parts * columns * rows:
        memory = np.empty(parts * columns * rows, np.int64)
    keys = memory[: parts * columns * rows].reshape(parts, columns * rows)
    views = (pixels, pack_rays(starts, directions), eyes, signs, perspective)
    blocks = scene.blocks
    project.project_patches(blocks.patches, blocks.blocks, blocks.bounds, views, (columns, rows), keys)
    depth, ids = np.empty((rows, columns), np.float32), np.empty((rows, columns), np.uint32)
    project.merge_pictures(keys, columns, depth, ids)
    scene.pictures.append(memory)
    return depth, ids


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


def pack_rays(start: Array, directions: Array) -> Array:
    """(..., 16) float64: start (..., 4), then directions (..., 4, 3) row by row, for the projecting kernels."""
    return np.concatenate([start, directions.reshape(*directions.shape[:-2], 12)], axis=-1)
