"""The exact answer: nearest hits of surfaces in float64, with the range that rounding could excuse.

A pixel is *clear* when the hit stays where it is while the surface is moved by a millionth of a texel and its borders
by a millionth of a cell; elsewhere (silhouettes, rays along a crack, an eye on the surface) any hit between the
earliest and the latest counts as right.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ibrpipe.bench.oracles import kernels
from ibrpipe.bench.oracles.surface import Surface
from ibrpipe.types import Array, Camera

#: how far surface (texels) and borders (cells) are moved to find the pixels that are not clear
DOUBT = 1e-6
#: pairs of ray and patch above which rays walk the cells that they cross
BRUTE = 3_000_000


@dataclass(frozen=True, eq=False)
class Truth:
    """Exact hits of one picture.

    Attributes
    ----------
    depth : (H, W) float64
        Along camera z, scene units, +inf = nothing.
    patch, owner : (H, W) int64
        Patch hit and number of its surface, -1 = nothing.
    earliest, latest : (H, W) float64
        Range of depths that rounding excuses; equal to `depth` where the hit is clear.
    """

    depth: Array
    patch: Array
    owner: Array
    earliest: Array
    latest: Array

    def clear(self, tolerance: float | Array) -> Array:
        """(H, W) bool: a surface is hit, or missed, beyond doubt; `tolerance` in scene units."""
        both = np.isfinite(self.earliest) == np.isfinite(self.latest)
        with np.errstate(invalid="ignore"):
            close = self.latest - self.earliest <= tolerance
        return both & (close | np.isinf(self.depth))


def cast_truth(surfaces: Sequence[Surface], camera: Camera, near: float = 0.0) -> Truth:
    """Cast all pixel centres of `camera` at `surfaces`, with the range that rounding excuses.

    Parameters
    ----------
    surfaces : sequence of Surface
    camera : Camera
    near : float
        Least depth that counts, scene units.
    """
    grid = pixel_centers(camera)
    depth, patch, owner = cast(surfaces, camera, grid, near=near)
    others = [
        cast(surfaces, camera, grid, slack, move, near, brute=False)[0]
        for slack in (DOUBT, -DOUBT)
        for move in (0.0, -DOUBT, DOUBT)
    ]
    found = np.stack([depth, *others])
    shape = (camera.height, camera.width)
    earliest, latest = found.min(axis=0), found.max(axis=0)
    return Truth(*(part.reshape(shape) for part in (depth, patch, owner, earliest, latest)))


def pixel_centers(camera: Camera, samples: int = 1) -> Array:
    """(H * W * samples^2, 2) float64 places in the picture, `samples` by `samples` in every pixel, row by row."""
    step = (np.arange(samples) + 0.5) / samples
    y, dy, x, dx = np.meshgrid(
        np.arange(camera.height), step, np.arange(camera.width), step, indexing="ij", sparse=False
    )
    grid = np.stack([x + dx, y + dy], axis=-1).transpose(0, 2, 1, 3, 4)
    return grid.reshape(-1, 2)


def cast(
    surfaces: Sequence[Surface],
    camera: Camera,
    pixels: Array,
    slack: float = 0.0,
    move: float = 0.0,
    near: float = 0.0,
    split: bool = False,
    brute: bool | None = None,
) -> tuple[Array, Array, Array]:
    """Return depth (N,), patch (N,) and surface number (N,) of the nearest hit of every ray.

    Parameters
    ----------
    pixels : (N, 2) float64
        Places in the picture.
    slack : float
        How far, in cells, the borders of patches are moved outward.
    move : float
        How far, in texels of depth, the surface is moved away from its image plane.
    near : float
        Least depth that counts.
    split : bool
        Cells are two triangles, cut from texel (0, 0) to (1, 1), instead of bilinear patches.
    brute : bool, optional
        Try every patch for every ray; by default where that is not too much.
    """
    best = np.full(len(pixels), np.inf)
    patch, owner = np.full(len(pixels), -1), np.full(len(pixels), -1)
    for number, surface in enumerate(surfaces):
        t, which = _cast_one(surface.moved(move), camera, pixels, slack, near, split, brute)
        closer = t < best
        best[closer], patch[closer], owner[closer] = t[closer], which[closer], number
    return best, patch, owner


def _cast_one(
    surface: Surface, camera: Camera, pixels: Array, slack: float, near: float, split: bool, brute: bool | None
) -> tuple[Array, Array]:
    t, which = np.full(len(pixels), np.inf), np.full(len(pixels), -1)
    if not len(surface.corners) or not len(pixels):
        return t, which
    start, Q_of = surface.rays(camera)
    rule = (surface.front, split, near, surface.grain, surface.perspective, slack)
    if brute if brute is not None else len(pixels) * len(surface.corners) <= BRUTE:
        kernels.cast_all(start, Q_of, pixels, surface.cells, surface.corners, surface.masks, rule, t, which)
    else:
        ranges = np.stack([surface.corners.min(axis=1), surface.corners.max(axis=1)], axis=1)
        low, high = ranges[:, 0].min(), ranges[:, 1].max()
        pad = 1e-3 * (high - low) + 1e-9 * max(abs(low), abs(high)) + (0.0 if surface.perspective else 1e-3)
        high = min(high + pad, -1e-300) if surface.perspective else high + pad
        box = np.array([surface.shape[1], surface.shape[0], low - pad, high])
        walked = (surface.starts, ranges, surface.corners, surface.masks)
        kernels.cast_walks(start, Q_of, pixels, box, walked, rule, t, which)
    return t, which


def colors_at(
    surfaces: Sequence[Surface], camera: Camera, pixels: Array, hits: tuple[Array, Array, Array]
) -> tuple[Array, Array]:
    """Return the bilinear colour (N, 3) float64 of hits as `cast` returns them, 0 where there is none, and which hit.

    Weights are those of the present corners, renormalised.
    """
    depth, patch, owner = hits
    out = np.zeros((len(pixels), 3))
    rays = np.column_stack([pixels, np.ones(len(pixels))])
    for number, surface in enumerate(surfaces):
        chosen = np.flatnonzero(owner == number)
        if not len(chosen):
            continue
        start, Q_of = surface.rays(camera)
        x, y, _, q = start[:, None] + depth[chosen] * (Q_of @ rays[chosen].T)
        cells, samples = surface.cells[patch[chosen]], surface.samples[patch[chosen]]
        u, v = np.clip(x / q - cells[:, 0], 0, 1), np.clip(y / q - cells[:, 1], 0, 1)
        weights = np.stack([(1 - u) * (1 - v), u * (1 - v), (1 - u) * v, u * v], axis=1) * (samples >= 0)
        weights /= np.maximum(weights.sum(axis=1, keepdims=True), 1e-300)
        out[chosen] = (weights[..., None] * surface.color[np.maximum(samples, 0)]).sum(axis=1)
    return out, np.isfinite(depth)
