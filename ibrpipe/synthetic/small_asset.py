"""Sources of a few hundred texels, of every kind that a pipeline makes, to call kernels with: a bumpy plate."""

from __future__ import annotations

import numpy as np

from ibrpipe.core.spiral import directions
from ibrpipe.types import (
    Array,
    Asset,
    Blend,
    Camera,
    KeptPhoto,
    KeptPhotos,
    LayeredDepthImage,
    ParallelFrame,
    PhotoBlend,
    ReflectedLight,
    Reflection,
    ReliefTexture,
    SpiralResiduals,
    Texture,
    ViewDependence,
)
from ibrpipe.types.layers import offsets_of

#: texels along an edge; the plate lies in z = 0 to 2 and is seen from z < 0
CELLS = 16
_FRAME = ParallelFrame(np.zeros(3), *np.eye(3))


def bumps() -> Array:
    """(CELLS, CELLS) float64 depths."""
    row, column = np.mgrid[:CELLS, :CELLS]
    return 1 + np.sin(row / 2) * np.sin(column / 3)


def relief_texture() -> ReliefTexture:
    """The plate as heights."""
    return ReliefTexture(_FRAME, np.full((CELLS, CELLS, 3), 0.5), bumps())


def asset(*kinds: str) -> Asset:
    """Return the plate as layers, with view dependence of some kinds among "reflection", "spiral" and "photos"."""
    depth = bumps().ravel()
    colors, normals = np.full((len(depth), 3), 0.5), np.tile([0.0, 0.0, -1.0], (len(depth), 1))
    offsets = offsets_of(np.ones((CELLS, CELLS), int))
    layers = LayeredDepthImage(_FRAME, offsets, depth, colors, normals, np.ones(len(depth), np.int32))
    made = {"reflection": _reflection, "spiral": _spiral, "photos": _photos}
    return Asset((Texture(layers, tuple(made[kind](len(depth)) for kind in kinds)),))


def _reflection(samples: int) -> ViewDependence:
    return Reflection(ReflectedLight(np.full((2, 4, 4, 3), 0.5), (0.04, 0.9)), np.full((samples, 2), 0.5))


def _spiral(_: int) -> ViewDependence:
    k = 1 / 6
    alphas = directions.table(k)
    sizes = np.full((len(alphas), 2), 4, np.int32)
    starts = np.concatenate([[0], np.cumsum(sizes.prod(axis=1))])
    rectangle = ParallelFrame(_FRAME.origin, CELLS * _FRAME.a, CELLS * _FRAME.b, _FRAME.f)
    texels, valid = np.full((starts[-1], 3), 60, np.uint8), np.ones(starts[-1], bool)
    seen = directions.directions(alphas, k)
    return SpiralResiduals(rectangle, k, alphas, seen, sizes, starts, texels, valid, 60)


def _photos(_: int) -> ViewDependence:
    middle = CELLS / 2
    photos = []
    for number, x in enumerate((-CELLS / 4, middle, 1.25 * CELLS)):
        camera = Camera.look_at((x, middle, -2.0 * CELLS), (middle, middle, 1.0), width=24, height=20)
        codes = np.full((20, 24, 3), 60 + 60 * number, np.uint8)
        photos.append(KeptPhoto(camera, codes, np.ones((20, 24), bool)))
    return PhotoBlend(KeptPhotos(tuple(photos), blend=Blend(3, 0.75, 0.5)))
