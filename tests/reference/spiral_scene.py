"""Two small spiral textures around the origin, and what the kernels take of them."""

from __future__ import annotations

import numpy as np

from ibrpipe.core.spiral import directions
from ibrpipe.renderers.view_dependence.spiral import Tables, prepare
from ibrpipe.types import Camera, LayeredDepthImage, ParallelFrame, SpiralResiduals, SpiralTexture

LOW = ParallelFrame((-1, -1, -1), (2, 0, 0), (0, 2, 0), (0, 0, 1))
SIDE = ParallelFrame((-1, -1, 1), (0, 0, -2), (0, 2, 0), (1, 0, 0))
CAMERA = Camera.look_at((-2.2, 0.4, -3.1), (0, 0, 0), fov_y_deg=35, width=11, height=9)


def member(frame, k, seed, closed, dtype=np.uint8):
    """Residuals of one texture: images of 1 to 6 texels a side, a fifth of which are holes."""
    rng = np.random.default_rng(seed)
    alphas = directions.table(k, closed)
    ways = directions.directions(alphas, k, directions.LIMIT if closed else np.pi / 2)
    sizes = rng.integers(1, 7, (len(ways), 2)).astype(np.int32)
    starts = np.concatenate([[0], np.cumsum(sizes.astype(np.int64).prod(axis=1))])
    coded = dtype == np.uint8
    texels = rng.integers(0, 100, (starts[-1], 3)) if coded else rng.normal(0, 0.2, (starts[-1], 3))
    seen = rng.random(starts[-1]) < 0.8
    return SpiralResiduals(frame, k, alphas, ways, sizes, starts, texels.astype(dtype), seen, 32 * coded, closed)


def members(closed=True, dtype=np.uint8):
    return [member(LOW, 1 / 4, 70, closed, dtype), member(SIDE, 1 / 5, 72, closed, dtype)]


def tables_of(found) -> Tables:
    layers = LayeredDepthImage(LOW, np.zeros((1, 2)), np.zeros(0), np.zeros((0, 3)), np.zeros((0, 3)))
    return prepare([SpiralTexture(layers, each) for each in found])


def frames_of(tables: Tables):
    """The textures' frames as the vector kernels take them: from pixels, the eye, 1 / edge lengths."""
    eyes = np.einsum("trc,tc->tr", tables.rotations, CAMERA.center - tables.origins)
    return tables.rotations @ CAMERA.world_from_pixel, eyes, tables.scales


def picture(seed=71):
    """(color, depth) of a surface around the origin, with holes."""
    rng = np.random.default_rng(seed)
    depth = rng.uniform(3.0, 4.6, (9, 11)).astype(np.float32)
    depth[rng.random(depth.shape) < 0.2] = np.inf
    return rng.uniform(0, 1.2, (9, 11, 3)).astype(np.float32), depth
