"""Residuals before they are coded, and those of their images that some photos look up, within a bound of memory."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import cast

import numpy as np

from ibrpipe.core.spiral.marks import mark_images
from ibrpipe.engine.memory_map import hand_back
from ibrpipe.modelling.plan_file import TexturePlan
from ibrpipe.modelling.view_dependence.spiral_images import spiral_images
from ibrpipe.modelling.view_dependence.spiral_plan import spiral_of
from ibrpipe.modelling.view_dependence.work_units import Context
from ibrpipe.renderers.view_dependence import spiral
from ibrpipe.types import Array, SpiralResiduals, SpiralTexture

#: bytes that a texel takes while photos are rendered: texels and validity, and both joined for the kernel
TEXEL_BYTES = 32


@dataclass(eq=False)
class Samples:
    """Residuals of one texture before they are coded.

    Attributes
    ----------
    which : index of the texture in the plan
    difference : (T, 3) float32, colour minus diffuse colour in display code (1 = white); NaN = none
    base : (T, 3) float32, diffuse colour, linear; None where the encoding does without
    """

    which: int
    difference: Array
    base: Array | None

    @property
    def valid(self) -> Array:
        """(T,) bool, texels that hold a residual."""
        return np.asarray(np.isfinite(self.difference).all(axis=1))


def uncoded(context: Context, samples: Samples, closed: bool, wanted: Array | None = None) -> SpiralResiduals:
    """Residuals as they are before coding: texels float32 in 255ths of the display code, `zero` 0.

    Parameters
    ----------
    wanted : (n,) bool, optional
        Images to take; the others get the size 0.
    """
    plan = context.plans[samples.which]
    areas = np.array([image.texels for image in spiral_images(plan, closed)[1]], np.int64)
    wanted = np.ones(len(areas), bool) if wanted is None else wanted
    starts = np.concatenate([[0], np.cumsum(areas)])
    texels = np.zeros((int(areas[wanted].sum()), 3), np.float32)
    valid, end = np.zeros(len(texels), bool), 0
    for i in np.flatnonzero(wanted):
        part, own = samples.difference[starts[i] : starts[i + 1]], slice(end, end + int(areas[i]))
        valid[own] = np.isfinite(part).all(axis=1)
        texels[own] = np.float32(255) * np.where(valid[own, None], part, np.float32(0))
        end = own.stop
    hand_back(samples.difference)
    return assemble(plan, closed, texels, valid, 0, wanted)


def assemble(
    plan: TexturePlan, closed: bool, texels: Array, valid: Array, zero: int, wanted: Array | None = None
) -> SpiralResiduals:
    """Put texels (T, 3) uint8 or float32 and the geometry of their images together; images not `wanted` are empty."""
    alphas, images = spiral_images(plan, closed)
    sizes = np.array([(image.height, image.width) for image in images], np.int32)
    if wanted is not None:
        sizes[~wanted] = 0
    starts = np.concatenate([[0], np.cumsum(sizes.astype(np.int64).prod(axis=1))])
    directions = np.stack([image.direction for image in images])
    k = spiral_of(plan).k
    return SpiralResiduals(plan.rectangle.edges, k, alphas, directions, sizes, starts, texels, valid, zero, closed)


def in_batches(
    context: Context, samples: Sequence[Samples], closed: bool, memory: int
) -> Iterator[tuple[range, list[SpiralTexture]]]:
    """Yield photos one after another, as many at a time as fit, with the residuals that they look up.

    Parameters
    ----------
    memory : bytes that the residuals of a batch may take; a photo that needs more gets more
    """
    photos = range(len(context.photos.cameras))
    areas = [[image.texels for image in spiral_images(context.plans[s.which], closed)[1]] for s in samples]
    edges = np.cumsum([0] + [len(part) for part in areas])
    area = np.concatenate([np.array(part, np.int64) for part in areas])

    def batch(first: int, last: int, wanted: Array) -> tuple[range, list[SpiralTexture]]:
        parts = [wanted[edges[i] : edges[i + 1]] for i in range(len(samples))]
        found = [uncoded(context, s, closed, part) for s, part in zip(samples, parts, strict=True)]
        own = (context.layers[s.which] for s in samples)
        return photos[first:last], [SpiralTexture(*pair) for pair in zip(own, found, strict=True)]

    most = memory // TEXEL_BYTES
    if area.sum() <= most:
        yield batch(0, len(photos), np.ones(len(area), bool))
        return
    nothing = [uncoded(context, s, closed, np.zeros(len(part), bool)) for s, part in zip(samples, areas, strict=True)]
    tables = spiral.prepare([SpiralTexture(context.layers[s.which], r) for s, r in zip(samples, nothing, strict=True)])
    first, union = 0, np.zeros(len(area), bool)
    for photo in photos:
        needed = looked_up(context, tables, photo)
        if photo > first and area[union | needed].sum() > most:
            yield batch(first, photo, union)
            first, union = photo, np.zeros(len(area), bool)
        union |= needed
    yield batch(first, len(photos), union)


def looked_up(context: Context, tables: spiral.Tables, photo: int) -> Array:
    """(D,) bool: images of all textures that a render of the photo may read."""
    photos, camera = context.photos, context.photos.cameras[photo]
    start = photos.starts[photo]
    depth = photos.depth[start : start + camera.height * camera.width].reshape(camera.height, camera.width)
    spirals = cast(tuple[Array, ...], tables.arrays[0])
    marks = np.empty((camera.height, len(spirals[0])), bool)
    frames = tables.rotations, tables.origins, tables.scales
    world_from_pixel = np.ascontiguousarray(camera.world_from_pixel)
    mark_images(depth, world_from_pixel, frames, spirals, marks)
    return np.asarray(marks.any(axis=0))
