"""Scenes as hierarchies of parts that are used again and again (max1999, sec. 2)."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from ibrpipe.errors import ValueRangeError, closest
from ibrpipe.types.arrays import Array
from ibrpipe.types.lighting import Lighting
from ibrpipe.types.mesh import Mesh
from ibrpipe.types.parts import Instances, PaintedMesh, Part
from ibrpipe.types.renderable import enclosing_points


@dataclass(frozen=True, eq=False)
class Bounds:
    """What encloses a part, in its own coordinates.

    Attributes
    ----------
    low, high : (3,) float64
        Corners of the box; low > high everywhere where the part is empty.
    """

    low: Array
    high: Array

    @property
    def empty(self) -> bool:
        """Whether there is nothing inside."""
        return bool((self.low > self.high).any())

    @property
    def center(self) -> Array:
        """(3,) float64; the origin where the part is empty."""
        return np.zeros(3) if self.empty else 0.5 * (self.low + self.high)

    @property
    def radius(self) -> float:
        """Radius of the sphere around the box."""
        return 0.0 if self.empty else float(np.linalg.norm(0.5 * (self.high - self.low)))


@dataclass(frozen=True, eq=False, init=False)
class Scene:
    """A hierarchy of parts without cycles.

    Attributes
    ----------
    parts : mapping of str to Part
        By name, every part before those that hold copies of it. Any iterable of parts is taken.
    root : str
        Name of the part that is the scene; its coordinates are the world's.
    lighting : Lighting

    Raises
    ------
    ValueRangeError
        Two parts of one name, an unknown name, or a part that holds copies of itself, directly or not.
    """

    parts: Mapping[str, Part]
    root: str
    lighting: Lighting

    def __init__(self, parts: Mapping[str, Part] | Iterable[Part], root: str, lighting: Lighting | None = None) -> None:
        given = list(parts.values() if isinstance(parts, Mapping) else parts)
        named = {part.name: part for part in given}
        if len(named) != len(given):
            names = [part.name for part in given]
            double = next(name for name in names if names.count(name) > 1)
            raise ValueRangeError(f"two parts are called {double!r}; every part needs a name of its own")
        if root not in named:
            raise ValueRangeError(f"the scene's root {root!r} is no part; {closest(root, named)}")
        for part in given:
            for copies in part.children:
                if copies.part not in named:
                    raise ValueRangeError(
                        f"part {part.name!r} holds copies of {copies.part!r}, which is no part; "
                        f"{closest(copies.part, named)}"
                    )
        object.__setattr__(self, "parts", _sorted_parts(named))
        object.__setattr__(self, "root", root)
        object.__setattr__(self, "lighting", Lighting() if lighting is None else lighting)

    def __repr__(self) -> str:
        """Return the root's name and how many parts there are."""
        return f"Scene({self.root!r}, {len(self.parts)} parts)"

    @cached_property
    def bounds(self) -> dict[str, Bounds]:
        """Boxes around all parts by name, in their own coordinates; not tight where copies are turned."""
        found: dict[str, Bounds] = {}
        for name, part in self.parts.items():
            points = [mesh.mesh.vertices for mesh in part.meshes]
            points += [enclosing_points(source) for source in part.sources]
            for copies in part.children:
                inner = found[copies.part]
                if len(copies) and not inner.empty:
                    points.append(_moved_corners(inner, copies.matrices))
            every = [each for each in points if len(each)]
            low = np.min([each.min(axis=0) for each in every], axis=0) if every else np.full(3, np.inf)
            high = np.max([each.max(axis=0) for each in every], axis=0) if every else np.full(3, -np.inf)
            found[name] = Bounds(low, high)
        return found

    @cached_property
    def sub_objects(self) -> dict[str, int]:
        """Number of parts that one copy of each part consists of, itself counted, all levels."""
        return self._totals(lambda part: 1)

    @cached_property
    def polygons(self) -> dict[str, int]:
        """Number of triangles that one copy of each part consists of, all levels."""
        return self._totals(lambda part: sum(len(each.mesh.faces) for each in part.meshes))

    @cached_property
    def uses(self) -> dict[str, int]:
        """How often each part occurs in the scene, all levels; 0 where the root does not need it."""
        found = dict.fromkeys(self.parts, 0)
        found[self.root] = 1
        for name in reversed(list(self.parts)):
            for copies in self.parts[name].children:
                found[copies.part] += found[name] * len(copies)
        return found

    def _totals(self, own: Callable[[Part], int]) -> dict[str, int]:
        found: dict[str, int] = {}
        for name, part in self.parts.items():
            found[name] = own(part) + sum(len(copies) * found[copies.part] for copies in part.children)
        return found

    def flattened(self, name: str) -> list[PaintedMesh]:
        """Return all meshes of one part with its copies taken apart, captured sources left out."""
        wanted = {name}
        for above in reversed(list(self.parts)):
            if above in wanted:
                wanted.update(copies.part for copies in self.parts[above].children)
        found: dict[str, list[PaintedMesh]] = {}
        for below in (each for each in self.parts if each in wanted):
            part = self.parts[below]
            found[below] = list(part.meshes)
            for copies in part.children:
                inner = found[copies.part]
                found[below] += [_moved(mesh, matrix) for matrix in copies.matrices for mesh in inner]
        return found[name]


def _sorted_parts(named: Mapping[str, Part]) -> dict[str, Part]:
    """Return the parts in an order in which no part stands before one that it holds copies of."""
    order: dict[str, Part] = {}
    for first in named:
        path: dict[str, Iterable[Instances]] = {} if first in order else {first: iter(named[first].children)}
        while path:
            name, waiting = next(reversed(path.items()))
            held = next((copies.part for copies in waiting if copies.part not in order), None)
            if held is None:
                order[name] = named[name]
                del path[name]
            elif held in path:
                raise ValueRangeError(
                    f"part {held!r} holds copies of itself ({' > '.join([*path, held])}); a scene has no cycles"
                )
            else:
                path[held] = iter(named[held].children)
    return order


def _moved_corners(bounds: Bounds, matrices: Array) -> Array:
    """Corners (2, 3), low and high, of the box around a box under (N, 4, 4) matrices."""
    centers = matrices[:, :3, :3] @ bounds.center + matrices[:, :3, 3]
    halves = np.abs(matrices[:, :3, :3]) @ (0.5 * (bounds.high - bounds.low))
    return np.stack([(centers - halves).min(axis=0), (centers + halves).max(axis=0)])


def _moved(painted: PaintedMesh, matrix: ArrayLike) -> PaintedMesh:
    """A mesh under a (4, 4) affine matrix; faces stay counter-clockwise where it mirrors."""
    affine = np.asarray(matrix, np.float64)
    faces = painted.mesh.faces if np.linalg.det(affine[:3, :3]) >= 0 else painted.mesh.faces[:, ::-1]
    mesh = Mesh(painted.mesh.vertices @ affine[:3, :3].T + affine[:3, 3], faces)
    return PaintedMesh(mesh, painted.color, painted.specular, painted.shininess)
