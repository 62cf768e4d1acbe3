"""Parametric surfaces turned into welded triangle meshes with the normals of the smooth surface.

Every mesh is counter-clockwise seen from outside. Normals are those of the closed form (central differences of the
parametric function in float64, wrong by less than 1e-9), not those of the triangles.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from ibrpipe.types import Array, Mesh

#: step of the central differences, in units of the surface parameters
_STEP = 1e-5

#: how faces are wound: counter-clockwise seen from outside, or not
Winding = Literal["consistent", "inverted", "mixed"]

#: maps parameters u, v (any shape) to points (..., 3)
Surface = Callable[[Array, Array], Array]


@dataclass(frozen=True, eq=False)
class SmoothMesh:
    """Triangles and the unit normals of the smooth surface at their vertices.

    Attributes
    ----------
    mesh : Mesh
    normals : (V, 3) float64, unit, pointing outwards
    """

    mesh: Mesh
    normals: Array


def _normals(surface: Surface, u: Array, v: Array) -> Array:
    """Normalised cross product of the partial derivatives, (..., 3)."""
    along_u = surface(u + _STEP, v) - surface(u - _STEP, v)
    along_v = surface(u, v + _STEP) - surface(u, v - _STEP)
    normals = np.cross(along_u, along_v)
    return normals / np.linalg.norm(normals, axis=-1, keepdims=True)


def _grid_faces(rows: Array) -> Array:
    """Triangles of a grid of vertex indices (R, C); counter-clockwise where u (columns) x v (rows) points outwards."""
    a, b = rows[:-1, :-1].ravel(), rows[:-1, 1:].ravel()
    c, d = rows[1:, 1:].ravel(), rows[1:, :-1].ravel()
    return np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])


def sheet(surface: Surface, columns: int, rows: int) -> SmoothMesh:
    """Mesh an open surface over parameters u, v in [-1, 1] with `columns` x `rows` cells."""
    u, v = np.meshgrid(np.linspace(-1, 1, columns + 1), np.linspace(-1, 1, rows + 1))
    indices = np.arange(u.size).reshape(u.shape)
    vertices, normals = surface(u, v).reshape(-1, 3), _normals(surface, u, v).reshape(-1, 3)
    return SmoothMesh(Mesh(vertices, _grid_faces(indices)), normals)


def tube(surface: Surface, columns: int, rows: int) -> SmoothMesh:
    """Mesh a surface that closes in both parameters (a torus); u and v run over [0, 2 pi)."""
    u, v = np.meshgrid(np.arange(columns) * (2 * np.pi / columns), np.arange(rows) * (2 * np.pi / rows))
    indices = np.pad(np.arange(u.size).reshape(u.shape), ((0, 1), (0, 1)), mode="wrap")
    vertices, normals = surface(u, v).reshape(-1, 3), _normals(surface, u, v).reshape(-1, 3)
    return SmoothMesh(Mesh(vertices, _grid_faces(indices)), normals)


def ball(surface: Surface, columns: int, rows: int) -> SmoothMesh:
    """Mesh a sphere-like surface: u is the azimuth in [0, 2 pi), v the latitude in [-pi/2, pi/2].

    The poles are single vertices whose normals are the z axis; the surface must be symmetric about it there.
    """
    azimuth = np.arange(columns) * (2 * np.pi / columns)
    latitude = np.linspace(-np.pi / 2, np.pi / 2, rows + 1)
    u, v = np.meshgrid(azimuth, latitude[1:-1])
    indices = np.pad(1 + np.arange(u.size).reshape(u.shape), ((0, 0), (0, 1)), mode="wrap")
    poles = surface(np.zeros(2), latitude[[0, -1]])
    vertices = np.concatenate([poles[:1], surface(u, v).reshape(-1, 3), poles[1:]])
    axis = np.array([[0.0, 0.0, 1.0]])
    normals = np.concatenate([-axis, _normals(surface, u, v).reshape(-1, 3), axis])
    south = np.stack([np.zeros(columns, int), indices[0, 1:], indices[0, :-1]], axis=1)
    north = np.stack([np.full(columns, len(vertices) - 1), indices[-1, :-1], indices[-1, 1:]], axis=1)
    return SmoothMesh(Mesh(vertices, np.concatenate([south, _grid_faces(indices), north])), normals)


def wound(mesh: Mesh, winding: Winding, random: np.random.Generator) -> Mesh:
    """Return a mesh whose faces are as they are, all reversed, or each reversed by chance."""
    if winding == "consistent":
        return mesh
    turned = np.ones(len(mesh.faces), bool) if winding == "inverted" else random.random(len(mesh.faces)) < 0.5
    return Mesh(mesh.vertices, np.where(turned[:, None], mesh.faces[:, ::-1], mesh.faces))


def lobed_ball(radius: float, lobes: int, depth: float, squash: float) -> Surface:
    """Return a sphere with `lobes` grooves of relative `depth` that fade to the poles, its height times `squash`."""

    def surface(u: Array, v: Array) -> Array:
        across = np.cos(v)
        r = radius * (1.0 + depth * np.cos(lobes * u) * across**2)
        return np.stack([r * across * np.cos(u), r * across * np.sin(u), squash * r * np.sin(v)], axis=-1)

    return surface


def torus(ring: float, thickness: float, frame: Array, center: tuple[float, float, float]) -> Surface:
    """Return a torus of radii `ring` and `thickness` about the third column of the rotation `frame` (3, 3)."""
    offset = np.asarray(center, float)

    def surface(u: Array, v: Array) -> Array:
        reach = ring + thickness * np.cos(v)
        local = np.stack([reach * np.cos(u), reach * np.sin(u), thickness * np.sin(v)], axis=-1)
        return local @ frame.T + offset

    return surface


def tilt(about: str, degrees: float) -> Array:
    """Return the rotation (3, 3) by `degrees` about the world axis "x", "y" or "z"."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    plane = {"x": (1, 2), "y": (2, 0), "z": (0, 1)}[about]
    matrix = np.eye(3)
    matrix[np.ix_(plane, plane)] = [[c, -s], [s, c]]
    return matrix
