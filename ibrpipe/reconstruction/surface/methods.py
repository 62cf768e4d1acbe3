"""Methods of making a surface: outlines alone, averaged distances, Poisson on their points; and what is cut off."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ibrpipe.core.reconstruction.tsdf import SIDE
from ibrpipe.io.views import View
from ibrpipe.progress import Step
from ibrpipe.reconstruction.depth.evidence import evidence
from ibrpipe.reconstruction.depth.fusion import Cloud, Fused
from ibrpipe.reconstruction.surface.hull_completion import complete_by_hull, complete_by_masks
from ibrpipe.reconstruction.surface.mask_consistency import without_contradicted
from ibrpipe.reconstruction.surface.mesh_operations import (
    grown,
    large_patches,
    vertex_normals,
    whole_parts,
    without_vertices,
)
from ibrpipe.reconstruction.surface.method_choice import Choice
from ibrpipe.reconstruction.surface.photo_consistency import photo_consistency, surely_better
from ibrpipe.reconstruction.surface.poisson import poisson_surface
from ibrpipe.reconstruction.surface.settings import Method, SurfaceConfig
from ibrpipe.reconstruction.surface.silhouettes import Outline, outline_of
from ibrpipe.reconstruction.surface.tsdf import VOXEL_BYTES, VOXELS, Weights, blocks_around, extract, summed
from ibrpipe.reconstruction.surface.visual_hull import hull_surface
from ibrpipe.types import Array, Mesh

HULL, SOLVE = Step("complete", 0.15), Step("solve", 0.7)
#: voxels of the hull that completes, in voxels of the surface that is seen
HULL_COARSER = 2.0
#: voxels from every point at which a surface counts as invented
REACH = 6.0
#: photos from which on surfaces are judged by photo-consistency
LEAST_VIEWS = 6
#: voxels around a point that masks require within which the surface stays
REQUIRED = 3.0
#: share of the area from which on an invented piece, or one that maps look through, is cut out of a completed surface
MEMBRANE = 0.002
_KNOWN = np.ones((1, 1), bool)


@dataclass(frozen=True, eq=False)
class Sources:
    """What a surface is made from.

    Attributes
    ----------
    fused : Fused
    outlines : sequence of Outline
        Empty where not every photo has a mask.
    against : (N, 3) float64
        Points that the masks contradict, see `mask_consistency`.
    config : SurfaceConfig
    memory : int
        Bytes that volume or solver may take.
    views : sequence of View
        The photos, to judge surfaces by; with fewer than `LEAST_VIEWS` Poisson's is taken unjudged.
    """

    fused: Fused
    outlines: Sequence[Outline]
    against: Array
    config: SurfaceConfig
    memory: int
    views: Sequence[View] = ()


@dataclass(frozen=True, eq=False)
class Made:
    """A surface, cleaned.

    Attributes
    ----------
    mesh : Mesh
    method : str
    step, wanted : float
        Size of its voxels, and the size that was asked for, scene units.
    dropped : int
        Parts that were too small to keep.
    completion : dict
        Figures of what the masks required; empty where the hull does not complete.
    photo_consistency : dict
        Of each method tried; empty where only one was.
    """

    mesh: Mesh
    method: Method
    step: float
    wanted: float
    dropped: int
    completion: dict[str, float] = field(default_factory=dict)
    photo_consistency: dict[str, float] = field(default_factory=dict)


def make(choice: Choice, sources: Sources) -> Made:
    """Make the chosen surface.

    Where Poisson was chosen by itself, averaged distances alone or the outlines alone may still agree better with the
    photos.
    """
    config = sources.config
    if choice.method == "hull":
        return _by_hull(sources)
    wanted = config.voxel_pixels * float(np.median(sources.fused.cloud.spacing))
    volume, step = by_volume(sources, wanted)
    if choice.method == "volume":
        return _made(cleaned(volume, sources, False, step), "volume", step, wanted)
    solved = by_poisson(sources, volume, step, choice.hull_completion)
    parts = cleaned(solved.mesh, sources, choice.hull_completion, solved.step, solved.required)
    made = replace(_made(parts, "poisson", solved.step, wanted), completion=solved.completion)
    if config.method != "auto" or len(sources.views) < LEAST_VIEWS:
        return made
    return _judged(made, cleaned(volume, sources, False, step), (step, wanted), solved.hull, sources)


def _judged(
    made: Made, averaged: tuple[Mesh, int], steps: tuple[float, float], hull: Mesh | None, sources: Sources
) -> Made:
    """Take another surface than Poisson's where it surely agrees better with the photos."""
    others: list[Method] = ["volume"] if hull is None else ["volume", "hull"]
    meshes = [made.mesh, averaged[0], *([] if hull is None else [hull])]
    middle = np.median(made.mesh.vertices, axis=0)
    figures = dict(zip([made.method, *others], photo_consistency(meshes, sources.views, middle).T))
    best = max(others, key=lambda method: float(figures[method].mean()))
    if surely_better(figures[best], figures[made.method]):
        made = _made(averaged, "volume", *steps) if best == "volume" else _by_hull(sources)
    means = {method: round(float(each.mean()), 4) for method, each in figures.items()}
    return replace(made, photo_consistency=means)


def _by_hull(sources: Sources) -> Made:
    mesh, step = hull_surface(sources.outlines, sources.config.voxel_pixels, sources.memory)
    return _made(whole_parts(mesh, sources.config.least_part), "hull", step, step)


def _made(parts: tuple[Mesh, int], method: Method, step: float, wanted: float) -> Made:
    return Made(parts[0], method, step, wanted, parts[1])


def by_volume(sources: Sources, step: float) -> tuple[Mesh, float]:
    """Average the maps' distances; also return the size of the voxels, larger where memory asks for it."""
    fused, config = sources.fused, sources.config
    points, most = fused.cloud.position, max(sources.memory // (VOXEL_BYTES * VOXELS), 64)
    low, high = np.quantile(points, (0.0005, 0.9995), axis=0)
    margin = 0.05 * (high - low) + step * SIDE
    blocks = blocks_around(points, low - margin, high + margin, step, config.truncation * step)
    while len(blocks.corners) > most:
        step *= 1.05 * (len(blocks.corners) / most) ** 0.5
        blocks = blocks_around(points, low - margin, high + margin, step, config.truncation * step)
    shown = [outline_of(each.camera, each.mask, _KNOWN) for each in fused.maps] if sources.outlines else []
    cut = [without_contradicted(outline, sources.against) for outline in shown]
    return extract(blocks, summed(blocks, fused.maps, cut, Weights(config.truncation, config.carve))), step


@dataclass(frozen=True, eq=False)
class Solved:
    """What Poisson gives.

    Attributes
    ----------
    mesh : Mesh
    step : float
        Size of its voxels, scene units.
    required : (P, 3) float64
        What the masks require.
    completion : dict
        The figures of it.
    hull : Mesh or None
        What the outlines leave, where it completes.
    """

    mesh: Mesh
    step: float
    required: Array
    completion: dict[str, float]
    hull: Mesh | None = None


def by_poisson(sources: Sources, volume: Mesh, step: float, hull_completion: bool) -> Solved:
    """Solve for the points of the averaged distances that maps show: every map has its say, by its confidence."""
    from scipy.spatial import cKDTree

    found = evidence(volume, sources.fused.maps, 2.0 * step)
    kept = (found.observations >= sources.config.votes) & (found.observations > found.through)
    spacing = np.full(len(kept), step, np.float32)
    every = Cloud(volume.vertices, vertex_normals(volume), found.confidence, found.observations, spacing)
    cloud, required, completion, hull = every.chosen(kept), np.zeros((0, 3)), {}, None
    if hull_completion:
        with HULL.unheard():
            hull, _ = hull_surface(sources.outlines, HULL_COARSER * sources.config.voxel_pixels, sources.memory)
        seen = without_vertices(volume, kept)
        answer = complete_by_masks(cloud, seen, hull, sources.outlines, step)
        required, completion = answer.required, answer.measured
        cloud = complete_by_hull(answer.cloud, sources.fused.maps, seen, hull, step)
    with SOLVE.unheard():
        mesh, step = poisson_surface(cloud, step, sources.memory)
    distance, _ = cKDTree(cloud.position).query(mesh.vertices, distance_upper_bound=REACH * step)
    invented = ~np.isfinite(distance)
    if hull_completion:  # what would open it for a trifle stays
        invented = large_patches(mesh, invented, MEMBRANE)
    return Solved(without_vertices(mesh, ~invented), step, required, completion, hull)


def cleaned(
    raw: Mesh, sources: Sources, hull_completion: bool, step: float, required: Array | None = None
) -> tuple[Mesh, int]:
    """Cut away what no map confirms, unless the hull stands for it, and small parts; also return how many of those.

    What is near the points (P, 3) that masks require stays, although maps look through it.
    """
    from scipy.spatial import cKDTree

    found = evidence(raw, sources.fused.maps, 2.0 * step)
    empty = found.through > 2 * found.observations + 2
    if required is not None and len(required):
        empty &= ~np.isfinite(cKDTree(required).query(raw.vertices, distance_upper_bound=REQUIRED * step)[0])
    if hull_completion:
        keep = ~large_patches(raw, empty, MEMBRANE)
    else:
        keep = grown(raw, (found.observations > 0) & (found.observations >= found.through), 1) & ~empty
    return whole_parts(without_vertices(raw, keep), sources.config.least_part)
