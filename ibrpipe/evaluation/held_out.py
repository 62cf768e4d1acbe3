"""Held-out views: what the photos show, and the frames that the render stage made for them."""

from __future__ import annotations

from ibrpipe.errors import CaptureError
from ibrpipe.evaluation.image_scores import MASK_THRESHOLD, Truth, to_srgb8
from ibrpipe.io.views import View, ViewSet, hold_out_advice, load_depth, load_view


def held_out_views(views: ViewSet) -> tuple[View, ...]:
    """Return the views to measure on.

    Raises
    ------
    CaptureError
        None is held out.
    """
    if not views.test:
        raise CaptureError(
            "the capture has no held-out views to measure on; add a test/ folder, or let ingest hold photos out"
        )
    return views.test


def not_measured(views: ViewSet) -> list[str]:
    """Say what cannot be measured on these views, why, and what would help; empty = nothing is missing."""
    count = len(views.train)
    if views.test:
        return []
    every = hold_out_advice(count)
    remedy = "take more photos" if every is None else f"hold some out: --set ingest.hold_out_every={every}"
    return [
        f"How well the asset shows new views was not measured: none of the {count} photos is held out. "
        f"Add views to measure on in a folder test/, or {remedy}."
    ]


def load_truth(view: View) -> Truth:
    """Load what a held-out view shows: 8-bit sRGB, mask, and true depth where the capture has it."""
    color, mask = load_view(view)
    return Truth(to_srgb8(color), mask >= MASK_THRESHOLD, None if view.depth is None else load_depth(view))
