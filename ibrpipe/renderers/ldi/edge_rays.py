"""Edges drawn from several rays a pixel; all other pixels keep their one."""

from __future__ import annotations

import numba
import numpy as np

from ibrpipe.core.ldi import subsamples
from ibrpipe.renderers.edges import OFFSETS, PLACES, edge_pixels
from ibrpipe.renderers.pixel_grid import PixelGrid
from ibrpipe.renderers.scene import Hits, Scene, shade_hits
from ibrpipe.renderers.search.projection import patch_views
from ibrpipe.renderers.view_dependence.component import Picture
from ibrpipe.types import Array, Camera


def trace_edges(scene: Scene, camera: Camera, depth: Array, known: Array) -> Picture | None:
    """Trace the rays of the pixels that show an edge, up to their view-independent colour; None = no edge.

    Parameters
    ----------
    depth, known : (H, W) float32
        Of one ray a pixel.

    Returns
    -------
    Picture
        (N, S) rays: a row for every such pixel.
    """
    asked = edge_pixels(depth, known)
    counts = asked.sum(axis=1, dtype=np.int64)
    firsts, number, rays = np.cumsum(counts) - counts, int(counts.sum()), len(PLACES)
    if number == 0:
        return None
    slots, rows = np.empty(depth.shape, np.int32), np.empty((number, 2))
    tiles = np.zeros([-(-size // subsamples.TILE) for size in depth.shape], np.uint8)
    subsamples.number_pixels(asked, firsts, slots, tiles, rows)
    keys, blocks = np.empty((numba.get_num_threads(), 1, number * rays), np.int64), scene.blocks
    views, size = patch_views(scene, camera), (camera.width, camera.height)
    subsamples.search_subsamples(
        blocks.patches, blocks.blocks, blocks.bounds, views, size, (slots, tiles, OFFSETS), keys
    )
    hits = Hits(np.empty((number, rays), np.float32), np.empty((number, rays), np.uint32))
    subsamples.merge_subsamples(keys, hits.depth, hits.ids)
    grid = PixelGrid(rows, PLACES)
    color, seen = shade_hits(scene, hits, camera, grid)
    return Picture(scene, camera, color, hits.depth, hits.ids, seen, grid)


def draw_means(edges: Picture, color: Array, known: Array) -> None:
    """Put the means of all rays of edges into the picture (H, W, 3), and what they cover into (H, W)."""
    subsamples.mean_colors(edges.color, edges.known, edges.places.rows, color, known)
