"""Small meshes and matrices that the generated scenes are put together from."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from ibrpipe.types import Array, Mesh, PaintedMesh


def turned(axis: ArrayLike, angle: float) -> Array:
    """Rotation (3, 3) about an axis, radians, counter-clockwise seen from its tip."""
    x, y, z = np.asarray(axis, np.float64) / np.linalg.norm(axis)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + math.sin(angle) * cross + (1 - math.cos(angle)) * cross @ cross


def placed(at: ArrayLike, rotation: Array | None = None, scale: float | Array = 1.0) -> Array:
    """Affine matrix (4, 4): scale, then rotate, then move to `at`."""
    matrix = np.eye(4)
    matrix[:3, :3] = (np.eye(3) if rotation is None else rotation) * scale
    matrix[:3, 3] = at
    return matrix


def moved(matrix: Array, painted: PaintedMesh) -> PaintedMesh:
    """A mesh under a (4, 4) affine matrix that does not mirror."""
    vertices = painted.mesh.vertices @ matrix[:3, :3].T + matrix[:3, 3]
    return PaintedMesh(Mesh(vertices, painted.mesh.faces), painted.color, painted.specular, painted.shininess)


def joined(pieces: Sequence[PaintedMesh]) -> PaintedMesh:
    """Several meshes of one material as one."""
    starts = np.cumsum([0, *(len(each.mesh.vertices) for each in pieces)])
    faces = [each.mesh.faces + start for each, start in zip(pieces, starts)]
    mesh = Mesh(np.concatenate([each.mesh.vertices for each in pieces]), np.concatenate(faces))
    color = np.concatenate([each.color for each in pieces])
    return PaintedMesh(mesh, color, pieces[0].specular, pieces[0].shininess)


def tapered_stem(
    length: float, radii: tuple[float, float], sides: int, color: ArrayLike, bend: float, rng: np.random.Generator
) -> PaintedMesh:
    """An open cone along z from the origin, bent towards x; every vertex a little lighter or darker."""
    angles = 2 * math.pi * np.arange(sides) / sides
    ring = np.stack([np.cos(angles), np.sin(angles), np.zeros(sides)], axis=1)
    vertices = np.concatenate([radii[0] * ring, radii[1] * ring + (bend, 0.0, length)])
    here, after = np.arange(sides), (np.arange(sides) + 1) % sides
    faces = np.concatenate(
        [np.stack([here, after, sides + after], axis=1), np.stack([here, sides + after, sides + here], axis=1)]
    )
    shade = rng.uniform(0.8, 1.2, (len(vertices), 1))
    return PaintedMesh(Mesh(vertices, faces), (np.asarray(color) * shade).astype(np.float32))


def folded_leaf(length: float, width: float, color: ArrayLike, rng: np.random.Generator) -> PaintedMesh:
    """Two triangles along z, folded at the rib."""
    side = np.array([width / 2, 0.18 * width, 0.45 * length])
    tip = (0.0, 0.03 * length, length)
    vertices = np.array([(0.0, 0.0, 0.0), side, tip, side * (-1, 1, 1)])
    shade = rng.uniform(0.75, 1.25) * np.array([[0.8], [1.15], [1.0], [1.15]])
    return PaintedMesh(Mesh(vertices, np.array([[0, 1, 2], [0, 2, 3]])), (np.asarray(color) * shade).astype(np.float32))


def painted_box(low: Sequence[float], high: Sequence[float], color: ArrayLike) -> PaintedMesh:
    """A box of twelve triangles, counter-clockwise from outside, in one colour."""
    corners = np.stack(np.meshgrid(*zip(low, high), indexing="ij"), axis=-1).reshape(8, 3)
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = np.array([face for a, b, c, d in quads for face in ((a, b, c), (a, c, d))])
    return PaintedMesh(Mesh(corners, faces), np.tile(np.asarray(color, np.float32), (8, 1)))


def painted_ground(half: float, color: ArrayLike, height: float = 0.0) -> PaintedMesh:
    """A square of two triangles facing up, 2 `half` wide."""
    vertices = np.array([(-half, -half, height), (half, -half, height), (half, half, height), (-half, half, height)])
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    return PaintedMesh(Mesh(vertices, faces), np.tile(np.asarray(color, np.float32), (4, 1)))
