"""Refine residuals by back-projection: render the training photos, blend what is missing back into the residuals.

A residual texel is a blend of photos, and a rendered pixel a blend of residual texels; the two blends together blur.
As in iterative back-projection (Irani and Peleg 1991, "Improving resolution by image registration"), the photos are
rendered at the mesh's own surface points, and the error images are carried back by the very blend that made the
residuals. This is no part of gong-yang.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from ibrpipe.core.color import srgb_encode
from ibrpipe.progress import track
from ibrpipe.renderers import residual_pass
from ibrpipe.stages.residual_units import Context
from ibrpipe.types import Array, Camera, SpiralTexture


def photo_errors(context: Context, textures: Sequence[SpiralTexture]) -> tuple[Array, float]:
    """Render every training photo on exact geometry and subtract it from the photo.

    Parameters
    ----------
    textures : with residuals whose texels are float32 in 255ths of the display code, `zero` 0

    Returns
    -------
    errors : (T, 3) float32
        Photo minus render in display code (1 = white), all photos' pixels; 0 outside the mask and where the mesh or its
        diffuse colour is missing.
    psnr : float
        Over all pixels that count, dB; infinite if none differs.
    """
    tables = dataclasses.replace(residual_pass.prepare(textures), coded=True)
    photos = context.photos
    errors, total, count = np.zeros_like(photos.code), 0.0, 0
    for p, camera in enumerate(track(photos.cameras, "refinement")):
        color, depth, known = diffuse_frame(context, camera)
        residual_pass.add(tables, color, depth, camera)
        own = slice(photos.starts[p], photos.starts[p] + depth.size)
        good = known.ravel() & (photos.mask[own] >= 0.5)
        error = photos.code[own] - srgb_encode(color.reshape(-1, 3), np.inf)
        errors[own] = np.where(good[:, None], error, 0.0)
        total += float((errors[own].astype(np.float64) ** 2).sum())
        count += 3 * int(good.sum())
    return errors, float(-10.0 * np.log10(total / count)) if total > 0 else float("inf")


def diffuse_frame(context: Context, camera: Camera) -> tuple[Array, Array, Array]:
    """Diffuse colour (H, W, 3) float32 linear at the mesh's surface, depth (H, W) float32, and where it is known."""
    hits = context.caster.cast_camera(camera)
    hit = np.isfinite(hits.t)
    row, column = np.nonzero(hit)
    rays = np.stack([column + 0.5, row + 0.5, np.ones(len(row))], axis=1) @ camera.world_from_pixel.T
    points = camera.center + hits.t[hit][:, None].astype(np.float64) * rays
    found = context.diffuse.at(points, context.caster.smooth_normals(hits.face[hit], hits.uv[hit]))
    color, known = np.zeros((*hit.shape, 3), np.float32), np.zeros(hit.shape, bool)
    known[hit] = np.isfinite(found).all(axis=1)
    color[hit] = np.nan_to_num(found)
    return color, hits.t.astype(np.float32), known
