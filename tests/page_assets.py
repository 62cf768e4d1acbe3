"""Small assets in closed form for tests of pages: a painted ball before a wall, from two sides or from a point."""

from __future__ import annotations

import numpy as np

from ibrpipe.core.spiral import directions
from ibrpipe.types import (
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
    SpiralResiduals,
    Texture,
    ViewDependence,
)
from ibrpipe.types.layers import offsets_of

CELLS = 48
EDGE = 3.0


def paint(points: np.ndarray) -> np.ndarray:
    """(..., 3) linear colour of points: broad waves, all channels different."""
    x, y, z = np.moveaxis(points, -1, 0)
    return 0.45 + 0.3 * np.stack([np.sin(3 * x + y), np.sin(4 * y - z), np.cos(3 * z + 2 * x)], axis=-1)


def ball_layers(back: bool = False, wall: bool = True) -> LayeredDepthImage:
    """A unit ball, and a wall at z = -1.2 behind it or, from the back, before it, as layers along -z or z."""
    sign = 1.0 if back else -1.0
    step = EDGE / CELLS
    corner = np.array([-sign * EDGE / 2, -EDGE / 2, -sign * 2.0])
    frame = ParallelFrame(corner, (sign * step, 0, 0), (0, step, 0), (0, 0, sign))
    v, u = np.mgrid[:CELLS, :CELLS] + 0.5
    flat = frame.origin + u[..., None] * frame.a + v[..., None] * frame.b
    inside = np.hypot(flat[..., 0], flat[..., 1]) < 0.98
    height = np.sqrt(np.maximum(1 - flat[..., 0] ** 2 - flat[..., 1] ** 2, 0))
    ball = np.where(inside, 2.0 - height, np.nan)
    behind = np.full_like(ball, (3.2 if not back else 0.8) if wall else np.nan)
    return _join(frame, flat, (behind, ball) if back else (ball, behind), ball_first=not back)


def _join(frame, flat, depths, ball_first):
    counts = np.sum([np.isfinite(each) for each in depths], axis=0)
    order = np.stack(depths, axis=-1)
    there = np.isfinite(order)
    points = flat[:, :, None] + order[..., None] * frame.f
    normals = np.broadcast_to(-frame.f, points.shape).copy()
    rank = 0 if ball_first else 1
    normals[:, :, rank] = points[:, :, rank]  # of a unit ball
    return LayeredDepthImage(
        frame, offsets_of(counts), order[there], paint(points)[there], normals[there], np.ones(there.sum(), np.int32)
    )


def seen_from_a_point() -> LayeredDepthImage:
    """The ball alone from a camera at (3, 0.4, 0.6); every fifth texel's sample at the lower rim is unseen."""
    camera = Camera.look_at((3, 0.4, 0.6), (0, 0, 0), (0, 0, 1), 45, 56, 52)
    rays, eye = camera.pixel_rays(), camera.center
    a, b, c = (rays**2).sum(-1), rays @ eye, eye @ eye - 1
    square = b * b - a * c
    depth = np.where(square > 0, (-b - np.sqrt(np.maximum(square, 0))) / a, np.nan)
    there = np.isfinite(depth)
    points = (eye + depth[..., None] * rays)[there]
    observers = np.where((np.arange(len(points)) % 5 == 0) & (points[:, 2] < -0.5), 0, 3).astype(np.int32)
    return LayeredDepthImage(camera, offsets_of(there.astype(int)), depth[there], paint(points), points, observers)


def spiral_of(layers: LayeredDepthImage, k: float = 1 / 6) -> SpiralResiduals:
    """Residual images of smooth random texels, with a hole each."""
    frame = layers.frame
    rectangle = ParallelFrame(frame.origin, CELLS * frame.a, CELLS * frame.b, frame.f)
    alphas = directions.table(k)
    seen, rng = directions.directions(alphas, k), np.random.default_rng(4)
    sizes = np.array([(20 + n % 5, 26 - n % 7) for n in range(len(alphas))], np.int32)
    starts = np.concatenate([[0], np.cumsum(sizes.prod(axis=1))])
    texels, valid = [], []
    for (height, width), toward in zip(sizes, seen, strict=True):
        y, x = np.mgrid[:height, :width] / 20.0
        wave = np.stack([np.sin(4 * x + 3 * toward[0]), np.cos(3 * y + 2 * toward[1]), np.sin(x - y + toward[2])], -1)
        texels.append(np.clip(np.round(60 + 35 * wave + rng.normal(0, 1, wave.shape)), 0, 255).reshape(-1, 3))
        valid.append((np.hypot(x - 0.5, y - 0.4) > 0.15).ravel())
    return SpiralResiduals(
        rectangle, k, alphas, seen, sizes, starts, np.concatenate(texels).astype(np.uint8), np.concatenate(valid), 60
    )


def light_of() -> ReflectedLight:
    """Two tables of smooth light."""
    rng = np.random.default_rng(8)
    tables = np.stack([np.kron(rng.uniform(0.1, 0.9, (2, 4, 4, 3))[n], np.ones((4, 4, 1))) for n in range(2)])
    for _ in range(3):
        tables = (tables + np.roll(tables, 1, 1) + np.roll(tables, 1, 2)) / 3
    return ReflectedLight(tables, (0.045, 0.9))


def kept_photos() -> KeptPhotos:
    """Smooth pictures from all round, no two alike, with a hole each."""
    photos = []
    for n in range(9):
        eye = 3.2 * np.array([np.sin(0.7 * n), 0.8 * np.cos(1.9 * n), np.cos(0.7 * n)])
        camera = Camera.look_at(eye, (0, 0, 0), (0, 1, 0), 55, 120 + n, 110)
        y, x = np.mgrid[:110, : 120 + n] / 110
        waves = np.stack([np.sin(6 * x + n), np.cos(5 * y + 2 * n), np.sin(4 * (x - y) - n)], axis=-1)
        codes = np.round(128 + 80 * waves).astype(np.uint8)
        photos.append(KeptPhoto(camera, codes, np.hypot(x - 0.3, y - 0.6) > 0.1))
    return KeptPhotos(tuple(photos), 1.2, Blend(4, 0.75, 0.5))


def make_asset(kind: str) -> Asset:
    """Asset of a kind: matt, perspective, spiral, gloss (mirrors tables alone), mirror (and the wall),
    photos.
    """
    front, back = (ball_layers(back, wall=kind != "gloss") for back in (False, True))
    if kind == "perspective":
        return Asset((Texture(seen_from_a_point()), Texture(back)))
    parts: list[tuple[ViewDependence, ...]] = [(), ()]
    if kind == "photos":
        parts = [(PhotoBlend(kept_photos()),)] * 2
    if kind == "spiral":
        parts = [(spiral_of(front),), (spiral_of(back),)]
    if kind in ("gloss", "mirror"):
        light, rng = light_of(), np.random.default_rng(1)
        parts = [(Reflection(light, rng.uniform(0.3, 0.7, (len(each.depth), 2))),) for each in (front, back)]
    return Asset((Texture(front, parts[0]), Texture(back, parts[1])), {"units": "metre"})
