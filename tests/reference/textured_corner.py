"""Photos of the inside of a textured corner of a room, with exact cameras: made to be calibrated, in a second."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

from ibrpipe.io.photos.images import write_png
from ibrpipe.types import Camera

#: length of a wall; the corner is the origin, the walls are the planes x = 0, y = 0, z = 0
SIDE = 2.0
WIDTH, HEIGHT = 320, 240


def texture(seed: int, size: int = 700) -> np.ndarray:
    """Noise of several scales, (size, size) float32 in 0..1."""
    random = np.random.default_rng(seed)
    total = np.zeros((size, size), np.float32)
    for cells in (12, 40, 120, 300):
        coarse = random.random((cells, cells), np.float32)
        total += cv2.resize(coarse, (size, size), interpolation=cv2.INTER_CUBIC)
    total -= total.min()
    return total / total.max()


def cameras(count: int, turn: float = 0.0) -> list[Camera]:
    """Cameras on an arc before the corner, looking into it."""
    found = []
    for step in np.linspace(-0.35, 0.35, count):
        angle = np.pi / 4 + step + turn
        eye = (4.2 * np.cos(angle), 4.2 * np.sin(angle), 2.2 + 1.2 * np.sin(5 * step))
        found.append(Camera.look_at(eye, (0.5, 0.5, 0.6), (0, 0, 1), 36.0, WIDTH, HEIGHT))
    return found


def photograph(camera: Camera, textures: Sequence[np.ndarray], rays: int = 2) -> tuple[np.ndarray, np.ndarray]:
    """Picture (H, W) in 0..1 and where a wall is seen (H, W) bool; `rays` x `rays` rays per pixel."""
    size = camera.resized(camera.width * rays, camera.height * rays)
    columns, rows = np.meshgrid(np.arange(size.width) + 0.5, np.arange(size.height) + 0.5)
    directions = np.stack([columns, rows, np.ones_like(columns)], axis=-1) @ size.world_from_pixel.T
    best = np.full(columns.shape, np.inf)
    picture = np.full(columns.shape, 0.5, np.float32)
    for axis in range(3):
        with np.errstate(divide="ignore", invalid="ignore"):
            depth = -size.center[axis] / directions[..., axis]
        place = size.center + depth[..., None] * directions
        u, v = (place[..., other] / SIDE for other in range(3) if other != axis)
        hit = (depth > 0) & (depth < best) & (u >= 0) & (u < 1) & (v >= 0) & (v < 1)
        scale = textures[axis].shape[0]
        x, y = ((np.where(hit, t, 0.0) * scale - 0.5).astype(np.float32) for t in (u, v))
        seen = cv2.remap(textures[axis], x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        picture[hit], best[hit] = seen[hit], depth[hit]
    small = picture.reshape(camera.height, rays, camera.width, rays).mean(axis=(1, 3))
    return small, np.isfinite(best)[::rays, ::rays]


def write_photos(
    folder: Path, shots: Sequence[Camera], textures: Sequence[np.ndarray] | None = None, masks: bool = False
) -> None:
    """Write images/000.png and so on, and masks/ if asked for."""
    walls = [texture(axis) for axis in range(3)] if textures is None else textures
    (folder / "images").mkdir(parents=True, exist_ok=True)
    for index, camera in enumerate(shots):
        picture, seen = photograph(camera, walls)
        write_png(folder / "images" / f"{index:03d}.png", picture)
        if masks:
            (folder / "masks").mkdir(exist_ok=True)
            write_png(folder / "masks" / f"{index:03d}.png", seen.astype(float))
