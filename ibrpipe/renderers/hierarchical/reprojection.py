"""The published method: samples of six views of every part in a depth buffer. Source: max1999, sec. 2 and 3."""

from __future__ import annotations

from dataclasses import replace

import numba
import numpy as np

from ibrpipe.core.hierarchy import reproject as kernels
from ibrpipe.renderers.hierarchical.orthogonal_views import RESOLUTION
from ibrpipe.renderers.hierarchical.selection import Selection
from ibrpipe.renderers.hierarchical.view import View
from ibrpipe.types import Array
from ibrpipe.types.prerendered import OrthogonalViews, Prerendered


def without_slices(chosen: Selection) -> Selection:
    """Return what is drawn as polygons alone."""
    return replace(
        chosen, slice_nodes=chosen.slice_nodes[:0], slice_poses=chosen.slice_poses[:0], choices=chosen.choices[:0]
    )


def reproject(
    library: Prerendered, views: OrthogonalViews, rows: Array, chosen: Selection, view: View,
    picture: tuple[Array, Array, Array],
) -> None:  # fmt: skip
    """Draw all chosen parts into a picture of polygons: colour (H, W, 3), alpha (H, W), depth (H, W), nearest first.

    Copies are drawn part after part, so that every part's samples are loaded once.
    """
    color, alpha, depth = picture
    order = np.argsort(rows[chosen.slice_nodes], kind="stable")
    parts, poses = rows[chosen.slice_nodes][order], chosen.slice_poses[order]
    counts = views.firsts[parts + 1] - views.firsts[parts]
    draws = np.stack([views.firsts[parts], counts, np.cumsum(counts) - counts], axis=1).astype(np.int64)
    scales = np.cbrt(np.abs(np.linalg.det(poses.reshape(-1, 3, 4)[:, :, :3])))
    widths = scales * 2.0 * library.spheres[parts, 3] / RESOLUTION
    shape = (numba.get_num_threads(), *depth.shape)
    near, ids = np.full(shape, np.inf, np.float32), np.full(shape, kernels.NOTHING, np.int64)
    near[0] = np.where(alpha >= 0.5, depth, np.inf)
    kernels.reproject(draws, poses, widths, views.places, view.calibration, view.near, near, ids)
    kernels.merge(near, ids)
    samples = (views.albedo, views.normals)
    rays = np.linalg.inv(view.calibration)
    kernels.shade_samples(ids[0], draws, poses, samples, view.lights, view.lighting, rays, color)
    seen = ids[0] != kernels.NOTHING
    alpha[seen], depth[seen] = 1.0, near[0][seen]
