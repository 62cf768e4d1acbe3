"""Depth maps and masks in, a surface with what is known of it out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

from ibrpipe.core.volume import SIDE
from ibrpipe.errors import CaptureError
from ibrpipe.io.dense import DepthMap
from ibrpipe.io.views import View
from ibrpipe.stages.surface.choose import Choice, choose
from ibrpipe.stages.surface.doubt import contradicting, doubted
from ibrpipe.stages.surface.fill import with_outlines
from ibrpipe.stages.surface.finish import (
    Evidence,
    evidence,
    face_areas,
    grown,
    large_patches,
    openings,
    simplified,
    vertex_normals,
    whole_parts,
    without_vertices,
)
from ibrpipe.stages.surface.fusion import Cloud, Fused, FusionRules, fuse
from ibrpipe.stages.surface.hull import Outline, hull_box, load_outlines, outline_of
from ibrpipe.stages.surface.hull_surface import hull_surface
from ibrpipe.stages.surface.maps import MapStore
from ibrpipe.stages.surface.poisson import poisson_surface
from ibrpipe.stages.surface.settings import SurfaceConfig
from ibrpipe.stages.surface.volume import (
    VOXEL_BYTES,
    VOXELS,
    Weights,
    blocks_around,
    extract,
    summed,
)
from ibrpipe.types import Array, Mesh

#: voxels of the outlines' surface that fills, in voxels of the surface that is seen
FILL_COARSER = 2.0


#: voxels from every point at which a surface counts as invented
REACH = 6.0
#: share of the area from which on an invented piece, or one that maps look through, is cut out of a filled surface
MEMBRANE = 0.002


@dataclass(frozen=True, eq=False)
class Built:
    """A surface.

    Attributes
    ----------
    mesh : Mesh
    evidence : Evidence
        Of its vertices.
    facts : dict
        What ``geometry.json`` tells of it.
    """

    mesh: Mesh
    evidence: Evidence
    facts: dict[str, Any]


def build_surface(
    views: Sequence[View], maps: Sequence[DepthMap], config: SurfaceConfig, scratch: Path, memory: int
) -> Built:
    """Make the surface that the depth maps and masks show.

    Parameters
    ----------
    views : sequence of View
    maps : sequence of DepthMap
        May be empty where masks are given.
    config : SurfaceConfig
    scratch : Path
        Folder for what does not stay in memory.
    memory : int
        Bytes that maps and volume may take.

    Raises
    ------
    CaptureError
        Nothing can be made of them.
    """
    began = perf_counter()
    rules = FusionRules(config.disparity, config.depth_difference, config.normal_angle, config.votes)
    fused = fuse(maps, rules, scratch, memory // 3)
    masked = all(view.masked for view in views)
    outlines = load_outlines(views) if masked else []
    share = fused.confirmed / max(fused.masked, 1)
    middle = _middle(fused.cloud, outlines)
    choice = choose(config, views, outlines, share, middle)
    against = contradicting(fused.cloud, outlines)
    whole, outlines = outlines, [doubted(each, against) for each in outlines]
    measured = {**choice.measured, "masks_contradicted": sum(a is not b for a, b in zip(whole, outlines))}
    fused_at = perf_counter()
    if choice.method != "hull" and len(fused.cloud.position) < 100:
        raise CaptureError(
            f"only {len(fused.cloud.position)} points agree between the photos' depth maps; add photos with more "
            "overlap, or masks and geometry.surface.method=hull, or a mesh"
        )
    raw, step = _raw(choice, fused, outlines, against, config, memory)
    mesh, dropped = _cleaned(raw, fused.maps, choice, config, step)
    edge = config.triangle_pixels * step / config.voxel_pixels
    mesh = simplified(mesh, edge) if edge > 0 else mesh
    found = evidence(mesh, fused.maps, 2.0 * step)
    facts = {
        "method": choice.method,
        "filled_by_outlines": choice.fill,
        "reason": choice.reason,
        "measured": measured,
        "points": len(fused.cloud.position),
        "voxel": float(step),
        "parts_dropped": dropped,
        **_described(mesh, found),
        "seconds": {"fusion": round(fused_at - began, 2), "surface": round(perf_counter() - fused_at, 2)},
    }
    return Built(mesh, found, facts)


def _middle(cloud: Cloud, outlines: Sequence[Outline]) -> Array | None:
    if len(cloud.position):
        return np.median(cloud.position, axis=0)
    return np.mean(hull_box(outlines), axis=0) if outlines else None


def _raw(
    choice: Choice, fused: Fused, outlines: Sequence[Outline], against: Array, config: SurfaceConfig, memory: int
) -> tuple[Mesh, float]:
    """Return the surface as it comes, and the size of its voxels."""
    from scipy.spatial import cKDTree

    if choice.method == "hull":
        return hull_surface(outlines, config.voxel_pixels, memory // 2)
    step = config.voxel_pixels * float(np.median(fused.cloud.spacing))
    if choice.method == "volume":
        return _volume(fused, outlines, against, config, step, memory // 2)
    seen, cloud, step = _averaged(fused, outlines, against, config, step, memory // 2)
    if choice.fill:
        hull, _ = hull_surface(outlines, FILL_COARSER * config.voxel_pixels, memory // 2)
        cloud = with_outlines(cloud, fused.maps, seen, hull, step)
    mesh = poisson_surface(cloud, step)
    distance, _ = cKDTree(cloud.position).query(mesh.vertices, distance_upper_bound=REACH * step)
    invented = ~np.isfinite(distance)
    if choice.fill:  # what would open it for a trifle stays
        invented = large_patches(mesh, invented, MEMBRANE)
    return without_vertices(mesh, ~invented), step


def _averaged(
    fused: Fused, outlines: Sequence[Outline], against: Array, config: SurfaceConfig, step: float, memory: int
) -> tuple[Mesh, Cloud, float]:
    """Return what maps show of the averaged distances' surface, as mesh and as points, and the size of its voxels.

    Every depth map has its say in it, by its confidence.
    """
    mesh, step = _volume(fused, outlines, against, config, step, memory)
    found = evidence(mesh, fused.maps, 2.0 * step)
    kept = (found.observations >= config.votes) & (found.observations > found.through)
    cloud = Cloud(
        mesh.vertices[kept],
        vertex_normals(mesh)[kept],
        found.confidence[kept],
        found.observations[kept],
        np.full(int(kept.sum()), step, np.float32),
    )
    return without_vertices(mesh, kept), cloud, step


def _volume(
    fused: Fused, outlines: Sequence[Outline], against: Array, config: SurfaceConfig, step: float, memory: int
) -> tuple[Mesh, float]:
    points, most = fused.cloud.position, max(memory // (VOXEL_BYTES * VOXELS), 64)
    low, high = np.quantile(points, (0.0005, 0.9995), axis=0)
    margin = 0.05 * (high - low) + step * SIDE
    blocks = blocks_around(points, low - margin, high + margin, step, config.truncation * step)
    while len(blocks.corners) > most:
        step *= 1.05 * (len(blocks.corners) / most) ** 0.5
        blocks = blocks_around(points, low - margin, high + margin, step, config.truncation * step)
    fitting = [doubted(outline_of(each.camera, each.mask, _KNOWN), against) for each in fused.maps if outlines]
    value = summed(blocks, fused.maps, fitting, Weights(config.truncation, config.carve))
    return extract(blocks, value), step


_KNOWN = np.ones((1, 1), bool)


def _cleaned(raw: Mesh, maps: MapStore, choice: Choice, config: SurfaceConfig, step: float) -> tuple[Mesh, int]:
    """Cut away what no map confirms, unless outlines stand for it, and small parts."""
    if choice.method == "hull":
        return whole_parts(raw, config.least_part)
    found = evidence(raw, maps, 2.0 * step)
    empty = found.through > 2 * found.observations + 2
    if choice.fill:
        keep = ~large_patches(raw, empty, MEMBRANE)
    else:
        keep = grown(raw, (found.observations > 0) & (found.observations >= found.through), 1) & ~empty
    return whole_parts(without_vertices(raw, keep), config.least_part)


def _described(mesh: Mesh, found: Evidence) -> dict[str, Any]:
    """Return the figures of a finished surface."""
    areas, ends = face_areas(mesh), openings(mesh)
    unseen = (found.observations[mesh.faces] == 0).all(axis=1)
    crossed = (found.through > 2 * found.observations + 2)[mesh.faces].all(axis=1)
    return {
        "vertices": len(mesh.vertices),
        "faces": len(mesh.faces),
        "area": float(areas.sum()),
        "unseen_share": float(areas[unseen].sum() / areas.sum()),
        "looked_through_share": float(areas[crossed].sum() / areas.sum()),
        "boundary_loops": ends.loops,
        "boundary_length": ends.length,
        "crowded_edges": ends.crowded,
        "closed": ends.loops == 0,
        "confidence": {
            "mean": float(found.confidence.mean()),
            "tenth": float(np.quantile(found.confidence, 0.1)),
        },
        "observations_median": int(np.median(found.observations)),
    }
