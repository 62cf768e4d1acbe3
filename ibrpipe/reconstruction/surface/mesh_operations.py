"""From a raw surface to the one that is kept: what was seen, whole parts, fewer triangles, and how sure it is."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ibrpipe.core.normals import face_normals
from ibrpipe.errors import CaptureError
from ibrpipe.native_imports import import_open3d
from ibrpipe.types import Array, Mesh


def without_vertices(mesh: Mesh, keep: Array) -> Mesh:
    """Return the mesh of the faces whose corners are all kept.

    Raises
    ------
    CaptureError
        None is left.
    """
    faces = mesh.faces[keep[mesh.faces].all(axis=1)]
    if len(faces) == 0:
        raise CaptureError("nothing is left of the surface: no depth map confirms it; look at the photos' overlap")
    used = np.zeros(len(mesh.vertices), bool)
    used[faces] = True
    number = np.cumsum(used) - 1
    return Mesh(mesh.vertices[used], number[faces].astype(np.int32))


def grown(mesh: Mesh, marked: Array, rings: int) -> Array:
    """Mark also the vertices within so many edges of marked ones."""
    marked = marked.copy()
    for _ in range(rings):
        touched = marked[mesh.faces].any(axis=1)
        marked[mesh.faces[touched]] = True
    return marked


def face_areas(mesh: Mesh) -> Array:
    """Area of every face, (F,) float64."""
    return 0.5 * np.linalg.norm(face_normals(mesh.vertices, mesh.faces), axis=1)


def vertex_normals(mesh: Mesh) -> Array:
    """Unit normals of the vertices, (V, 3) float32, by the areas of their faces."""
    flat = face_normals(mesh.vertices, mesh.faces)
    normals = np.zeros_like(mesh.vertices)
    for corner in range(3):
        np.add.at(normals, mesh.faces[:, corner], flat)
    return (normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)).astype(np.float32)


def half_edges(faces: Array) -> Array:
    """Edges of faces (F, 3) as they run, (3 F, 2): the first edges of all faces, then the second, then the third."""
    return np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])


def adjacency(edges: Array, count: int) -> Any:
    """Return the symmetric sparse matrix (V, V) that counts the edges (E, 2) between `count` vertices."""
    from scipy.sparse import coo_matrix

    a, b = edges.T
    return coo_matrix((np.ones(2 * len(a)), (np.r_[a, b], np.r_[b, a])), shape=(count, count)).tocsr()


def parts(mesh: Mesh) -> tuple[int, Array]:
    """Return how many connected parts there are, and the part of every face (F,) int32."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    edges = np.concatenate([mesh.faces[:, :2], mesh.faces[:, 1:]])
    count = len(mesh.vertices)
    graph = coo_matrix((np.ones(len(edges), np.int8), (edges[:, 0], edges[:, 1])), shape=(count, count))
    number, label = connected_components(graph, directed=False)
    return int(number), label[mesh.faces[:, 0]]


def whole_parts(mesh: Mesh, share: float) -> tuple[Mesh, int]:
    """Keep the parts with at least `share` of the largest one's area; also return how many were dropped."""
    number, label = parts(mesh)
    area = np.bincount(label, face_areas(mesh), minlength=number)
    kept = area >= share * area.max()
    present = np.bincount(label, minlength=number) > 0
    keep = np.zeros(len(mesh.vertices), bool)
    keep[mesh.faces[kept[label]]] = True
    return without_vertices(mesh, keep), int((present & ~kept).sum())


def large_patches(mesh: Mesh, marked: Array, share: float) -> Array:
    """Return the marked vertices (V,) bool that hang together over more than `share` of the mesh's area."""
    inside = marked[mesh.faces].all(axis=1)
    if not inside.any():
        return np.zeros_like(marked)
    areas = face_areas(mesh)
    patch = Mesh(mesh.vertices, mesh.faces[inside])
    number, label = parts(patch)
    large = np.bincount(label, areas[inside], minlength=number) > share * areas.sum()
    chosen = np.zeros_like(marked)
    chosen[patch.faces[large[label]]] = True
    return chosen


def simplified(mesh: Mesh, edge: float) -> Mesh:
    """Join triangles until they are about `edge` wide at the mean; a coarser mesh stays as it is (garland1997)."""
    wanted = int(face_areas(mesh).sum() / (0.433 * edge * edge))
    if wanted >= len(mesh.faces) or wanted < 4:
        return mesh
    o3d = import_open3d()
    shift = mesh.vertices.mean(axis=0)
    vertices = o3d.utility.Vector3dVector(mesh.vertices - shift)
    full = o3d.geometry.TriangleMesh(vertices, o3d.utility.Vector3iVector(mesh.faces))
    small = full.simplify_quadric_decimation(wanted, boundary_weight=4.0)
    small.remove_degenerate_triangles()
    small.remove_unreferenced_vertices()
    return Mesh(np.asarray(small.vertices) + shift, np.asarray(small.triangles, dtype=np.int32))


@dataclass(frozen=True)
class Openings:
    """Where a surface ends.

    Attributes
    ----------
    loops : int
        Closed chains of edges with one face only.
    length : float
        Of all these edges, scene units.
    crowded : int
        Edges with more than two faces.
    """

    loops: int
    length: float
    crowded: int


def openings(mesh: Mesh) -> Openings:
    """Find the borders of a mesh."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    edges = np.sort(half_edges(mesh.faces), axis=1)
    unique, count = np.unique(edges, axis=0, return_counts=True)
    border = unique[count == 1]
    if len(border) == 0:
        return Openings(0, 0.0, int((count > 2).sum()))
    length = float(np.linalg.norm(mesh.vertices[border[:, 0]] - mesh.vertices[border[:, 1]], axis=1).sum())
    names, index = np.unique(border, return_inverse=True)
    index = index.reshape(-1, 2)
    graph = coo_matrix((np.ones(len(index), np.int8), (index[:, 0], index[:, 1])), shape=(len(names), len(names)))
    return Openings(int(connected_components(graph, directed=False)[0]), length, int((count > 2).sum()))
