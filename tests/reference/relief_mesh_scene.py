"""Small relief-mapped meshes, and what the kernels take of them."""

from __future__ import annotations

import numpy as np

from ibrpipe import Camera, ReliefMesh
from ibrpipe.renderers.relief.meshes import MeshPart, build_mesh
from ibrpipe.renderers.relief.options import ReliefOptions
from ibrpipe.types import Mesh

QUAD = Mesh(np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], float), np.array([[0, 1, 2], [0, 2, 3]]))
QUAD_UV = np.array([[[0, 1], [1, 1], [1, 0]], [[0, 1], [1, 0], [0, 0]]], float)


def bent_sheet(n=3, repeat=2.0):
    """Mesh of 2 n^2 faces that share vertices, and its texture coordinates."""
    y, x = np.mgrid[: n + 1, : n + 1] / n
    places = np.stack([2 * x - 1, 2 * y - 1, 0.5 - (x - 0.5) ** 2 - 0.7 * (y - 0.5) ** 2], -1).reshape(-1, 3)
    i = (np.arange(n)[:, None] * (n + 1) + np.arange(n)).ravel()
    faces = np.concatenate([np.stack([i, i + 1, i + n + 2], 1), np.stack([i, i + n + 2, i + n + 1], 1)])
    return Mesh(places, faces), repeat * np.stack([x, 1 - y], -1).reshape(-1, 2)[faces]


def rough(shape, seed=3):
    return np.random.default_rng(seed).random(shape).astype(np.float32)


def camera(eye=(0.8, -1.5, 1.1), size=(15, 12)):
    return Camera.look_at(eye, (0, 0, -0.1), width=size[0], height=size[1], fov_y_deg=50.0)


def parts(source: ReliefMesh, view: Camera, **options) -> tuple[MeshPart, np.ndarray, np.ndarray]:
    """The mesh as prepared, its vertices counted from the eye, and the rule."""
    part = build_mesh(source)
    return part, part.local_vertices(view.center), part.rule(ReliefOptions(**options))


def buffers(view: Camera):
    """(depth, mine, places, turns) as the searching kernels take them."""
    size = view.height, view.width
    return (
        np.full(size, np.inf, np.float32), np.zeros(size, np.uint8), np.full((*size, 3), np.nan),
        np.full((*size, 9), np.nan, np.float32),
    )  # fmt: skip
