"""Sharpen diffuse colours by back-projection: what the photos show beyond a rendering goes back into the texels.

A diffuse texel is a reduction of photos that were interpolated at its place, and a rendered pixel is interpolated
between texels; the two together blur. As in iterative back-projection (irani1991), the diffuse colours are
rendered at the mesh's own surface from every training photo, and the errors are reduced to texels by the very
statistic that made the colours: a median lets highlights move nothing. This is no part of gong-yang.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ibrpipe.capture.photo_set import PhotoSet
from ibrpipe.core.color import srgb_decode, srgb_encode
from ibrpipe.embree import MeshCaster
from ibrpipe.modelling.diffuse import DiffuseSource, diffuse_frame
from ibrpipe.modelling.rectangles import Rectangle
from ibrpipe.progress import track
from ibrpipe.types import Array, LayeredDepthImage

#: added to errors in display code, which then are positive, as the statistics of colours want them
LIFT = 1.0
#: histogram bins of errors over their whole range
BINS = 1024


def sharpen(
    rectangles: Sequence[Rectangle],
    layers: Sequence[LayeredDepthImage],
    wanted: Sequence[bool],
    caster: MeshCaster,
    photos: PhotoSet,
    rounds: int,
    statistic: int,
) -> tuple[list[LayeredDepthImage], list[float]]:
    """Carry the training photos' errors back into the colours of the wanted layers, `rounds` times.

    Parameters
    ----------
    wanted : which layers are to be changed; those with residuals gain nothing, because residuals are refined alike
    statistic : as in `PhotoSet.diffuse`

    Returns
    -------
    layers : list of LayeredDepthImage
        Unseen samples are left as they are.
    psnr : list of float
        Of the diffuse colours on the training photos, in their masks, on exact geometry: before every round and at
        last, dB; empty where nothing is to be done.
    """
    current, psnr = list(layers), list[float]()
    if rounds == 0 or not any(wanted):
        return current, psnr
    for number in range(rounds + 1):
        errors, found = _errors(DiffuseSource(rectangles, current), caster, photos)
        psnr.append(found)
        if number < rounds:
            lifted = replace(photos, code=errors + np.float32(LIFT))
            for which in (index for index, want in enumerate(wanted) if want):
                current[which] = _corrected(current[which], rectangles[which], lifted, statistic)
    return current, psnr


def _errors(diffuse: DiffuseSource, caster: MeshCaster, photos: PhotoSet) -> tuple[Array, float]:
    """Photo minus rendering (T, 3) float32 in display code, 0 where either is missing; and the PSNR."""
    errors, total, count = np.zeros_like(photos.code), 0.0, 0
    for p, camera in enumerate(track(photos.cameras, "sharpen")):
        color, depth, known = diffuse_frame(caster, diffuse, camera)
        own = slice(photos.starts[p], photos.starts[p] + depth.size)
        good = known.ravel() & (photos.mask[own] >= 0.5)
        error = photos.code[own] - srgb_encode(color.reshape(-1, 3), np.inf)
        errors[own] = np.where(good[:, None], np.maximum(error, -LIFT), 0.0)
        total += float((errors[own].astype(np.float64) ** 2).sum())
        count += 3 * int(good.sum())
    return errors, float(-10.0 * np.log10(total / count)) if total > 0 else float("inf")


def _corrected(layers: LayeredDepthImage, rectangle: Rectangle, lifted: PhotoSet, statistic: int) -> LayeredDepthImage:
    found, _, count = lifted.diffuse(sample_points(rectangle, layers), layers.normal, BINS, statistic)
    seen = (count > 0) if layers.observers is None else (count > 0) & (layers.observers > 0)
    code = srgb_encode(layers.color[seen], np.inf) + srgb_encode(found[seen], np.inf) - np.float32(LIFT)
    color = layers.color.copy()
    color[seen] = srgb_decode(np.maximum(code, 0.0))
    return replace(layers, color=color)


def sample_points(rectangle: Rectangle, layers: LayeredDepthImage) -> Array:
    """World points (S, 3) float64 of all samples."""
    origins, directions = rectangle.rays()
    ray = np.repeat(np.arange(len(origins)), np.diff(layers.offsets, axis=1).ravel())
    return origins[ray] + layers.depth[:, None].astype(np.float64) * directions[ray]
