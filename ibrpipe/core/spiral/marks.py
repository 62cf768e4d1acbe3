"""Which images of spiral textures a picture looks up: only those need be in memory. Source: gong-yang, sec. 5.2.

Symbols as in :mod:`ibrpipe.core.spiral.lookup`.
"""

from __future__ import annotations

import math

import numpy as np
from numba import prange

from ibrpipe.core.jit import kernel
from ibrpipe.core.spiral.lookup import into_rectangle, neighbours, pixel_ray


@kernel
def mark_images(depth, world_from_pixel, frames, spirals, marks):
    """Mark the images that `lookup.shade` may read for the pixels that are hit, whichever texture it asks."""
    # depth (H, W) f32, +inf where nothing is hit; frames, spirals: see `lookup`
    # marks (H, D) bool, out: images with weight for the direction of some pixel of the row
    (rotations, origins, scales), (alphas, ks, limits, closings, image_ranges) = frames, spirals
    height, width = depth.shape
    textures = len(origins)
    for row in prange(height):
        indices, weights = np.empty(4, np.int64), np.empty(4)
        local, view = np.empty((textures, 3)), np.empty((textures, 3))
        marks[row] = False
        for column in range(width):
            if not depth[row, column] < np.inf:
                continue
            wx, wy, wz = pixel_ray(world_from_pixel, column + 0.5, row + 0.5)
            length = math.sqrt(wx * wx + wy * wy + wz * wz)
            for t in range(textures):
                into_rectangle(
                    0.0, 0.0, 0.0, -wx / length, -wy / length, -wz / length, rotations, origins, scales, t, local, view
                )
                if view[t, 2] <= 0.0:
                    continue
                neighbours(
                    view[t, 0], view[t, 1], view[t, 2], alphas, image_ranges[t], image_ranges[t + 1], ks[t], limits[t],
                    closings[t], indices, weights
                )  # fmt: skip
                for n in range(4):
                    if weights[n] > 0.0:
                        marks[row, indices[n]] = True
