"""A thin wall that is seen from both sides gets a second side.

Depth maps of a wall of a few voxels average to one sheet. From behind, the sheet shows the backs of its faces, and
backs have no colour: every later stage takes what a photo sees for surface that faces it. So the part of a sheet whose
back is seen *in place* (a back is what the ray meets first, and the map's depth is there, or before it by no more than
the distance over which both sides melt together) is doubled, and so is what hangs together with it and is seen from
behind where maps have no depth. The second side stands where the maps see it, and the two are joined along their
borders. Both have colours, observers and confidence of their own. Closed surfaces show no backs, so nothing of them is
doubled.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from ibrpipe.embree import MeshCaster
from ibrpipe.progress import Step
from ibrpipe.reconstruction.depth.map_store import LoadedMap, MapStore
from ibrpipe.reconstruction.surface.mesh_operations import (
    adjacency,
    face_areas,
    grown,
    half_edges,
    large_patches,
    openings,
    parts,
    vertex_normals,
)
from ibrpipe.reconstruction.surface.silhouette_fit import unfolded
from ibrpipe.types import Array, Mesh

BACKS = Step("backs", 0.1)
#: voxels behind a back at which depth is still in place
BEHIND = 2.0
#: least distance between both sides, voxels
GAP = 0.1
#: share of the area from which on a patch of backs is a second side, and up to which a gap in it is closed
PATCH = 0.005
#: rings of triangles over which gaps close
RINGS = 3
#: pixels that fix the thickness at a vertex; weight of its neighbours against them; steps of smoothing
ENOUGH, SMOOTH, STEPS = 8.0, 0.5, 60

TwoSided = Literal["auto", "never", "always"]


@dataclass(frozen=True, eq=False)
class TwoSidedSurface:
    """A surface, parts of which have two sides.

    Attributes
    ----------
    mesh : Mesh
        The sheet as it was, then the vertices and faces of its second side, then the faces that join both.
    facing : (V, 3) float64
        Unit normals of the vertices of both sides, 0 0 0 for those with one side.
    source : (V,) int64
        The sheet's vertex that each comes from.
    share : float
        Of the sheet's area that has a second side.
    backs : float
        Share of the pixels with agreed depth on the sheet that show its back in place.
    thickness : float
        Between both sides, median, scene units.
    reason : str
    """

    mesh: Mesh
    facing: Array
    source: Array
    share: float
    backs: float
    thickness: float
    reason: str

    @property
    def facts(self) -> dict[str, float | str]:
        """Figures for ``geometry.json``."""
        figures = {"share": self.share, "backs_in_place": self.backs, "thickness": self.thickness}
        return {**figures, "reason": self.reason}


@dataclass(frozen=True, eq=False)
class Backs:
    """What depth maps see of the backs of a sheet.

    Attributes
    ----------
    seen : (V,) bool
        More maps see the back in place than look through it.
    likely : (V,) bool
        At least two maps without depth there would see it, and as many see it in place as look through it.
    thickness : (V,) float64
        Sum over the pixels in place, scene units: how far before the sheet they see it, along its normal.
    pixels : (V,) float64
        How many there are.
    share : float
        Of all pixels in place that show a back.
    """

    seen: Array
    likely: Array
    thickness: Array
    pixels: Array
    share: float


def with_second_side(sheet: Mesh, maps: MapStore, step: float, melt: float, choice: TwoSided) -> TwoSidedSurface:
    """Double what maps see from both sides.

    Parameters
    ----------
    sheet : Mesh
    maps : MapStore
        Agreed depth.
    step : float
        Size of a voxel, scene units.
    melt : float
        Voxels within which two sides melt together.
    choice : "auto", "never" or "always"
        always doubles all of it.
    """
    by_hand = "set by geometry.surface.two_sided"
    if choice == "never":
        return _one_sided(sheet, 0.0, by_hand)
    if choice == "auto" and openings(sheet).loops == 0:
        return _one_sided(sheet, 0.0, "a closed surface shows no backs")
    backs = backs_seen(sheet, maps, step, melt)
    every = np.ones(len(sheet.vertices), bool)
    marked = every if choice == "always" else whole_patches(sheet, backs)
    if not marked.any():
        reason = f"{100 * backs.share:.2f} % of the pixels show backs in place, nowhere a patch worth the name"
        return _one_sided(sheet, backs.share, reason)
    reason = f"{100 * backs.share:.1f} % of the pixels show backs in place: a thin wall, seen from both sides"
    return doubled(sheet, marked, backs, GAP * step, by_hand if choice == "always" else reason)


def _one_sided(sheet: Mesh, backs: float, reason: str) -> TwoSidedSurface:
    return TwoSidedSurface(
        sheet, np.zeros_like(sheet.vertices), np.arange(len(sheet.vertices)), 0.0, backs, 0.0, reason
    )


def backs_seen(mesh: Mesh, maps: MapStore, step: float, melt: float) -> Backs:
    """Ask all maps for backs; a pixel tells of the face that its ray meets first."""
    caster, count = MeshCaster(mesh), len(mesh.vertices)
    balance, blank, total, pixels = (np.zeros(count) for _ in range(4))
    shown, right = 0, 0
    for each in BACKS.track(maps, len(maps)):
        look = _looks(caster, each)
        in_place = (
            look.known & (look.before <= np.where(look.back, melt, BEHIND) * step) & (look.before >= -BEHIND * step)
        )
        found = look.back & in_place
        balance += _touched(mesh, look.face[found])
        balance -= _touched(mesh, look.face[look.back & look.known & (look.before < -BEHIND * step)])
        blank += _touched(mesh, look.face[look.back & ~look.known])
        corners = mesh.faces[look.face[found]].ravel()
        total += np.bincount(corners, np.repeat(look.near[found], 3), count)
        pixels += np.bincount(corners, minlength=count)
        shown, right = shown + int(found.sum()), right + int(in_place.sum())
    return Backs(balance > 0, (blank >= 2) & (balance >= 0), total, pixels, shown / max(right, 1))


def _touched(mesh: Mesh, faces: Array) -> Array:
    """Mark the corners of faces."""
    marked = np.zeros(len(mesh.vertices), bool)
    marked[mesh.faces[faces]] = True
    return marked


@dataclass(frozen=True, eq=False)
class _Look:
    """The N pixels of a map, inside its mask, whose rays meet the mesh.

    Attributes
    ----------
    face : (N,) int32
    back, known : (N,) bool
        The face's back is met; the map has depth.
    before, near : (N,) float64
        How far the map's depth lies before the face, along the camera's axis and along the face's normal.
    """

    face: Array
    back: Array
    known: Array
    before: Array
    near: Array


def _looks(caster: MeshCaster, each: LoadedMap) -> _Look:
    hits = caster.cast_camera(each.camera)
    met = (hits.face >= 0) & (each.mask >= 0.5)
    rays = each.camera.pixel_rays(each.camera.pixel_centers()[met])
    slope = (hits.normal[met] * rays).sum(axis=1)
    before = hits.t[met].astype(np.float64) - each.depth[met]
    return _Look(hits.face[met], slope > 0, each.depth[met] > 0, before, before * np.abs(slope))


def whole_patches(mesh: Mesh, backs: Backs) -> Array:
    """Choose the vertices (V,) bool that get a second side.

    Patches seen in place, of at least `PATCH` of the mesh's area, and the likely ones that hang together with them.
    Gaps in them close.
    """
    sure = large_patches(mesh, _closed(mesh, backs.seen), PATCH)
    if not sure.any():
        return sure
    marked = _closed(mesh, sure | backs.seen | backs.likely)
    patch = Mesh(mesh.vertices, mesh.faces[marked[mesh.faces].all(axis=1)])
    _, label = parts(patch)
    marked = _touched(patch, np.isin(label, label[sure[patch.faces].all(axis=1)]))
    _, label = parts(mesh)
    beside = _touched(mesh, np.isin(label, label[marked[mesh.faces].all(axis=1)]))
    return np.asarray(marked | (beside & ~large_patches(mesh, ~marked, PATCH)))


def _closed(mesh: Mesh, marked: Array) -> Array:
    return ~grown(mesh, ~grown(mesh, marked, RINGS), RINGS)


def doubled(sheet: Mesh, marked: Array, backs: Backs, gap: float, reason: str) -> TwoSidedSurface:
    """Give the faces whose corners are all marked (V,) a second side, at least `gap` behind the first."""
    chosen = marked[sheet.faces].all(axis=1)
    vertex, faces = np.unique(sheet.faces[chosen]), sheet.faces[chosen]
    normal, areas, count = vertex_normals(sheet).astype(np.float64), face_areas(sheet), len(sheet.vertices)
    thick = np.maximum(smoothed(sheet, backs), gap)
    thick = np.where(unfolded(sheet, -normal * thick[:, None]), thick, gap)
    number = np.zeros(count, np.int32)
    number[vertex] = count + np.arange(len(vertex), dtype=np.int32)
    a, b = _ends(faces).T
    sides = np.stack([b, a, number[a]], axis=1), np.stack([b, number[a], number[b]], axis=1)
    behind = sheet.vertices[vertex] - (thick[:, None] * normal)[vertex]
    mesh = Mesh(np.concatenate([sheet.vertices, behind]),
                np.concatenate([sheet.faces, number[faces[:, ::-1]], *sides]).astype(np.int32))  # fmt: skip
    facing = np.zeros_like(mesh.vertices)
    facing[vertex], facing[count:] = normal[vertex], -normal[vertex]
    share, median = float(areas[chosen].sum() / areas.sum()), float(np.median(thick[vertex]))
    source = np.concatenate([np.arange(count), vertex])
    return TwoSidedSurface(mesh, facing, source, share, backs.share, median, reason)


def _ends(faces: Array) -> Array:
    """Edges (B, 2) that only one of the faces has, as it runs."""
    half = half_edges(faces)
    _, first, number = np.unique(np.sort(half, axis=1), axis=0, return_index=True, return_counts=True)
    return half[first[number == 1]]


def smoothed(mesh: Mesh, backs: Backs) -> Array:
    """Mean thickness at every vertex (V,), smooth, and extended to where nothing was measured."""
    known = backs.pixels > 0
    if not known.any():
        return np.zeros(len(known))
    mean = np.where(known, backs.thickness / np.maximum(backs.pixels, 1), 0.0)
    found = np.where(known, mean, np.median(mean[known]))
    links = adjacency(half_edges(mesh.faces), len(known))
    degree, weight = np.asarray(links.sum(axis=1)).ravel(), np.minimum(backs.pixels / ENOUGH, 1.0)
    for _ in range(STEPS):
        found = (weight * mean + SMOOTH * (links @ found)) / np.maximum(weight + SMOOTH * degree, 1e-12)
    return np.asarray(found)
