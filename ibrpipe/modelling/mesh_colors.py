"""Colours of meshes where rays meet them, filtered to what a texel of the new image covers.

Textures are read from mip maps by up to `PROBES` trilinear probes along the longer axis of the texel's footprint, as
relief-mapped meshes read theirs (policarpo2005, sec. 5). What brings no colours is clay, shaded by a fixed light.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np

from ibrpipe.core.relief_mesh.mips import build_mips, read_points
from ibrpipe.embree import MeshCaster
from ibrpipe.types import Array, Mesh
from ibrpipe.types.mesh import MeshColors

#: most probes of one texel's footprint
PROBES = 8
#: colour of a mesh that brings none
CLAY = (0.62, 0.54, 0.46)


class Painter(Protocol):
    """Knows the colour of a mesh where a ray meets it."""

    def at(self, face: Array, weights: Array, rays: Array, steps: tuple[Array, Array]) -> Array:
        """Return the colours (N, 3); see `ColorSampler.at`."""
        ...


def painter_of(caster: MeshCaster, colors: MeshColors | None) -> Painter:
    """Return what knows the colours of the mesh that `caster` casts at: its own, or clay where it has none."""
    return _Clay(caster) if colors is None else ColorSampler(caster.mesh, colors)


def clay(normal: Array) -> Array:
    """Shaded colour (..., 3) of unit normals (..., 3)."""
    light = np.array([-0.4, 0.55, 0.73]) / np.linalg.norm([-0.4, 0.55, 0.73])
    shade = 0.3 + 0.7 * np.clip(0.5 + 0.5 * normal @ light, 0, 1) ** 1.5
    return (np.array(CLAY) * shade[..., None]).astype(np.float32)


class _Clay:
    """Every mesh as clay."""

    def __init__(self, caster: MeshCaster) -> None:
        self._caster = caster

    def at(self, face: Array, weights: Array, rays: Array, steps: tuple[Array, Array]) -> Array:
        """Return the shade of the interpolated normals."""
        return clay(self._caster.smooth_normals(face, weights))


class ColorSampler:
    """Colours of a mesh, prepared for reading at many hits.

    Parameters
    ----------
    mesh : Mesh
        That the rays meet.
    colors : MeshColors
        Of its faces.
    """

    def __init__(self, mesh: Mesh, colors: MeshColors) -> None:
        self._mesh, self._colors = mesh, colors
        self._texture, self._uv = np.asarray(colors.texture), np.asarray(colors.uv)
        self._mips = [
            build_mips(np.concatenate([each, np.ones_like(each[..., :1])], axis=2)) for each in colors.textures
        ]

    def at(self, face: Array, weights: Array, rays: Array, steps: tuple[Array, Array]) -> Array:
        """Return the colours (N, 3) float32 where rays meet faces.

        Parameters
        ----------
        face : (N,) int
        weights : (N, 2)
            Barycentric weights of the second and third corner, as `MeshCaster` returns them.
        rays : (N, 3)
            Directions, world, any length.
        steps : pair of (N, 3)
            World, from each hit to where the rays of the next texel along the columns and along the rows pass it.
        """
        first = 1.0 - weights.sum(axis=1, keepdims=True)
        shares = np.concatenate([first, weights], axis=1)
        color = np.einsum("nk,nkc->nc", shares, self._colors.corner[face]).astype(np.float32)
        for index, mips in enumerate(self._mips):
            own = np.flatnonzero(self._texture[face] == index)
            if len(own):
                corners = self._uv[face[own]]
                places = np.einsum("nk,nkc->nc", shares[own], corners)
                feet = np.concatenate([self._shift(face[own], rays[own], step[own], corners) for step in steps], axis=1)
                found = np.empty((len(own), 4))
                read_points(*mips, self._colors.wraps, places, np.ascontiguousarray(feet), PROBES, found)
                color[own] *= found[:, :3].astype(np.float32)
        return color

    def _shift(self, face: Array, rays: Array, step: Array, corners: Array) -> Array:
        """(N, 2) change of texture coordinates when the rays move by `step` and meet the faces' planes."""
        a, b, c = (self._mesh.vertices[self._mesh.faces[face, k]] for k in range(3))
        p, q = b - a, c - a
        normal = np.cross(p, q)
        with np.errstate(divide="ignore", invalid="ignore"):  # grazing rays and faces without area: coarsest level
            along = _dot(step, normal) / _dot(rays, normal)
            moved = step - along[:, None] * rays
            square = _dot(normal, normal)
            second, third = _dot(np.cross(moved, q), normal) / square, _dot(np.cross(p, moved), normal) / square
            first, other = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
            shift: Array = second[:, None] * first + third[:, None] * other
        return shift


def _dot(a: Array, b: Array) -> Array:
    product: Array = (a * b).sum(axis=1)
    return product
