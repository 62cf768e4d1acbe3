"""What the `splat` renderer does: forward warp of reference samples, the baseline of schaufler1999, sec. 3.

Every sample of the first layer is projected and covers the pixels of its footprint, nearest first. Where the reference
is sampled too sparsely, on surfaces turned away from it, holes and steps remain: what inverse warping avoids.
"""

from __future__ import annotations

from time import perf_counter
from typing import Any

import numba
import numpy as np

from ibrpipe.core import splat
from ibrpipe.core.ldi.project_heights import merge
from ibrpipe.renderers.epipolar.components import add_components
from ibrpipe.renderers.epipolar.renderer import Maps
from ibrpipe.renderers.epipolar.samples import Raster, shade_raster
from ibrpipe.renderers.frames import limited_threads, make_frame
from ibrpipe.renderers.scene import Hits
from ibrpipe.renderers.splat.options import SplatOptions
from ibrpipe.types import Array, Camera, Frame


def draw(maps: Maps, camera: Camera, outputs: tuple[str, ...], options: SplatOptions) -> Frame:
    """Render one frame; see `ibrpipe.render`."""
    began = perf_counter()
    stats: dict[str, Any] = {}
    with limited_threads(options.threads):
        hits = _splat(maps, camera, float(options.footprint))
        color, known = None, None
        if {"color", "alpha"} & set(outputs):
            color, known = np.zeros((*hits.depth.shape, 3), np.float32), np.zeros(hits.depth.shape, np.float32)
            for base, raster in maps.rasters:
                shade_raster(raster, camera, "nearest", base, hits, color, known)
            if options.residuals and "color" in outputs and maps.scene.components:
                stats.update(add_components(maps.scene, camera, maps.patch_hits(hits), color, known))
    stats.update({"milliseconds": 1e3 * (perf_counter() - began), "hits": int(np.isfinite(hits.depth).sum())})
    return make_frame(outputs, hits.depth, color, known, stats)


def _shown(raster: Raster, camera: Camera) -> Array:
    """Depths (rows, columns) float32 of samples that are seen from the side of their surface, others NaN.

    A ray through a sample at S = (u, v, d) moves along ``P_q S - P`` in the field, P its start; d less what the slopes
    of the samples say must grow where a surface is seen from lesser depth, and fall where it is seen from greater.
    """
    side = raster.steps[2]
    if side == 0.0:
        return raster.depth
    start, _ = raster.pose.field_from_pixel(camera)
    v, u = np.indices(raster.depth.shape)
    along_u, along_v = raster.slopes
    grows = (
        raster.depth * start[3] - start[2] - along_u * (u * start[3] - start[0]) - along_v * (v * start[3] - start[1])
    )
    shown: Array = np.where(grows * side > 0.0, raster.depth, np.float32(np.nan))
    return np.ascontiguousarray(shown, np.float32)


def _splat(maps: Maps, camera: Camera, footprint: float) -> Hits:
    chunks = numba.get_num_threads()
    depth = np.full((chunks, camera.height, camera.width), np.inf, np.float32)
    ids = np.full(depth.shape, 2**32 - 1, np.uint32)
    for base, raster in maps.rasters:
        splat.splat_samples(
            _shown(raster, camera).ravel(), raster.depth.shape[1], raster.pose.pixel_from_field(camera),
            raster.pose.perspective, raster.eye, base, footprint, depth, ids,
        )  # fmt: skip
    if chunks > 1:
        merge(depth, ids)
    return Hits(depth[0], ids[0])
