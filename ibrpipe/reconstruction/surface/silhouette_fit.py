"""Where a surface ends against the background it is moved to the photos' outlines.

Depth maps are weakest at the rims of an object, and averaging draws thin parts and open borders inward. The masks know
the rims best: a vertex on the rim that a photo sees must lie on that photo's outline. Idea: esteban2004 (silhouette
forces on a deformable mesh), here two steps of least squares. Masks are the only witness: what ends at the border of a
picture stays.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ibrpipe.core.normals import face_normals
from ibrpipe.embree import MeshCaster
from ibrpipe.reconstruction.depth.evidence import Evidence
from ibrpipe.reconstruction.surface.mesh_operations import adjacency, half_edges, vertex_normals
from ibrpipe.reconstruction.surface.silhouettes import Outline
from ibrpipe.types import Array, Mesh

#: pixels between rim and outline beyond which they are not the same thing
NEAR = 3.0
#: photos that must tell of a vertex
PHOTOS = 3
#: steps; after two the rest was 0.03 pixels at the median
STEPS = 2
#: weight of neighbours that move apart, and of any move, against the wish of `MOST` photos or more
SMOOTH, REST = 0.3, 0.05
MOST = 8
#: pixels beyond the rim at which the background must show
_BEYOND = 1.5
#: pixels that a vertex may lie behind the surface before it and still count as its rim
_BEHIND = 10.0


@dataclass(frozen=True, eq=False)
class Shape:
    """A mesh as the fit needs it.

    Attributes
    ----------
    mesh : Mesh
    edges : (E, 2) int64
        Vertices.
    sides : (E, 2) int64
        Faces beside the edge, the second -1 at a border.
    border : (V,) bool
        On an open border.
    normal, direction : (V, 3) float64
        Unit; a vertex moves along its normal, on an open border along the surface.
    """

    mesh: Mesh
    edges: Array
    sides: Array
    border: Array
    normal: Array
    direction: Array


def fit_to_silhouettes(mesh: Mesh, outlines: Sequence[Outline]) -> tuple[Mesh, Array]:
    """Move the rims to the outlines; also return how far every vertex was moved, (V,) scene units.

    Parameters
    ----------
    mesh : Mesh
    outlines : sequence of Outline
        Of the masks; without any the mesh stays as it is.
    """
    start = mesh.vertices
    for _ in range(STEPS if outlines else 0):
        shape = shape_of(mesh)
        move = smoothest_moves(shape, *wanted(shape, outlines))
        mesh = Mesh(mesh.vertices + move * unfolded(mesh, move)[:, None], mesh.faces)
    return mesh, np.linalg.norm(mesh.vertices - start, axis=1)


def less_sure(found: Evidence, moved: Array, step: float) -> Evidence:
    """Take confidence from what was moved: a place that the masks infer is not one that depth maps show.

    Maps count within two voxels of a place, so the confidence falls evenly to 0 over a move of two voxels.

    Parameters
    ----------
    found : Evidence
        Of the moved vertices.
    moved : (V,) float64
        Scene units.
    step : float
        Size of a voxel.
    """
    left = np.clip(1.0 - moved / (2.0 * step), 0.0, 1.0)
    return replace(found, confidence=(found.confidence * left).astype(np.float32))


def shape_of(mesh: Mesh) -> Shape:
    """Find edges, borders and the directions in which vertices move."""
    count, faces = len(mesh.vertices), mesh.faces.astype(np.int64)
    half = half_edges(faces)
    key, first, number = np.unique(half.min(axis=1) * count + half.max(axis=1), return_index=True, return_counts=True)
    order = np.argsort(half.min(axis=1) * count + half.max(axis=1), kind="stable")
    start, face = np.cumsum(number) - number, np.tile(np.arange(len(faces)), 3)
    second = face[order[np.minimum(start + 1, len(order) - 1)]]
    sides = np.stack([face[first], np.where(number > 1, second, -1)], axis=1)
    normal, open_edges = vertex_normals(mesh).astype(np.float64), half[first[number == 1]]
    border = np.zeros(count, bool)
    border[open_edges] = True
    direction = np.where(border[:, None], _outward(mesh, normal, open_edges), normal)
    return Shape(mesh, np.stack([key // count, key % count], axis=1), sides, border, normal, direction)


def _outward(mesh: Mesh, normal: Array, open_edges: Array) -> Array:
    """Directions (V, 3) in which the surface would go on beyond its open edges (B, 2), given as their faces run."""
    along = mesh.vertices[open_edges[:, 1]] - mesh.vertices[open_edges[:, 0]]
    away = np.cross(along, normal[open_edges].mean(axis=1))
    total = np.zeros_like(normal)
    for end in range(2):
        np.add.at(total, open_edges[:, end], away)
    total -= (total * normal).sum(axis=1, keepdims=True) * normal
    return total / np.maximum(np.linalg.norm(total, axis=1, keepdims=True), 1e-30)


def wanted(shape: Shape, outlines: Sequence[Outline]) -> tuple[Array, Array]:
    """Return how far the photos want vertices moved, (V,) float64 scene units, and how many of them tell (V,)."""
    caster, mesh = MeshCaster(shape.mesh), shape.mesh
    across = face_normals(mesh.vertices, mesh.faces)
    offset, count = (across * mesh.vertices[mesh.faces[:, 0]]).sum(axis=1), len(mesh.vertices)
    told = []
    for each in outlines:
        front = across @ each.camera.center > offset
        turns = (shape.sides[:, 1] >= 0) & (front[shape.sides[:, 0]] != front[shape.sides[:, 1]])
        rim = shape.border.copy()
        rim[shape.edges[turns]] = True
        told.append(_asked(shape, caster, each, np.nonzero(rim)[0]))
    vertex, move = (np.concatenate(each) for each in zip(*told))
    order = np.lexsort((move, vertex))
    number = np.bincount(vertex, minlength=count)
    start = np.cumsum(number) - number
    enough = np.nonzero(number >= PHOTOS)[0]
    low, high = (order[start[enough] + (number[enough] - up) // 2] for up in (1, 0))
    median = np.zeros(count)
    median[enough] = (move[low] + move[high]) / 2
    return median, np.where(number >= PHOTOS, number, 0)


def _asked(shape: Shape, caster: MeshCaster, outline: Outline, rim: Array) -> tuple[Array, Array]:
    """Return the rim's vertices of which a photo tells, and how far along their directions the outline is."""
    from scipy.ndimage import map_coordinates

    def outside(x: Array, y: Array) -> Array:
        return map_coordinates(outline.distance, [y - 0.5, x - 0.5], order=1, mode="nearest").astype(np.float64)

    camera = outline.camera
    height, width = outline.distance.shape
    seen = shape.mesh.vertices[rim] @ camera.R.T + camera.t
    z = np.where(seen[:, 2] > 0, seen[:, 2], 1.0)
    x, y = (seen @ camera.K.T)[:, :2].T / z
    kept = (seen[:, 2] > 0) & (x > 1) & (y > 1) & (x < width - 1) & (y < height - 1)
    kept[kept] = np.abs(outside(x[kept], y[kept])) <= NEAR
    rim, z, x, y = rim[kept], z[kept], x[kept], y[kept]
    slope = np.stack([outside(x + 1, y) - outside(x - 1, y), outside(x, y + 1) - outside(x, y - 1)], axis=1) / 2
    steep = np.linalg.norm(slope, axis=1)
    outward = slope / np.maximum(steep, 1e-9)[:, None]
    turned = shape.direction[rim] @ (camera.K @ camera.R).T
    pixels = ((turned[:, :2] - np.stack([x, y], axis=1) * turned[:, 2:]) * outward).sum(axis=1) / z
    kept = (steep > 0.5) & (pixels > 0.5 * camera.K[0, 0] / z)
    kept[kept] = _ends(caster, outline, shape.mesh.vertices[rim[kept]], (np.stack([x, y], 1) + _BEYOND * outward)[kept])
    return rim[kept], -outside(x[kept], y[kept]) / pixels[kept]


def _ends(caster: MeshCaster, outline: Outline, points: Array, beyond: Array) -> Array:
    """Say at which points (N, 3) the surface ends in a picture: nothing hides them, nothing is `beyond` (N, 2)."""
    camera = outline.camera
    rays = camera.pixel_rays(beyond)
    before = caster.cast(camera.center, points - camera.center)
    return (caster.cast(camera.center, rays).face < 0) & ~(before.t < 1 - _BEHIND / camera.K[0, 0])


def smoothest_moves(shape: Shape, move: Array, photos: Array) -> Array:
    """Return the smoothest moves (V, 3) of all vertices that give what the photos want, fading to none beyond.

    Least squares: photos bind the part along a vertex's direction, neighbours move the same, and all would rather rest.
    """
    links = adjacency(shape.edges, len(move))
    degree, weight = np.asarray(links.sum(axis=1)), np.minimum(photos, MOST)[:, None] / MOST

    def pulled(moves: Array) -> Array:
        bound = weight * (shape.direction * moves).sum(axis=1, keepdims=True) * shape.direction
        return bound + SMOOTH * (degree * moves - links @ moves) + REST * moves

    return _solved(pulled, weight * move[:, None] * shape.direction)


def _solved(pulled: Callable[[Array], Array], target: Array) -> Array:
    """Solve by conjugate gradients, with sums that do not depend on how many threads there are."""
    found, left = np.zeros_like(target), target.copy()
    step, size = left.copy(), float((left * left).sum())
    enough = 1e-6 * size
    for _ in range(300):
        if size <= enough:
            break
        pull = pulled(step)
        length = size / float((step * pull).sum())
        found, left = found + length * step, left - length * pull
        size, before = float((left * left).sum()), size
        step = left + size / before * step
    return found


def unfolded(mesh: Mesh, move: Array) -> Array:
    """Say which vertices may move (V, 3) without turning a face over: those that may not keep their place."""
    free, before = np.ones(len(move), bool), face_normals(mesh.vertices, mesh.faces)
    for _ in range(10):
        after = face_normals(mesh.vertices + move * free[:, None], mesh.faces)
        sizes = np.linalg.norm(before, axis=1) * np.linalg.norm(after, axis=1)
        turned = (before * after).sum(axis=1) < 0.3 * sizes
        if not free[mesh.faces[turned]].any():
            break
        free[mesh.faces[turned]] = False
    return free
