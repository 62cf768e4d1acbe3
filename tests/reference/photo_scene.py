"""Small random photo sets around the origin for tests of the photo kernels: holes, masks, steps in depth."""

from __future__ import annotations

import numpy as np
from photo_twin import Photo

from ibrpipe.types import Camera


def random_photos(count, seed, width=13, height=10):
    """Photos of the plane z = 0 from above, with depth steps, misses and masks; sizes differ."""
    rng = np.random.default_rng(seed)
    photos = []
    for i in range(count):
        eye = np.append(rng.uniform(-2, 2, 2), rng.uniform(2, 4))
        camera = Camera.look_at(
            eye, rng.uniform(-0.3, 0.3, 3), up=(0, 1, 0), fov_y_deg=45, width=width + i % 3, height=height - i % 2
        )
        depth = plane_depth(camera)
        kind = rng.random(depth.shape)
        depth[kind < 0.08] = np.inf
        depth[(kind >= 0.08) & (kind < 0.2)] -= 1.0
        mask = rng.choice([0.0, 0.7, 1.0], depth.shape, p=[0.05, 0.05, 0.9]).astype(np.float32)
        photos.append(Photo(camera, rng.random((*depth.shape, 3)).astype(np.float32), depth, mask))
    return photos


def constant_photos(colors, eyes=None):
    """Photos of one colour each (P, 3) of the plane z = 0, nothing hidden."""
    photos = []
    for i, color in enumerate(np.asarray(colors, np.float32)):
        angle = 2 * np.pi * i / len(colors)
        eye = (np.cos(angle), np.sin(angle), 3.0) if eyes is None else eyes[i]
        camera = Camera.look_at(eye, (0, 0, 0), up=(0, 1, 0), fov_y_deg=45, width=9, height=8)
        depth = plane_depth(camera)
        photos.append(Photo(camera, np.tile(color, (*depth.shape, 1)), depth, np.ones_like(depth)))
    return photos


def plane_depth(camera):
    """(H, W) float32 depth of z = 0 along camera z."""
    x, y = np.meshgrid(np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5)
    ways = np.stack([x, y, np.ones_like(x)], -1) @ camera.world_from_pixel.T
    return (-camera.center[2] / ways[..., 2]).astype(np.float32)


def random_points(count, seed, spread=1.2):
    """Points on and off the plane with normals that mostly face up."""
    rng = np.random.default_rng(seed)
    points = np.stack([*rng.uniform(-spread, spread, (2, count)), np.where(rng.random(count) < 0.8, 0.0, 1.0)], 1)
    normals = rng.normal((0, 0, 1.5), 0.7, (count, 3))
    return points, (normals / np.linalg.norm(normals, axis=1, keepdims=True)).astype(np.float32)
