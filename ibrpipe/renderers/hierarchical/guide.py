"""What the walk through a hierarchy looks at, and whether slices or polygons of a mesh are the better bargain."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ibrpipe.core.hierarchy.directions import nearest_table
from ibrpipe.renderers.hierarchical.nodes import Nodes
from ibrpipe.renderers.hierarchical.prefiltering import bounding_sphere, enclosing_spheres
from ibrpipe.types import Array
from ibrpipe.types.prerendered import HEIGHT, WIDTH, Prerendered

#: relative times of a texel of a slice, a slice, a pixel and a triangle (measured), and how much more polygons may
#: take, which are exact
_TEXEL, _SLICE, _PIXEL, _TRIANGLE, _FAVOUR = 5.0, 150.0, 6.0, 150.0, 3.0


@dataclass(frozen=True, eq=False)
class Guide:
    """Of every node its sphere, whether it has slices, and its triangles.

    Attributes
    ----------
    spheres : (P, 4) float64
    kinds : (P, 2) int64
        Has slices; number of its own triangles.
    costs : (P, L) float32
        Time to draw its slices over the time that drawing its triangles may take.
    resolutions : (L,) int64
    lookup : (CELLS, CELLS) int32
        Nearest direction.
    rows : (P,) int64
        Number of each node among the library's parts, -1 = none.
    """

    spheres: Array
    kinds: Array
    costs: Array
    resolutions: Array
    lookup: Array
    rows: Array


def build_guide(nodes: Nodes, library: Prerendered) -> Guide:
    """Return the guide through `nodes` for a library that was made of them."""
    number = {name: part for part, name in enumerate(library.names)}
    rows = np.array([number.get(name, -1) for name in nodes.names], np.int64)
    kinds = np.stack([rows >= 0, np.diff(nodes.faces)], axis=1).astype(np.int64)
    return Guide(
        _spheres(nodes, library, rows),
        kinds,
        _costs(nodes, library, rows),
        library.resolutions,
        nearest_table(library.axes),
        rows,
    )


def changed_part(nodes: Nodes, library: Prerendered) -> str | None:
    """Name the first part whose sphere is another in the library, None = none."""
    rows = {name: row for row, name in enumerate(library.names)}
    chosen = [node for node, name in enumerate(nodes.names) if name in rows]
    spheres = library.spheres[[rows[nodes.names[node]] for node in chosen]]
    off = np.abs(enclosing_spheres(nodes, chosen) - spheres).max(axis=1, initial=0.0) > 1e-4 * spheres[:, 3]
    return nodes.names[chosen[int(off.argmax())]] if off.any() else None


def _spheres(nodes: Nodes, library: Prerendered, rows: Array) -> Array:
    """Spheres around all nodes: the library's, else around their triangles, else around the spheres of their copies."""
    found = np.zeros((len(nodes.names), 4))
    for node in range(len(nodes.names)):
        own = nodes.corners[nodes.faces[node] : nodes.faces[node + 1]]
        if rows[node] >= 0:
            found[node] = library.spheres[rows[node]]
        elif len(own):
            found[node] = bounding_sphere(own.astype(np.float64))
        else:
            held = slice(nodes.copies[node], nodes.copies[node + 1])
            found[node] = sphere_around(found[nodes.children[held]], nodes.matrices[held])
    return found


def sphere_around(spheres: Array, matrices: Array) -> Array:
    """(4,) float64: sphere around spheres (N, 4) under matrices (N, 12); 0 where all are empty."""
    filled = spheres[:, 3] > 0
    inner, matrices = spheres[filled], matrices[filled].reshape(-1, 3, 4)
    if len(inner) == 0:
        return np.zeros(4)
    centers = np.einsum("nij,nj->ni", matrices[:, :, :3], inner[:, :3]) + matrices[:, :, 3]
    radii = inner[:, 3] * _stretches(matrices)
    low, high = (centers - radii[:, None]).min(axis=0), (centers + radii[:, None]).max(axis=0)
    center = 0.5 * (low + high)
    return np.append(center, (np.linalg.norm(centers - center, axis=1) + radii).max())


def _stretches(matrices: Array) -> Array:
    """(N,) bounds of the greatest singular values of (N, 3, 4) matrices, as `core.hierarchy.traverse.stretch`.

    Those of turns with one scale are exact: spheres do not grow from level to level of a deep hierarchy.
    """
    products = np.einsum("nki,nkj->nij", matrices[:, :, :3], matrices[:, :, :3])
    return np.sqrt(np.abs(products).sum(axis=2).max(axis=1))


def _costs(nodes: Nodes, library: Prerendered, rows: Array) -> Array:
    levels, views = len(library.resolutions), len(library.axes)
    firsts = library.stacks[:: views or 1]
    areas = np.append(0, np.cumsum(library.slabs[:, WIDTH] * library.slabs[:, HEIGHT]))
    texels = np.diff(areas[firsts]).reshape(-1, levels) / max(views, 1)
    slices = np.diff(firsts).reshape(-1, levels) / max(views, 1)
    costs = np.zeros((len(nodes.names), levels), np.float32)
    for node in np.flatnonzero(rows >= 0):
        part = rows[node]
        triangles = nodes.faces[node + 1] - nodes.faces[node]
        pixels = 0.5 * texels[part]
        costs[node] = (_TEXEL * pixels + _SLICE * slices[part]) / (
            (_TRIANGLE * max(triangles, 1) + _PIXEL * pixels) / _FAVOUR
        )
    return costs
