"""Refine residuals by back-projection: render the training photos, blend what is missing back into the residuals.

A residual texel is a blend of photos, and a rendered pixel a blend of residual texels; the two blends together blur.
As in iterative back-projection (irani1991), the photos are rendered at the mesh's own surface points, and the error
images are carried back by the very blend that made the residuals. This is no part of gong-yang.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from ibrpipe.core.color import srgb_encode
from ibrpipe.modelling.diffuse import diffuse_frame
from ibrpipe.modelling.view_dependence.work_units import Context
from ibrpipe.progress import track
from ibrpipe.renderers.view_dependence import spiral
from ibrpipe.types import Array, SpiralTexture


def photo_errors(context: Context, textures: Sequence[SpiralTexture]) -> tuple[Array, float]:
    """Render every training photo on exact geometry and subtract it from the photo, as `errors_in_batches` does."""
    return errors_in_batches(context, [(range(len(context.photos.cameras)), textures)])


def errors_in_batches(
    context: Context, batches: Iterable[tuple[Sequence[int], Sequence[SpiralTexture]]]
) -> tuple[Array, float]:
    """Render every training photo on exact geometry and subtract it from the photo.

    Parameters
    ----------
    batches : photos, and textures with residuals whose texels are float32 in 255ths of the display code, `zero` 0

    Returns
    -------
    errors : (T, 3) float32
        Photo minus render in display code (1 = white), all photos' pixels; 0 outside the mask and where the mesh or its
        diffuse colour is missing.
    psnr : float
        Over all pixels that count, dB; infinite if none differs.
    """
    photos = context.photos
    errors, total, count = np.zeros_like(photos.code), 0.0, 0
    for p, held in track(_with_tables(batches), "refinement", len(photos.cameras)):
        camera = photos.cameras[p]
        color, depth, known = diffuse_frame(context.caster, context.diffuse, camera)
        spiral.add(held[0], color, depth, camera)
        own = slice(photos.starts[p], photos.starts[p] + depth.size)
        good = known.ravel() & (photos.mask[own] >= 0.5)
        error = photos.code[own] - srgb_encode(color.reshape(-1, 3), np.inf)
        errors[own] = np.where(good[:, None], error, 0.0)
        total += float((errors[own].astype(np.float64) ** 2).sum())
        count += 3 * int(good.sum())
    return errors, float(-10.0 * np.log10(total / count)) if total > 0 else float("inf")


def _with_tables(
    batches: Iterable[tuple[Sequence[int], Sequence[SpiralTexture]]],
) -> Iterator[tuple[int, list[spiral.Tables]]]:
    """Yield photos, each with a list that holds its tables; they are gone from it before the next batch is made."""
    for photos, textures in batches:
        held = [dataclasses.replace(spiral.prepare(textures), coded=True)]
        del textures
        for photo in photos:
            yield photo, held
        held.clear()
