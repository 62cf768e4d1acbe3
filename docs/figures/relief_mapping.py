"""Pictures of the page on relief mapping: python docs/figures/relief_mapping.py TEAPOT OBJECT ROCK; in docs/images.

TEAPOT, OBJECT: mesh files (a teapot, something closed); ROCK: a folder with height.*, color.* and normal_gl.*.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

import ibrpipe
from ibrpipe.io.photos.images import write_png
from ibrpipe.io.surfaces.meshes import read_mesh
from ibrpipe.modelling.dual_relief import dual_relief_from_mesh
from ibrpipe.types import Array, Camera, Mesh, ParallelFrame, ReliefTexture

IMAGES = Path(__file__).resolve().parent.parent / "images"
GROUND = 0.9
QUAD = Mesh(np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], float), np.array([[0, 1, 2], [0, 2, 3]]))
QUAD_UV = np.array([[[0, 1], [1, 1], [1, 0]], [[0, 1], [1, 0], [0, 0]]], float)


def picture(source: object, camera: Camera, **options: object) -> Array:
    """A frame on a light ground, twice as fine and averaged."""
    frame = ibrpipe.render(source, camera.resized(2 * camera.width, 2 * camera.height), "relief", **options)
    color = np.where(frame.alpha[..., None] > 0, frame.color, GROUND)
    return color.reshape(camera.height, 2, camera.width, 2, 3).mean(axis=(1, 3))


def write(name: str, rows: list[list[Array]]) -> None:
    """Write a grid of pictures."""
    write_png(IMAGES / name, np.concatenate([np.concatenate(row, axis=1) for row in rows], axis=0))


def around(mesh: Mesh) -> tuple[Array, float]:
    """Middle and diagonal of a mesh."""
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    return 0.5 * (low + high), float(np.linalg.norm(high - low))


def studs(size: int = 256, count: int = 4) -> tuple[Array, Array]:
    """Heights of rows of ball-shaped studs and blocks on a plate, and their colours: smooth and sharp features."""
    y, x = (np.indices((size, size)) + 0.5) * count / size
    number = np.floor(x) + np.floor(y)
    r = np.hypot(x % 1 - 0.5, y % 1 - 0.5) / 0.36
    ball = np.sqrt(np.clip(1 - r**2, 0, 1))
    block = ((np.abs(x % 1 - 0.5) < 0.27) & (np.abs(y % 1 - 0.5) < 0.27)).astype(float) * 0.85
    even = number % 2 == 0
    height = np.where(even, ball, block)
    grain = 1 + 0.12 * np.sin(30 * x + 3 * np.sin(4 * y))
    color = np.where((height > 0.02)[..., None], np.where(even[..., None], (0.7, 0.3, 0.12), (0.2, 0.36, 0.55)),
                     (0.5, 0.45, 0.36)) * grain[..., None]  # fmt: skip
    return height, color


def quad(height: Array, color: Array, thickness: float, repeat: float = 1.0) -> ibrpipe.ReliefMesh:
    """A relief on one square."""
    return ibrpipe.ReliefMesh(QUAD, QUAD_UV * repeat, height, thickness, color=color, edges="cut")


def baselines() -> None:
    """Fig. 19: one polygon, plain, bump, parallax, relief with shadows."""
    source = quad(*studs(), 0.32)
    view = Camera.look_at((1.1, -1.9, 1.35), (0.03, 0.02, -0.18), fov_y_deg=52, width=300, height=200)
    look = {"light": (1.8, 0.9, 1.6), "specular": 0.1}
    maps = [picture(source, view, mapping=name, **look) for name in ("plain", "bump", "parallax", "relief")]
    write("relief-baselines.png", [maps[:2], maps[2:]])


def teapots(teapot: Path, rock: Path) -> None:
    """Figs. 1, 14: teapot with self-shadows, its bare texture, and with a carved silhouette."""
    source = ibrpipe.read_relief_mesh(teapot, rock, uv="cylinder", repeat=(3, 3))
    middle, size = around(source.mesh)
    source = replace(source, thickness=0.028 * size)
    prepared = ibrpipe.prepare(source, "relief")
    look = {"light": tuple(middle + size * np.array([1.6, 1.5, 0.9])), "specular": 0.1, "ambient": 0.3, "diffuse": 1.4}
    view = Camera.look_at(middle + size * np.array([0.5, 0.55, 1.1]), middle, (0, 1, 0), 29, 320, 210)
    spot = middle + size * np.array([-0.2, -0.1, 0])
    close = Camera.look_at(spot + size * np.array([0.1, 0.3, 0.75]), spot, (0, 1, 0), 24, 320, 210)
    far = [picture(prepared, view, mapping="plain", **look), picture(prepared, view, **look)]
    look["light"] = tuple(middle + size * np.array([-1.5, 1.6, 1.2]))
    write(
        "relief-teapot.png",
        [
            far,
            [picture(prepared, close, **look), picture(prepared, close, model="shell", **look)],
        ],
    )


def dual(mesh: Path) -> None:
    """Fig. 13: one square with single and with dual depth."""
    source = dual_relief_from_mesh(read_mesh(mesh), "+z", 384)
    rows, columns = source.height.shape
    y, x = np.indices((rows, columns)) / columns
    rings = 0.5 + 0.5 * np.sin(90 * np.hypot(x - 0.3, 0.35 * y) + 4 * np.sin(9 * y))
    wood = np.array([0.45, 0.22, 0.09]) * (0.75 + 0.35 * rings[..., None])
    source = replace(source, color=wood)
    single = replace(source, back=None)
    middle, size = around(source.mesh)
    middle = middle - (0, 0, 0.5 * source.thickness)
    look = {"light": tuple(middle + size * np.array([1.0, 1.5, 2.0])), "specular": 0.12, "diffuse": 0.9}
    ways = (((0.0, 0.1, 1.0), "flat"), ((0.33, 0.1, 1.0), "flat"), ((-0.8, 0.3, 0.65), "shell"))
    table = []
    for part in (single, source):
        shots = []
        for way, model in ways:
            eye = middle + 1.6 * size * np.array(way) / np.linalg.norm(way)
            camera = Camera.look_at(eye, middle, (0, 1, 0), 34, 200, 180)
            shots.append(picture(part, camera, model=model, shadows=False, **look))
        table.append(shots)
    write("relief-dual.png", table)


def interpenetration(rock: Path) -> None:
    """Fig. 18: balls, rendered as another source, stuck in a relief-mapped surface."""
    from ibrpipe.io.surfaces.relief_images import read_relief_folder

    images = read_relief_folder(rock)
    ground = ibrpipe.ReliefMesh(QUAD, QUAD_UV, images.height, 0.16, color=images.color, normal=images.normal)
    balls = [ball((-0.45, -0.3, -0.1), (0.7, 0.2, 0.1)), ball((0.3, 0.25, -0.1), (0.15, 0.35, 0.7)),
             ball((0.2, -0.5, -0.12), (0.75, 0.6, 0.15))]  # fmt: skip
    view = Camera.look_at((0.9, -1.7, 1.25), (0, 0, -0.1), fov_y_deg=40, width=480, height=320)
    fine = view.resized(960, 640)
    frame = ibrpipe.composite(
        [
            ibrpipe.render(ground, fine, "relief", light=(2, 1.5, 2.0), specular=0.05, diffuse=1.2),
            ibrpipe.render(balls, fine, "relief"),
        ]
    )
    color = np.where(frame.alpha[..., None] > 0, frame.color, GROUND)
    write("relief-interpenetration.png", [[color.reshape(320, 2, 480, 2, 3).mean(axis=(1, 3))]])


def ball(middle: tuple[float, float, float], tint: tuple[float, float, float], radius: float = 0.22) -> ReliefTexture:
    """The upper half of a ball as a relief texture with its shade painted on."""
    count = 161
    y, x = (np.indices((count, count)) + 0.5) / count * 2 - 1
    rise = np.sqrt(np.clip(1 - x**2 - y**2, 0, None))
    light = np.array([0.6, 0.5, 0.62])
    shade = 0.3 + 0.7 * np.clip(x * light[0] + y * light[1] + rise * light[2], 0, 1)
    height = np.where(x**2 + y**2 < 0.99, radius * rise, np.nan)
    step = 2 * radius / count
    corner = np.array(middle) - (radius, radius, 0)
    return ReliefTexture(
        ParallelFrame(corner, np.array([step, 0, 0]), np.array([0, step, 0]), np.array([0, 0, 1.0])),
        np.array(tint) * shade[..., None],
        height,
    )


def main() -> None:
    """Make all pictures."""
    IMAGES.mkdir(exist_ok=True)
    baselines()
    if len(sys.argv) < 4:
        return
    teapot, mesh, rock = (Path(word) for word in sys.argv[1:4])
    teapots(teapot, rock)
    dual(mesh)
    interpenetration(rock)


if __name__ == "__main__":
    main()
