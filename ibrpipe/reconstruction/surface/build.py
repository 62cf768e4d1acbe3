"""Depth maps and masks in, a surface with what is known of it out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

from ibrpipe.errors import CaptureError
from ibrpipe.io.dense import DepthMap
from ibrpipe.io.views import View
from ibrpipe.progress import Part, Step
from ibrpipe.reconstruction.depth.evidence import OBSERVATIONS, Evidence, evidence
from ibrpipe.reconstruction.depth.fusion import FUSE, Cloud, FusionRules, fuse
from ibrpipe.reconstruction.surface.hull_completion import MASKS
from ibrpipe.reconstruction.surface.mask_consistency import contradicting, without_contradicted
from ibrpipe.reconstruction.surface.mesh_operations import Openings, face_areas, openings, simplified
from ibrpipe.reconstruction.surface.method_choice import Choice, choose
from ibrpipe.reconstruction.surface.methods import HULL, SOLVE, Made, Sources, make
from ibrpipe.reconstruction.surface.photo_consistency import CONSISTENCY
from ibrpipe.reconstruction.surface.settings import SurfaceConfig
from ibrpipe.reconstruction.surface.silhouette_fit import fit_to_silhouettes, less_sure
from ibrpipe.reconstruction.surface.silhouettes import OUTLINES, Outline, hull_box, load_outlines
from ibrpipe.reconstruction.surface.tsdf import DISTANCES
from ibrpipe.reconstruction.surface.two_sided import BACKS, with_second_side
from ibrpipe.types import Array, Mesh

#: simplified, and fitted to the silhouettes
SIMPLIFY = Step("simplify", 0.8)
#: in the order of `build_surface`; costs are seconds of two cores for a million pixels of depth maps
STEPS = (
    FUSE, OUTLINES, DISTANCES, OBSERVATIONS, HULL, MASKS, OBSERVATIONS, SOLVE, OBSERVATIONS, OBSERVATIONS, CONSISTENCY,
    SIMPLIFY, BACKS, OBSERVATIONS,
)  # fmt: skip


def surface_parts(megapixels: float) -> list[Part]:
    """Return the steps from depth maps of so many millions of pixels to the surface, with what they cost."""
    return [step.part(megapixels) for step in STEPS]


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
    whole, outlines = outlines, [without_contradicted(each, against) for each in outlines]
    measured = {**choice.measured, "masks_contradicted": sum(a is not b for a, b in zip(whole, outlines))}
    fused_at = perf_counter()
    if choice.method != "hull" and len(fused.cloud.position) < 100:
        raise CaptureError(
            f"only {len(fused.cloud.position)} points agree between the photos' depth maps; add photos with more "
            "overlap, or masks and geometry.surface.method=hull, or a mesh; given depth must be in the "
            "cameras' unit"
        )
    made = make(choice, Sources(fused, outlines, against, config, memory // 2, views))
    step = made.step
    edge = config.triangle_pixels * step / config.voxel_pixels
    with SIMPLIFY.unheard():
        mesh = simplified(made.mesh, edge) if edge > 0 else made.mesh
        moved = np.zeros(len(mesh.vertices))
        if config.silhouette_fit and made.method != "hull":
            mesh, moved = fit_to_silhouettes(mesh, outlines)
    surface = with_second_side(mesh, fused.maps, step, config.truncation, config.two_sided)
    found = evidence(surface.mesh, fused.maps, 2.0 * step, surface.facing if surface.share else None)
    found = less_sure(found, moved[surface.source], step)  # second sides moved along
    facts = {
        "method": made.method,
        "filled_by_hull": choice.hull_completion and made.method != "volume",
        "reason": _reason(choice, made),
        "measured": {**measured, **_judged(made)},
        "points": len(fused.cloud.position),
        "voxel": float(step),
        "voxel_wanted": float(made.wanted),
        "parts_dropped": made.dropped,
        "moved_to_outlines": {
            "share": float((moved > 0.1 * step).mean()),
            "inferred": float((moved > step).mean()),
            "voxels_mean": float(moved.mean() / step),
            "voxels_most": float(moved.max() / step),
        },
        "two_sided": surface.facts,
        **_described(surface.mesh, found, openings(mesh)),
        "seconds": {"fusion": round(fused_at - began, 2), "surface": round(perf_counter() - fused_at, 2)},
    }
    return Built(surface.mesh, found, facts)


def _middle(cloud: Cloud, outlines: Sequence[Outline]) -> Array | None:
    if len(cloud.position):
        return np.median(cloud.position, axis=0)
    return np.mean(hull_box(outlines), axis=0) if outlines else None


def _reason(choice: Choice, made: Made) -> str:
    if not made.photo_consistency:
        return choice.reason
    names = {"poisson": "Poisson", "volume": "averaged distances", "hull": "the outlines alone"}
    told = ", ".join(f"{names[key]} {100 * value:.1f} %" for key, value in made.photo_consistency.items())
    return f"{choice.reason}; photo-consistency: {told}"


def _judged(made: Made) -> dict[str, float]:
    """Return the figures by which the surface was judged, by name."""
    return {**made.completion, **{f"photo_consistency_{key}": value for key, value in made.photo_consistency.items()}}


def _described(mesh: Mesh, found: Evidence, ends: Openings) -> dict[str, Any]:
    """Return the figures of a finished surface; its borders are those of the sheet, without a second side."""
    areas = face_areas(mesh)
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
