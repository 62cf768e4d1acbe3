"""Solids that nothing may be seen through: walls at a slant and a ball. For errors of coverage."""

from __future__ import annotations

import numpy as np

from ibrpipe.synthetic.instanced.pieces import painted_box, placed, turned
from ibrpipe.types import Instances, Mesh, PaintedMesh, Part, Scene


def solids() -> Scene:
    """Return four slanted walls and a ball as copies of two parts, about 10 wide; the root is called ``solids``."""
    wall = Part("wall", (painted_box((-2.0, -0.15, -2.0), (2.0, 0.15, 2.0), (0.6, 0.5, 0.4)),))
    ball = Part("ball", (painted_ball(1.0, (0.3, 0.4, 0.6)),))
    walls = np.stack(
        [
            placed((-3.0, 0.0, 0.0)),
            placed((3.0, 0.5, 0.0), turned((1, 0.3, 0.2), 0.7)),
            placed((0.0, 1.0, 3.0), turned((0, 0, 1), 0.6)),
            placed((0.0, -0.5, -3.0), turned((0.2, 1, 0.4), 1.1)),
        ]
    )
    balls = np.stack([placed((0.0, 0.0, 0.0), None, 1.2)])
    return Scene([wall, ball, Part("solids", children=(Instances("wall", walls), Instances("ball", balls)))], "solids")


def painted_ball(radius: float, color: tuple[float, float, float], rows: int = 24) -> PaintedMesh:
    """A closed ball of rows x 2 rows quads cut in two."""
    columns = 2 * rows
    polar, around = np.meshgrid(
        np.linspace(0, np.pi, rows + 1), np.arange(columns) * 2 * np.pi / columns, indexing="ij"
    )
    unit = np.stack([np.sin(polar) * np.cos(around), np.sin(polar) * np.sin(around), np.cos(polar)], axis=-1)
    number = np.arange((rows + 1) * columns).reshape(rows + 1, columns)
    a, b = number[:-1], np.roll(number[:-1], -1, axis=1)
    c, d = number[1:], np.roll(number[1:], -1, axis=1)
    faces = np.concatenate(
        [
            np.stack([a[1:], c[1:], b[1:]], axis=-1).reshape(-1, 3),
            np.stack([b[:-1], c[:-1], d[:-1]], axis=-1).reshape(-1, 3),
        ]
    )
    mesh = Mesh(radius * unit.reshape(-1, 3), faces)
    return PaintedMesh(mesh, np.tile(np.asarray(color, np.float32), (len(mesh.vertices), 1)))
