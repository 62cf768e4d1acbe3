"""Residual images of one support rectangle: along which directions, at which sizes, and what surface they see.

Source: gong-yang, sec. 3 (directions, eq. 6 for the sizes) and 4.2 (parallel rays through the rectangle).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ibrpipe.core.spiral import directions as spiral
from ibrpipe.embree import MeshCaster
from ibrpipe.modelling.plan_file import TexturePlan
from ibrpipe.modelling.view_dependence.spiral_plan import spiral_of
from ibrpipe.types import Array, ParallelFrame

#: texels whose rays are cast together, about
BAND = 200_000


@dataclass(frozen=True, eq=False)
class SpiralImage:
    """One residual image: along which direction (3,) of the rectangle's frame, at which size in texels."""

    direction: Array
    height: int
    width: int

    @property
    def texels(self) -> int:
        """Number of texels."""
        return self.height * self.width


@dataclass(frozen=True, eq=False)
class Surface:
    """What the rays of one image, or of some of its rows, hit.

    Attributes
    ----------
    texel : (N,) int64, texels of the image whose ray hits a front face
    points : (N, 3) float64, world
    normals : (N, 3) float32, unit, outward
    toward : (N, 3) float64, unit, world direction of the image, from the surface to the viewer
    """

    texel: Array
    points: Array
    normals: Array
    toward: Array


def spiral_images(plan: TexturePlan, closed: bool) -> tuple[Array, list[SpiralImage]]:
    """Return the spiral's alphas (n,) and one image per direction, sized by the repaired scale factors (eq. 6)."""
    planned = spiral_of(plan)
    alphas = spiral.table(planned.k, closed)
    directions = spiral.directions(alphas, planned.k, spiral.LIMIT if closed else np.pi / 2)
    images = []
    for direction in directions:
        rx, ry = spiral.scale_factors(direction)
        width = max(1, round(plan.rectangle.width * planned.residual_scale * rx))
        height = max(1, round(plan.rectangle.height * planned.residual_scale * ry))
        images.append(SpiralImage(direction, height, width))
    return alphas, images


def cast_image(frame: ParallelFrame, image: SpiralImage, caster: MeshCaster) -> Iterator[Surface]:
    """Cast the ray of every texel of an image, `BAND` of them at a time; `frame` has whole edges as a and b."""
    rows = max(1, BAND // image.width)
    for first in range(0, image.height, rows):
        surface = _cast_rows(frame, image, caster, first, min(first + rows, image.height))
        if len(surface.texel):
            yield surface


def _cast_rows(frame: ParallelFrame, image: SpiralImage, caster: MeshCaster, first: int, last: int) -> Surface:
    basis = np.stack([frame.a / np.linalg.norm(frame.a), frame.b / np.linalg.norm(frame.b), -frame.f])
    toward = image.direction @ basis
    u, v = np.meshgrid((np.arange(image.width) + 0.5) / image.width, (np.arange(first, last) + 0.5) / image.height)
    origins = frame.origin + u.reshape(-1, 1) * frame.a + v.reshape(-1, 1) * frame.b
    hits = caster.cast(origins, np.broadcast_to(-toward, origins.shape))
    hit = np.flatnonzero((hits.face >= 0) & ((hits.normal @ toward) > 0))
    points = origins[hit] - hits.t[hit, None].astype(np.float64) * toward
    normals = caster.smooth_normals(hits.face[hit], hits.uv[hit])
    return Surface(hit + first * image.width, points, normals, np.broadcast_to(toward, points.shape))


def chunks(images: list[SpiralImage], most: int) -> list[tuple[int, int]]:
    """Split images into runs (first, last + 1) of about `most` texels, at least one image each."""
    ends = np.cumsum([image.texels for image in images])
    bounds = np.unique(np.searchsorted(ends, np.arange(most, ends[-1], most)) + 1)
    edges = [0, *(int(b) for b in bounds if b < len(images)), len(images)]
    return list(pairwise(edges))
