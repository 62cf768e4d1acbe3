"""How far a reconstructed surface is from the true one: accuracy, completeness, F-score.

Both surfaces are sampled evenly by area at fixed places. Every sample of the reconstruction is measured to the nearest
point of the true surface (accuracy), every sample of the truth to the nearest point of the reconstruction
(completeness), exactly on the triangles. Surface that fewer than two photos see can be found by nobody: true samples
there are left out, and so are samples of the reconstruction whose nearest true point lies there. Precision and recall
at a threshold are the shares of the samples within it; F is their harmonic mean (knapitsch2017).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ibrpipe.capture.coverage import SurfacePoints, seen_points, spread_points
from ibrpipe.embree import MeshCaster
from ibrpipe.errors import CaptureError
from ibrpipe.io.views import View, load_view
from ibrpipe.progress import track
from ibrpipe.types import Array, Mesh


@dataclass(frozen=True)
class ThresholdScore:
    """Scores at one threshold.

    Attributes
    ----------
    share : float
        Of the true surface's diagonal.
    distance : float
        The same in scene units.
    precision, recall, f_score : float
        0..1.
    f_score_seen : float or None
        The same with the precision of what was not filled; None where the mesh does not tell.
    """

    share: float
    distance: float
    precision: float
    recall: float
    f_score: float
    f_score_seen: float | None = None


@dataclass(frozen=True, eq=False)
class SurfaceError:
    """Distances between two surfaces.

    Attributes
    ----------
    diagonal : float
        Of the true surface's bounding box, scene units.
    accuracy, completeness : (N,), (M,) float64
        Distances of the samples that count, scene units.
    scores : tuple of ThresholdScore
    seen_share : float
        Share of the true surface that two photos see; 1 without photos.
    """

    diagonal: float
    accuracy: Array
    completeness: Array
    scores: tuple[ThresholdScore, ...]
    seen_share: float


def compare_surfaces(
    mesh: Mesh,
    truth: Mesh,
    views: Sequence[View] = (),
    shares: Sequence[float] = (0.0025, 0.005, 0.01),
    samples: int = 100_000,
    filled: Array | None = None,
) -> SurfaceError:
    """Measure a surface against the truth.

    Parameters
    ----------
    mesh, truth : Mesh
        In one world.
    views : sequence of View
        The photos that the surface was made from; without them all of the truth counts.
    shares : sequence of float
        Thresholds as shares of the true surface's diagonal.
    samples : int
        Points on either surface.
    filled : (V,) bool, optional
        Vertices of the mesh that no depth map shows; scores without them are added.

    Raises
    ------
    CaptureError
        No two photos see any part of the true surface.
    """
    mesh_caster, truth_caster = MeshCaster(mesh), MeshCaster(truth)
    wanted, made = spread_points(truth, samples), spread_points(mesh, samples)
    nearest, face = truth_caster.closest(made.position)
    accuracy = np.linalg.norm(made.position - nearest, axis=1)
    found, _ = mesh_caster.closest(wanted.position)
    completeness = np.linalg.norm(wanted.position - found, axis=1)
    shadows = SurfacePoints(nearest, truth_caster.flat_normals[face].astype(np.float64), wanted.diagonal)
    counts, seen = seen_twice(truth_caster, (wanted, shadows), views)
    if not counts.any():
        raise CaptureError("no two photos see the true surface; check that it shares the cameras' world")
    claimed: Array = np.ones(len(accuracy), bool)
    if filled is not None:
        claimed = (filled[mesh.faces[mesh_caster.closest(made.position)[1]]] == 0).any(axis=1)
    if seen.any():
        accuracy, claimed = accuracy[seen], claimed[seen]
    completeness = completeness[counts]
    told = None if filled is None else claimed
    scores = tuple(_score(share, share * wanted.diagonal, accuracy, completeness, told) for share in shares)
    return SurfaceError(wanted.diagonal, accuracy, completeness, scores, float(counts.mean()))


def seen_twice(caster: MeshCaster, groups: Sequence[SurfacePoints], views: Sequence[View]) -> list[Array]:
    """Say of several groups of points on the true surface which at least two photos see; all without photos."""
    if not views:
        return [np.ones(len(points.position), bool) for points in groups]
    counts = [np.zeros(len(points.position), np.int32) for points in groups]
    for view in track(views, "true surface in the photos"):
        mask = load_view(view)[1]
        for count, points in zip(counts, groups):
            count += seen_points(points, view.camera, mask, caster)
    return [count >= 2 for count in counts]


def _score(
    share: float, distance: float, accuracy: Array, completeness: Array, claimed: Array | None
) -> ThresholdScore:
    near, recall = accuracy <= distance, float((completeness <= distance).mean())
    precision = float(near.mean())
    apart = None if claimed is None or not claimed.any() else _harmonic(float(near[claimed].mean()), recall)
    return ThresholdScore(share, distance, precision, recall, _harmonic(precision, recall), apart)


def _harmonic(precision: float, recall: float) -> float:
    both = precision + recall
    return 2 * precision * recall / both if both else 0.0
