"""Parts of a scene as prefiltered slices: what `prerender` makes and the renderer `hierarchical` draws."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ibrpipe.core.directions import spread_directions
from ibrpipe.types.arrays import Array
from ibrpipe.types.scene import Scene

#: columns of `Prerendered.slabs`
U, V, WIDTH, HEIGHT, FIRST, BORDERED, NODE = range(7)


@dataclass(frozen=True, eq=False)
class OrthogonalViews:
    """What the six views of all P parts show, as samples, cut into slabs. Source: max1999, sec. 2.

    Attributes
    ----------
    firsts : (P + 1,) int64
        First sample of each part.
    places : (S, 3) float32
        Where, in the part's coordinates.
    albedo, normals : (S, 3) float32
        Linear unshaded colour; unit normal, turned to the view that shows it.
    """

    firsts: Array
    places: Array
    albedo: Array
    normals: Array

    @property
    def bytes(self) -> int:
        """Bytes held beyond the library."""
        return self.places.nbytes + self.albedo.nbytes + self.normals.nbytes


@dataclass(frozen=True, eq=False)
class Prerendered:
    """Slices of P parts from D directions at L resolutions.

    A *stack* is all slabs of one part from one direction at one resolution; its number is
    ``(part * L + resolution) * D + direction``. Slab texels lie on a grid of R x R across the part's sphere.

    Attributes
    ----------
    names : tuple of str
        Parts; a name that ends in ``/own`` means the own meshes of a part that also has copies of others.
    spheres : (P, 4) float64
        Centre and radius in the part's coordinates.
    resolutions : (L,) int64
        Texels across the sphere, ascending.
    axes : (D, 3, 3) float64
        Rows a (along columns), b (along rows), d (towards the viewer), unit.
    stacks : (P L D + 1,) int64
        First slab of every stack.
    slabs : (S, 7) int64
        u, v, width, height of the texels that are kept, first texel, first texel within the stack where every slab has
        a border of one texel, part. Front to back within a stack.
    heights : (S, 2) float32
        Distances from the centre along d, in the part's units: the mean of what is seen, which orders slices, and that
        of the outline, where the slice is drawn.
    means : (S, 12) float32
        Share of the box that is covered; albedo over `scale`, and moments of the normal, weighted by coverage.
    texels : (N, 12) uint8
        As in `ibrpipe.core.hierarchy.prefilter`.
    scale : float
        Albedo of code 255.
    overlaps : (P,) float64
        Texels by which a slab goes on into the one behind it.
    info : mapping
        What is known of its making: seconds, bytes, errors.
    views : OrthogonalViews or None
        The published form of the same parts; None = made when it is first asked for.
    """

    names: tuple[str, ...]
    spheres: Array
    resolutions: Array
    axes: Array
    stacks: Array
    slabs: Array
    heights: Array
    means: Array
    texels: Array
    scale: float
    overlaps: Array
    info: Mapping[str, Any] = field(default_factory=dict)
    views: OrthogonalViews | None = None

    def __repr__(self) -> str:
        """Return how many parts were sliced, and the bytes of the slices."""
        return f"Prerendered({len(self.names)} parts, {self.bytes / 1e6:.1f} MB)"

    @property
    def bytes(self) -> int:
        """Bytes in memory."""
        arrays = (self.spheres, self.axes, self.stacks, self.slabs, self.heights, self.means, self.texels)
        return sum(each.nbytes for each in arrays)


@dataclass(frozen=True, eq=False)
class PrerenderedScene:
    """A scene with the slices that were made of its parts."""

    scene: Scene
    library: Prerendered


def view_axes(count: int) -> Array:
    """Return axes (D, 3, 3) float64 of views, rows a, b, d: 6 = those of max1999, else a spiral over the sphere."""
    directions = np.concatenate([np.eye(3), -np.eye(3)]) if count == 6 else spread_directions(count)
    aside = np.where(np.abs(directions[:, 2:]) < 0.9, (0.0, 0.0, 1.0), (1.0, 0.0, 0.0))
    a = np.cross(aside, directions)
    a /= np.linalg.norm(a, axis=1, keepdims=True)
    return np.stack([a, np.cross(directions, a), directions], axis=1)
