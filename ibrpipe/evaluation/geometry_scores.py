"""The error of a run's surface and depth maps, as ``metrics.json`` holds it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ibrpipe.embree import MeshCaster
from ibrpipe.evaluation.depth_error import DepthError, depth_error, maps_of
from ibrpipe.evaluation.metrics import DepthScores, GeometryScores, ThresholdScores
from ibrpipe.evaluation.surface_error import SurfaceError, compare_surfaces
from ibrpipe.io.dense import Workspace
from ibrpipe.io.surfaces.meshes import read_vertex_values
from ibrpipe.io.views import View
from ibrpipe.types import Array, Mesh


@dataclass(frozen=True)
class GeometryRules:
    """How surfaces are compared.

    Attributes
    ----------
    thresholds : tuple of float
        Shares of the true surface's diagonal.
    samples : int
    """

    thresholds: tuple[float, ...] = (0.0025, 0.005, 0.01)
    samples: int = 60_000


def filled_vertices(mesh: Path) -> Array | None:
    """Return which vertices of a mesh file no depth map shows, (V,) bool; None where the file does not tell."""
    observations = read_vertex_values(mesh).get("observations") if mesh.suffix.lower() == ".ply" else None
    return None if observations is None else observations == 0


def measure_geometry(
    mesh: Mesh,
    true: Mesh,
    name: str,
    views: Sequence[View],
    dense: Path | None,
    rules: GeometryRules,
    filled: Array | None = None,
) -> GeometryScores:
    """Compare a surface, and the depth maps in the folder `dense`, with the true mesh, which is called `name`.

    `filled` (V,) bool marks vertices that no depth map shows.
    """
    error = compare_surfaces(mesh, true, views, rules.thresholds, rules.samples, filled)
    maps = maps_of(Workspace(dense), views) if dense is not None and dense.is_dir() else ()
    distances = [share * error.diagonal for share in rules.thresholds]
    depth = depth_error(maps, MeshCaster(true), distances) if maps else None
    return scores_of(error, name, rules, depth)


def scores_of(error: SurfaceError, name: str, rules: GeometryRules, depth: DepthError | None = None) -> GeometryScores:
    """Return the figures of an error."""
    return GeometryScores(
        truth=name,
        diagonal=error.diagonal,
        samples=rules.samples,
        seen_share=error.seen_share,
        accuracy_mean=float(error.accuracy.mean()),
        accuracy_median=float(np.median(error.accuracy)),
        completeness_mean=float(error.completeness.mean()),
        completeness_median=float(np.median(error.completeness)),
        thresholds=[
            ThresholdScores(
                share=score.share,
                distance=score.distance,
                precision=score.precision,
                recall=score.recall,
                f_score=score.f_score,
                f_score_seen=score.f_score_seen,
            )
            for score in error.scores
        ],
        depth=None
        if depth is None
        else DepthScores(
            maps=depth.maps, known=depth.known, rmse=depth.rmse, median=depth.median, bad_shares=list(depth.bad)
        ),
    )
