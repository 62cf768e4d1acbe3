"""Edges drawn from several rays a pixel; all other pixels keep their one."""

from __future__ import annotations

from collections.abc import Sequence

import numba
import numpy as np

from ibrpipe.core.ldi import subsamples
from ibrpipe.renderers.edges import MOST_RAYS, OFFSETS, PLACES, edge_pixels
from ibrpipe.renderers.ldi.levels import MOST, Level, mix, shade_levels
from ibrpipe.renderers.pixel_grid import PixelGrid
from ibrpipe.renderers.scene import Scene
from ibrpipe.renderers.search.projection import patch_views
from ibrpipe.renderers.view_dependence.component import Picture
from ibrpipe.types import Array, Camera


def edge_bands(depth: Array, known: Array) -> list[Array]:
    """Return the pixels that show an edge, (H, W) uint8, in bands of rows of at most `MOST_RAYS` rays; empty = none.

    Parameters
    ----------
    depth, known : (H, W) float32
        Of one ray a pixel.
    """
    asked = edge_pixels(depth, known)
    before, bands, done = np.concatenate([[0], np.cumsum(asked.sum(axis=1, dtype=np.int64))]), [], 0
    while before[done] < before[-1]:
        top = int(np.searchsorted(before, before[done], "right")) - 1  # the first row that has some
        done = max(top + 1, int(np.searchsorted(before, before[top] + MOST_RAYS // len(PLACES), "right")) - 1)
        band = np.zeros_like(asked)
        band[top:done] = asked[top:done]
        bands.append(band)
    return bands


def trace_edges(scene: Scene, camera: Camera, asked: Array) -> list[Picture]:
    """Trace the rays of some pixels up to their view-independent colour.

    Parameters
    ----------
    asked : (H, W) uint8
        1 at these pixels, at least one.

    Returns
    -------
    list of Picture
        (N, S) rays, a row for every such pixel: what is hit first and, where samples fill their texel in part, behind.
    """
    counts = asked.sum(axis=1, dtype=np.int64)
    firsts, number, rays = np.cumsum(counts) - counts, int(counts.sum()), len(PLACES)
    slots, rows = np.empty(asked.shape, np.int32), np.empty((number, 2))
    tiles = np.zeros([-(-size // subsamples.TILE) for size in asked.shape], np.uint8)
    subsamples.number_pixels(asked, firsts, slots, tiles, rows)
    ranks = 1 + MOST if scene.soft else 1
    keys, blocks = np.empty((numba.get_num_threads(), ranks, number * rays), np.int64), scene.blocks
    views, size = patch_views(scene, camera), (camera.width, camera.height)
    subsamples.search_subsamples(
        blocks.patches, blocks.blocks, blocks.bounds, views, size, (slots, tiles, OFFSETS), keys
    )
    depths, ids = np.empty((ranks, number, rays), np.float32), np.empty((ranks, number, rays), np.uint32)
    subsamples.merge_subsamples(keys, depths, ids)
    grid = PixelGrid(rows, PLACES)
    levels = shade_levels(scene, camera, depths, ids, np.ones((number, rays), np.float32), grid)
    return [Picture(scene, camera, each.color, each.depth, each.ids, each.known, grid) for each in levels]


def draw_means(edges: Sequence[Picture], color: Array, known: Array) -> None:
    """Put the means of all rays of edges into the picture (H, W, 3), and what they cover into (H, W)."""
    levels = [Level(each.depth, each.ids, each.color, each.known) for each in edges]
    mixed = mix(levels, edges[0].scene.texel)
    subsamples.mean_colors(mixed.color, mixed.known, edges[0].places.rows, color, known)
