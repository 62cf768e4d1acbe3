"""Group 7: view-dependent colour at the pole, at the horizon and where yaw wraps, for k from 1/4 to 1/64.

The scene: a level plane just below its support rectangle, and one image of a single colour per spiral direction. The
colour that a direction of view must get then follows from the spiral alone: on the two turns around the direction, the
two samples around its yaw, each pair blended by distance along the spiral, the pairs by pitch (gong-yang, sec. 5.2).
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from ibrpipe.bench.cases.case import SpiralCase, camera_as, frame_of
from ibrpipe.core.spiral import directions
from ibrpipe.types import Array, Camera, LayeredDepthImage, SpiralResiduals, SpiralTexture

DENSITIES = (4, 8, 16, 24, 32, 64)
PLACES = {
    "pole": ("along the rectangle's normal", (0.0, 0.0)),
    "horizon": ("where the spiral's closing turn runs", (37.0, 86.5)),
    "past-horizon": ("beyond the closing turn, as far as textures are asked", (200.0, 88.0)),
    "yaw-0": ("around yaw 0 and 2 pi", (0.0, 50.0)),
    "first-turn": ("before the spiral has turned once", (250.0, 4.0)),
}
EDGE, DEPTH, BASE = 4.0, 0.02, 0.4
TURN = 2 * math.pi


def spiral_cases() -> Iterator[SpiralCase]:
    """Group 7."""
    for place, (what, toward) in PLACES.items():
        for n in DENSITIES:
            yield SpiralCase(f"spiral-{place}-k-1/{n}", 7, f"seen {what}", 1.0 / n, toward)
    yield SpiralCase("spiral-linear-residuals-with-a-zero", 7, "residuals in linear light, code of no residual 32",
                     1.0 / 8, (60.0, 40.0), zero=32)  # fmt: skip


def residual_of(direction: Array) -> Array:
    """(..., 3) residual colour of (..., 3) directions in the rectangle's frame: smooth, all channels different."""
    x, y, z = np.moveaxis(np.asarray(direction, np.float64), -1, 0)
    return np.stack([0.3 * x, 0.3 * y, 0.2 * z + 0.1 * x * y], axis=-1)


def build_spiral(k: float, zero: int = 0, dtype: str = "float64") -> SpiralTexture:
    """Return the plane with its residuals, 2 x 2 texels for every direction, made from arrays of `dtype`."""
    frame = frame_of((0, 0, 0), (EDGE / 8, 0, 0), (0, EDGE / 8, 0), (0, 0, 1), dtype)
    normal = np.tile([0.0, 0.0, -1.0], (64, 1))
    offsets = np.arange(9)[None] + 8 * np.arange(8)[:, None]
    layers = LayeredDepthImage(frame, offsets, np.full(64, DEPTH, dtype), np.full((64, 3), BASE, dtype), normal)
    alphas = directions.table(k)
    seen = directions.directions(alphas, k)
    count = len(alphas)
    texels = np.repeat(residual_of(seen).astype(np.float32), 4, axis=0)
    rectangle = frame_of((0, 0, 0), (EDGE, 0, 0), (0, EDGE, 0), (0, 0, 1), dtype)
    sizes, starts = np.full((count, 2), 2, np.int32), 4 * np.arange(count + 1)
    residuals = SpiralResiduals(rectangle, k, alphas, seen, sizes, starts, texels, np.ones(4 * count, bool), zero)
    return SpiralTexture(layers, residuals)


def spiral_camera(yaw: float, pitch: float, dtype: str = "float64") -> Camera:
    """Return the camera that sees the plane's middle from yaw and pitch in degrees, in the frame (a, b, -f)."""
    yaw, pitch = math.radians(yaw), math.radians(pitch)
    toward = np.array([math.sin(pitch) * math.cos(yaw), math.sin(pitch) * math.sin(yaw), -math.cos(pitch)])
    target = np.array([EDGE / 2, EDGE / 2, DEPTH])
    return camera_as(Camera.look_at(target + 2.0 * toward, target, (0.1, 0.2, -1.0), 0.8, 15, 13), dtype)


def expected(texture: SpiralTexture, camera: Camera) -> Array:
    """(H, W, 3) float64 exact colour, every turn and every pair of samples tried."""
    residuals = texture.residuals
    assert residuals is not None
    seen = -camera.pixel_rays()
    seen = (seen / np.linalg.norm(seen, axis=-1, keepdims=True) * (1, 1, -1)).reshape(-1, 3)
    values = residual_of(residuals.directions)
    found = np.stack([_blend(toward, residuals.alphas, residuals.k, values) for toward in seen])
    return (BASE + found).reshape(camera.height, camera.width, 3)


def _blend(toward: Array, alphas: Array, k: float, values: Array) -> Array:
    pitch = math.atan2(math.hypot(toward[0], toward[1]), toward[2])
    yaw = math.atan2(toward[1], toward[0]) % TURN
    turns = [yaw + TURN * t for t in range(math.ceil(0.25 / k) + 3)]
    below = [alpha for alpha in turns if k * alpha <= pitch]
    if below and k * below[0] <= pitch and any(k * alpha >= directions.LIMIT for alpha in below):
        first = next(alpha for alpha in below if k * alpha >= directions.LIMIT)
        return _along(first, alphas, k, values)
    above = turns[len(below)]
    low = k * below[-1] if below else 0.0
    inner = _along(below[-1], alphas, k, values) if below else values[0]
    high = min(k * above, directions.LIMIT)
    share = min(max((pitch - low) / (high - low), 0.0), 1.0) if high > low else 1.0
    return (1.0 - share) * inner + share * _along(above, alphas, k, values)


def _along(alpha: float, alphas: Array, k: float, values: Array) -> Array:
    """Blend the two samples around `alpha`; past the last turn's beginning its samples form a circle."""
    first = len(alphas) - directions.closing_count(k)
    if alpha >= alphas[first]:
        alpha = alphas[first] + (alpha - alphas[first]) % TURN
    for i in range(len(alphas)):
        start, other = alphas[i], i + 1
        end = alphas[other] if other < len(alphas) else alphas[first] + TURN
        if start <= alpha < end or (other == len(alphas) and alpha >= start):
            share = (alpha - start) / (end - start)
            return (1.0 - share) * values[i] + share * values[other if other < len(alphas) else first]
    return values[0]
