"""A scene as arrays: its parts as nodes, their copies, their triangles."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ibrpipe.types import Array, PaintedMesh, Scene

#: ends the name of the node that holds the own meshes of a part with copies
OWN = "/own"


@dataclass(frozen=True, eq=False)
class Nodes:
    """The hierarchy of a scene; children stand before parents.

    Attributes
    ----------
    names : tuple of str
    copies : (P + 1,) int64
        First copy that each node holds.
    children : (C,) int32
        Nodes that are copied.
    matrices : (C, 12) float64
        Where to: 3 x 4, row by row.
    faces : (P + 1,) int64
        First triangle of each node; only nodes without copies have any.
    corners, paints : (F, 3, 3) float32
        Corners, in the node's coordinates, and their linear albedo.
    materials : (P, 2) float64
        Strength and exponent of highlights: those of the shiniest mesh of the node and its copies.
    """

    names: tuple[str, ...]
    copies: Array
    children: Array
    matrices: Array
    faces: Array
    corners: Array
    paints: Array
    materials: Array

    @property
    def root(self) -> int:
        """Number of the node that is the scene."""
        return len(self.names) - 1

    @property
    def bytes(self) -> int:
        """Bytes held."""
        return self.children.nbytes + self.matrices.nbytes + self.corners.nbytes + self.paints.nbytes

    @cached_property
    def triangles(self) -> Array:
        """(P,) float64: triangles of each node with its copies taken apart; they may be more than integers hold."""
        counts = np.diff(self.faces).astype(np.float64)
        for node in range(len(self.names)):
            inner = slice(self.copies[node], self.copies[node + 1])
            counts[node] += counts[self.children[inner]].sum()
        return counts

    @cached_property
    def uses(self) -> Array:
        """(P,) float64: how often each node occurs in the scene."""
        counts = np.zeros(len(self.names))
        counts[self.root] = 1
        for node in range(self.root, -1, -1):
            np.add.at(counts, self.children[self.copies[node] : self.copies[node + 1]], counts[node])
        return counts

    def flattened(self, node: int) -> tuple[Array, Array]:
        """Corners (F, 3, 3) float64 and paints (F, 3, 3) float32 of a node with its copies taken apart."""
        known: dict[int, tuple[Array, Array]] = {}
        for each in self._below(node):
            known[each] = self._flat(each, known)
        return known[node]

    def _below(self, node: int) -> list[int]:
        """A node and all that it consists of; children stand before parents."""
        wanted = np.zeros(node + 1, bool)
        wanted[node] = True
        for each in range(node, -1, -1):
            if wanted[each]:
                wanted[self.children[self.copies[each] : self.copies[each + 1]]] = True
        return np.flatnonzero(wanted).tolist()

    def _flat(self, node: int, known: dict[int, tuple[Array, Array]]) -> tuple[Array, Array]:
        """One node, taken apart where its copies are `known` so."""
        own = slice(self.faces[node], self.faces[node + 1])
        corners, paints = [self.corners[own].astype(np.float64)], [self.paints[own]]
        for copy in range(self.copies[node], self.copies[node + 1]):
            inner, painted = known[int(self.children[copy])]
            matrix = self.matrices[copy].reshape(3, 4)
            corners.append(inner @ matrix[:, :3].T + matrix[:, 3])
            paints.append(painted)
        return np.concatenate(corners), np.concatenate(paints)


def scene_nodes(scene: Scene) -> Nodes:
    """Lay out a scene; parts that the root does not need are left out."""
    needed = _needed(scene)
    names: list[str] = []
    counts, faces = [0], [0]
    children, matrices, corners, paints = ([np.zeros(shape)] for shape in (0, (0, 12), (0, 3, 3), (0, 3, 3)))
    materials: list[tuple[float, float]] = []
    number: dict[str, int] = {}

    def add(name: str, held: list[tuple[int, Array]], meshes: tuple[PaintedMesh, ...]) -> None:
        number[name] = len(names)
        names.append(name)
        children.extend(np.full(len(each), child, np.int32) for child, each in held)
        matrices.extend(each for _, each in held)
        counts.append(counts[-1] + sum(len(each) for _, each in held))
        corners.extend(mesh.mesh.vertices[mesh.mesh.faces] for mesh in meshes)
        paints.extend(mesh.color[mesh.mesh.faces] for mesh in meshes)
        faces.append(faces[-1] + sum(len(mesh.mesh.faces) for mesh in meshes))
        known = [(mesh.specular, mesh.shininess) for mesh in meshes] + [materials[child] for child, _ in held]
        materials.append(max(known, key=lambda material: material[0], default=(0.0, 1.0)))

    for name in needed:
        part = scene.parts[name]
        held = [(number[each.part], each.matrices[:, :3].reshape(-1, 12)) for each in part.children if len(each)]
        if held and part.meshes:
            add(name + OWN, [], part.meshes)
            held.insert(0, (number[name + OWN], np.eye(4)[:3].reshape(1, 12)))
        add(name, held, () if held else part.meshes)
    return Nodes(
        tuple(names),
        np.array(counts, np.int64),
        np.concatenate(children).astype(np.int32),
        np.concatenate(matrices),
        np.array(faces, np.int64),
        np.concatenate(corners).astype(np.float32),
        np.concatenate(paints).astype(np.float32),
        np.array(materials),
    )


def _needed(scene: Scene) -> list[str]:
    """Names of the parts that the root consists of, in the scene's order."""
    wanted = {scene.root}
    for name in reversed(list(scene.parts)):
        if name in wanted:
            wanted.update(copies.part for copies in scene.parts[name].children if len(copies))
    return [name for name in scene.parts if name in wanted]
