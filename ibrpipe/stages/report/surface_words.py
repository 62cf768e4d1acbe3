"""What is known of a reconstructed surface, in sentences."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ibrpipe.stages.metrics import GeometryScores

_METHODS = {
    "volume": "averaging the signed distances of the depth maps",
    "poisson": "Poisson reconstruction of the points that depth maps agree on",
    "hull": "the outlines of the masks",
}


def surface_sentences(scores: GeometryScores | None, document: Mapping[str, Any] | None) -> list[str]:
    """Return what the report says of the surface; nothing of a given one without a truth."""
    sentences = [] if document is None else _made(document)
    if scores is not None:
        sentences += _measured(scores)
    return sentences


def _made(document: Mapping[str, Any]) -> list[str]:
    how = _METHODS.get(str(document.get("method")), "other means")
    sentences = [f"The surface was made from the photos by {how}: {document.get('reason', '')}."]
    parts = [f"It has {document.get('faces', 0):,} triangles".replace(",", "\u202f")]
    if "unseen_share" in document:
        parts.append(f"{100 * document['unseen_share']:.1f} % of its area was seen by no depth map")
    if "boundary_loops" in document:
        loops = document["boundary_loops"]
        parts.append("it is closed" if not loops else f"it ends in {loops} open border{'s' if loops > 1 else ''}")
    sentences.append("; ".join(parts) + ".")
    return sentences


def _measured(scores: GeometryScores) -> list[str]:
    each = ", ".join(f"{score.f_score:.3f} at {100 * score.share:g} %" for score in scores.thresholds)
    sentences = [
        f"Against the true surface {scores.truth} its F-score is {each} of the diagonal ({scores.diagonal:.4g} scene "
        f"units), over the {100 * scores.seen_share:.0f} % of the true surface that two photos see; the median "
        f"distance to the truth is {100 * scores.accuracy_median / scores.diagonal:.3f} % of the diagonal, from the "
        f"truth to it {100 * scores.completeness_median / scores.diagonal:.3f} %."
    ]
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
