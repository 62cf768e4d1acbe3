"""Pictures of the pages on relief textures: python docs/figures/relief.py [MESH.ply]; written to docs/images.

The brick wall and the interpenetration are made from numbers alone; the six-face object needs a mesh file.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

import ibrpipe
from ibrpipe.io.photos.images import write_png
from ibrpipe.io.surfaces.meshes import read_mesh
from ibrpipe.modelling.relief_textures import SIDES, asset_from_reliefs, box_from_mesh, relief_from_images
from ibrpipe.types import Array, Camera, ReliefTexture

IMAGES = Path(__file__).resolve().parent.parent / "images"
GROUND = 0.9


def brick_wall(rows: int = 384, columns: int = 512) -> ReliefTexture:
    """A wall 2 x 1.5 of bricks that stand 0.05 out of the mortar, their edges rounded."""
    rng = np.random.default_rng(4)
    v, u = (np.indices((rows, columns)) + 0.5) / rows
    course = np.floor(v * 9).astype(int)
    across = u * 4.5 + 0.5 * (course % 2)
    number = np.floor(across).astype(int)
    edge = np.minimum(np.minimum(across % 1, 1 - across % 1) / 4.5, np.minimum(v * 9 % 1, 1 - v * 9 % 1) / 9)
    height = 0.05 * np.clip((edge - 0.006) / 0.012, 0, 1) ** 0.5
    tint = rng.uniform(0.6, 1.25, (16, 16))[course % 16, number % 16]
    grain = 1 + 0.08 * rng.standard_normal((rows, columns))
    brick = np.array([0.36, 0.09, 0.05]) * (tint * grain)[..., None]
    mortar = np.array([0.42, 0.40, 0.36]) * grain[..., None]
    color = np.where((height > 0.012)[..., None], brick, mortar)
    slope = np.stack(np.gradient(height, 1.5 / rows), -1)
    shade = np.clip(1.0 - 0.9 * slope[..., 0] + 0.5 * slope[..., 1], 0.35, 1.6) / np.sqrt(1 + 0.3 * (slope**2).sum(-1))
    return relief_from_images(height, np.clip(color * shade[..., None], 0, 1), (2.0, 1.5))


def waves(phase: float, tint: tuple[float, float, float], tilt: float) -> ReliefTexture:
    """A wavy sheet, tilted round x."""
    y, x = np.mgrid[:256, :256] / 256
    height = 0.1 * np.sin(14 * x + phase) * np.cos(11 * y)
    checks = 0.75 + 0.25 * (((np.floor(10 * x) + np.floor(10 * y)) % 2) - 0.5)
    relief = relief_from_images(height, np.array(tint) * (checks + 2.5 * height)[..., None], (2.0, 2.0))
    turn = np.array([[1, 0, 0], [0, np.cos(tilt), -np.sin(tilt)], [0, np.sin(tilt), np.cos(tilt)]])
    frame = ibrpipe.ParallelFrame(*(turn @ each for each in (relief.frame.origin, relief.frame.a, relief.frame.b,
                                                             relief.frame.f)))  # fmt: skip
    return ReliefTexture(frame, relief.color, relief.height)


def picture(source: object, camera: Camera, renderer: str = "prewarp", **options: object) -> Array:
    """A frame on a light ground, twice as fine and averaged."""
    fine = camera.resized(2 * camera.width, 2 * camera.height)
    frame = ibrpipe.render(source, fine, renderer, **options)
    color = np.where(frame.alpha[..., None] > 0, frame.color, GROUND)
    return color.reshape(camera.height, 2, camera.width, 2, 3).mean(axis=(1, 3))


def write(name: str, rows: list[list[Array]]) -> None:
    """Write a grid of pictures."""
    write_png(IMAGES / name, np.concatenate([np.concatenate(row, axis=1) for row in rows], axis=0))


def grain() -> list[list[Array]]:
    """Fine stripes on waves, from a low eye: at pixel centres, averaged by area, truth (36 rays a pixel)."""
    y, x = np.mgrid[:256, :256] / 256
    height = 0.08 + 0.06 * np.sin(14 * x + 1) * np.cos(12 * y)
    stripes = np.sign(np.sin(300 * x))[..., None] * np.sign(np.sin(200 * y))[..., None]
    p = 1 / 256
    frame = ibrpipe.ParallelFrame((0, 0, 0), (p, 0, 0), (0, p, 0), (0, 0, 1))
    source = ReliefTexture(frame, 0.5 + 0.35 * stripes * np.array([1, 0.8, 0.6]), height)
    view = Camera.look_at((0.3, -0.9, 0.75), (0.5, 0.42, 0.05), (0, 0, 1), 34.0, 260, 150)
    shots = []
    for options in ({}, {"filter": "area"}):
        frame_seen = ibrpipe.render(source, view, "prewarp", level=0, **options)
        shots.append(np.where(frame_seen.alpha[..., None] > 0, frame_seen.color, GROUND))
    fine = ibrpipe.render(source, view.resized(6 * view.width, 6 * view.height), "ldi")
    truth = np.where(fine.alpha[..., None] > 0, fine.color, GROUND)
    return [[*shots, truth.reshape(view.height, 6, view.width, 6, 3).mean(axis=(1, 3))]]


def blocks() -> list[list[Array]]:
    """Blocks on waves seen from close above: two-pass, pipelined, exact."""
    y, x = np.mgrid[:384, :384] / 384
    height = 0.03 + 0.02 * np.sin(21 * x) * np.cos(17 * y)
    for u, v, size in ((0.55, 0.62, 0.07), (0.72, 0.42, 0.05), (0.35, 0.5, 0.04)):
        height = np.where((np.abs(x - u) < size) & (np.abs(y - v) < size), 0.16, height)
    checks = 0.8 + 0.3 * (((np.floor(24 * x) + np.floor(24 * y)) % 2) - 0.5)
    color = np.stack([0.25 + 3 * height, 0.4 - height, 0.6 - 3 * height], -1).clip(0, 1) * checks[..., None]
    source = relief_from_images(height, color, (1.0, 1.0))
    view = Camera.look_at((0.02, -0.33, 0.24), (0.09, 0.05, 0.03), (0, 0, 1), 60.0, 250, 190)
    shots = [picture(source, view, method=name, level=0, fallback="never") for name in ("two-pass", "pipelined")]
    return [[*shots, picture(source, view, "ldi")]]


def main() -> None:
    """Make all pictures."""
    IMAGES.mkdir(exist_ok=True)
    wall = brick_wall()
    views = [
        Camera.look_at(eye, (0, 0, 0), (0, 1, 0), 46.0, 240, 190)
        for eye in ((0.0, 0.1, 2.2), (1.6, 0.3, 1.4), (-2.0, -0.5, 0.55))
    ]
    write("prewarp-brick.png", [[picture(wall, view, method="pipelined", level=0) for view in views]])
    sheets = [waves(0.0, (0.75, 0.35, 0.2), 0.35), waves(1.5, (0.2, 0.4, 0.75), -0.35)]
    view = Camera.look_at((1.3, -1.6, 2.3), (0, 0, 0), (0, 0, 1), 40.0, 260, 220)
    pairs = [picture(sheets, view, method="pipelined"), picture(sheets, view, "ldi")]
    write("prewarp-interpenetration.png", [pairs])
    write("prewarp-area.png", grain())
    write("prewarp-fold-overs.png", blocks())
    if len(sys.argv) > 1:
        box(Path(sys.argv[1]))


def box(path: Path) -> None:
    """A mesh as six relief textures, from regions with one, two and three faces toward the eye."""
    mesh = read_mesh(path)
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    middle, size = 0.5 * (low + high), float(np.linalg.norm(high - low))
    prepared = ibrpipe.prepare(asset_from_reliefs(box_from_mesh(mesh, 384), list(SIDES), path.name), "prewarp")
    ways = [(0, 0, 1), (1, 0, 0.02), (0, 1, 0.3), (1, 0, 1), (-1, 0.7, 0), (1, 0.6, 1), (-1, 0.7, -1), (1, -0.6, -1)]
    shots = []
    for way in ways:
        eye = middle + 1.45 * size * np.array(way) / np.linalg.norm(way)
        camera = Camera.look_at(eye, middle, (0, 1, 0.001), 38.0, 150, 150)
        shots.append(picture(prepared, camera, level=0, method="pipelined"))
    write("prewarp-box.png", [shots[:4], shots[4:]])


if __name__ == "__main__":
    main()
