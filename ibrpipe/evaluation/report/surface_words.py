"""What is known of a reconstructed surface, in sentences."""

from __future__ import annotations

from ibrpipe.evaluation.metrics import GeometryScores
from ibrpipe.io.documents.geometry import Geometry

_METHODS = {
    "volume": "averaging the signed distances of the depth maps",
    "poisson": "Poisson reconstruction of the points that depth maps agree on",
    "hull": "the outlines of the masks",
}


def surface_sentences(
    scores: GeometryScores | None, made: Geometry | None, truth: str | None = None, peak_memory_bytes: int | None = None
) -> list[str]:
    """Return what the report says of the surface; nothing of a given one without a truth, of which `truth` tells."""
    sentences = [] if made is None else _made(made, peak_memory_bytes)
    sentences += [] if truth is None else [f"{truth}."]
    if scores is not None:
        sentences += _measured(scores)
    return sentences


def _made(made: Geometry, peak_memory_bytes: int | None) -> list[str]:
    how = _METHODS.get(str(made.method), "other means")
    source = "depth maps of the capture" if made.decision == "depth" else "photos"
    sentences = [f"Warning: {line}." for line in made.warnings or ()]
    sentences.append(f"The surface was made from the {source} by {how}: {made.reason}.")
    sentences.append("; ".join([f"It has {_grouped(made.faces)} triangles", *_openness(made)]) + ".")
    if made.voxel and made.voxel_wanted and made.voxel > 1.01 * made.voxel_wanted:
        sentences.append(
            f"Memory made its voxels {made.voxel / made.voxel_wanted:.1f} times larger than asked for; a larger "
            "geometry.memory_mb shows more detail."
        )
    cost = _cost(made, peak_memory_bytes)
    return [*sentences, cost] if cost else sentences


def _openness(made: Geometry) -> list[str]:
    """Say what is closed, what was seen, and what was filled."""
    parts = []
    if made.boundary_loops is not None:
        many = "border" if made.boundary_loops == 1 else "borders"
        length = f"{made.boundary_length or 0.0:.3g} scene units long together"
        parts.append(
            f"it ends in {made.boundary_loops} open {many}, {length}" if made.boundary_loops else "it is closed"
        )
    if made.unseen_share is not None:
        filled = made.filled_by_hull and made.unseen_share > 0
        words = "; it was filled from the masks' outlines and has confidence 0" if filled else ""
        parts.append(f"{100 * made.unseen_share:.1f} % of its area was seen by no depth map{words}")
    if made.looked_through_share:
        crossed = 100 * made.looked_through_share
        parts.append(f"depth maps look through {crossed:.2f} % of it, which was kept so that it does not open")
    second = made.two_sided or {}
    share, thickness = second.get("share", 0.0), second.get("thickness", 0.0)
    if isinstance(share, int | float) and share > 0:
        parts.append(
            f"{100 * share:.0f} % of it is a thin wall that photos see from both sides, and has a second side "
            f"{thickness:.3g} scene units from the first"
        )
    return parts


def _cost(made: Geometry, peak: int | None) -> str:
    spent = ", ".join(f"{name} {value:.0f} s" for name, value in (made.seconds or {}).items())
    memory = f"{peak / 1e9:.2f} GB of memory at most" if peak else ""
    both = "; ".join(part for part in (spent, memory) if part)
    return f"It took: {both}." if both else ""


def _grouped(count: int) -> str:
    return f"{count:,}".replace(",", "\u202f")


def _measured(scores: GeometryScores) -> list[str]:
    each = ", ".join(f"{score.f_score:.3f} at {100 * score.share:g} %" for score in scores.thresholds)
    alone = [score.f_score_seen for score in scores.thresholds if score.f_score_seen is not None]
    sentences = [
        f"Against the true surface {scores.truth} its F-score is {each} of the diagonal ({scores.diagonal:.4g} scene "
        f"units), over the {100 * scores.seen_share:.0f} % of the true surface that two photos see; the median "
        f"distance to the truth is {100 * scores.accuracy_median / scores.diagonal:.3f} % of the diagonal, from the "
        f"truth to it {100 * scores.completeness_median / scores.diagonal:.3f} %."
    ]
    if alone and any(abs(value - score.f_score) >= 0.002 for value, score in zip(alone, scores.thresholds)):
        told = ", ".join(f"{value:.3f}" for value in alone)
        sentences.append(f"Without the part that was filled, which nobody saw, the F-score is {told}.")
    if scores.depth is not None:
        bad = ", ".join(
            f"{100 * share:.1f} % by more than {100 * score.share:g} %"
            for share, score in zip(scores.depth.bad_shares, scores.thresholds)
        )
        sentences.append(
            f"Its {scores.depth.maps} depth maps know {100 * scores.depth.known:.1f} % of its pixels; the "
            f"median error is {100 * scores.depth.median / scores.diagonal:.3f} % of the diagonal, the root mean "
            f"square {100 * scores.depth.rmse / scores.diagonal:.3f} %; of the pixels with depth err {bad}."
        )
    return sentences
