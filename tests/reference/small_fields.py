"""Small seeded height fields and layered images with holes, and cameras that see them from several sides."""

from __future__ import annotations

import numpy as np

from ibrpipe.types import Camera, DepthImage, LayeredDepthImage, ParallelFrame, ReliefTexture

FRAME = ParallelFrame((0, 0, 0), (1, 0, 0), (0, 1, 0.1), (0, 0, 1))
CAMERAS = {
    "front": Camera.look_at((2.13, 1.07, -9.1), (4.1, 3.03, 1), width=17, height=13),
    "low": Camera.look_at((-9.1, 2.13, -0.57), (4.1, 3.03, 1), width=17, height=13),
    "within": Camera.look_at((3.2, 2.9, 0.9), (6.1, 3.4, 1.0), fov_y_deg=80, width=17, height=13),
}


def relief(shape=(7, 9), holes=0.1, seed=3):
    """Height field with random heights and holes."""
    rng = np.random.default_rng(seed)
    height = rng.random(shape) * 2
    height[rng.random(shape) < holes] = np.nan
    return ReliefTexture(FRAME, rng.random((*shape, 3)), height)


def layers(shape=(6, 8), seed=2, frame=FRAME):
    """Return none to two samples a texel, some of them without a normal."""
    rng = np.random.default_rng(seed)
    counts = rng.integers(0, 3, shape)
    ends = np.cumsum(counts).reshape(shape)
    offsets = np.concatenate([np.r_[0, ends[:-1, -1]][:, None], ends], 1)
    depth = np.concatenate([np.sort(1 + 1.5 * rng.random(n)) for n in counts.ravel()] + [np.empty(0)])
    normal = rng.normal(size=(len(depth), 3)) * 0.3 - (frame.R[2] if isinstance(frame, Camera) else frame.f)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    normal[rng.random(len(depth)) < 0.3] = np.nan
    return LayeredDepthImage(frame, offsets, depth, rng.random((len(depth), 3)), normal)


def depth_image(seed=5):
    """Return a rough wall with two holes, seen by a camera."""
    rng = np.random.default_rng(seed)
    camera = Camera.look_at((3, 2, -9), (3, 3, 8), width=8, height=7)
    depth = 14 + rng.random((7, 8))
    depth[1, 1:3] = np.nan
    return DepthImage(camera, rng.random((7, 8, 3)), depth)


def empty_picture(camera):
    """Depth (h, w) float32 and ids (h, w) uint32 in which nothing is hit yet."""
    shape = (camera.height, camera.width)
    return np.full(shape, np.inf, np.float32), np.full(shape, 2**32 - 1, np.uint32)


def lies_between(depth, larger, smaller, tight=2e-6, flips=0.03):
    """Check that depths lie between the hits of slightly larger and of slightly smaller patches, at every pixel."""
    got, room = depth.astype(float), tight * np.where(np.isfinite(larger), larger, 0.0)
    assert np.isfinite(larger).sum() > 12
    assert np.mean(~np.isclose(larger, smaller, rtol=1e-5, atol=0)) <= flips
    assert (got >= larger - room).all()
    assert (got <= smaller + np.where(np.isfinite(smaller), tight * smaller, 0.0)).all()
