"""What is known of a reconstructed surface, in sentences."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ibrpipe.evaluation.metrics import GeometryScores

_METHODS = {
    "volume": "averaging the signed distances of the depth maps",
    "poisson": "Poisson reconstruction of the points that depth maps agree on",
    "hull": "the outlines of the masks",
}


def surface_sentences(
    scores: GeometryScores | None, document: Mapping[str, Any] | None, truth: str | None = None
) -> list[str]:
    """Return what the report says of the surface; nothing of a given one without a truth, of which `truth` tells."""
    sentences = [] if document is None else _made(document)
    sentences += [] if truth is None else [f"{truth}."]
    if scores is not None:
        sentences += _measured(scores)
    return sentences


def _made(document: Mapping[str, Any]) -> list[str]:
    how = _METHODS.get(str(document.get("method")), "other means")
    source = "depth maps of the capture" if document.get("decision") == "depth" else "photos"
    sentences = [f"Warning: {line}." for line in document.get("warnings") or ()]
    sentences.append(f"The surface was made from the {source} by {how}: {document.get('reason', '')}.")
    sentences.append("; ".join([f"It has {_grouped(document.get('faces', 0))} triangles", *_openness(document)]) + ".")
    voxel, wanted = document.get("voxel"), document.get("voxel_wanted")
    if voxel and wanted and voxel > 1.01 * wanted:
        sentences.append(
            f"Memory made its voxels {voxel / wanted:.1f} times larger than asked for; a larger geometry.memory_mb "
            "shows more detail."
        )
    cost = _cost(document)
    return [*sentences, cost] if cost else sentences


def _openness(document: Mapping[str, Any]) -> list[str]:
    """Say what is closed, what was seen, and what was filled."""
    parts = []
    if "boundary_loops" in document:
        loops, length = document["boundary_loops"], document.get("boundary_length", 0.0)
        many = "border" if loops == 1 else "borders"
        parts.append(
            f"it ends in {loops} open {many}, {length:.3g} scene units long together" if loops else "it is closed"
        )
    if "unseen_share" in document:
        filled = "; it was filled from the masks' outlines and has confidence 0" if _filled(document) else ""
        parts.append(f"{100 * document['unseen_share']:.1f} % of its area was seen by no depth map{filled}")
    crossed = document.get("looked_through_share", 0.0)
    if crossed > 0:
        parts.append(f"depth maps look through {100 * crossed:.2f} % of it, which was kept so that it does not open")
    second = document.get("two_sided") or {}
    if second.get("share", 0.0) > 0:
        parts.append(
            f"{100 * second['share']:.0f} % of it is a thin wall that photos see from both sides, and has a second "
            f"side {second['thickness']:.3g} scene units from the first"
        )
    return parts


def _filled(document: Mapping[str, Any]) -> bool:
    return bool(document.get("filled_by_outlines")) and document["unseen_share"] > 0


def _cost(document: Mapping[str, Any]) -> str:
    seconds, peak = document.get("seconds") or {}, document.get("peak_memory_bytes")
    spent = ", ".join(f"{name} {value:.0f} s" for name, value in seconds.items())
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
