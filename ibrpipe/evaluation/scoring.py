"""Views scored by every method, and pictures of those that the report shows."""

from __future__ import annotations

from collections.abc import Collection, Sequence

from ibrpipe.evaluation.compared_methods import ComparedMethods
from ibrpipe.evaluation.held_out import load_truth
from ibrpipe.evaluation.image_scores import covered_pixels, highlight_pixels, score_frame, to_srgb8
from ibrpipe.evaluation.metrics import ViewMetrics
from ibrpipe.evaluation.report.pictures import ViewPictures, draw_view
from ibrpipe.io.views import View
from ibrpipe.progress import track


def score_views(
    methods: ComparedMethods, views: Sequence[View], threshold: int, shown: Collection[str], width: int
) -> tuple[list[ViewMetrics], list[ViewPictures]]:
    """Score every view by every method.

    Parameters
    ----------
    methods : ComparedMethods
    views : sequence of View
    threshold : int
        Least difference from diffuse-only of a highlight pixel, 8-bit codes.
    shown : names of views
        Those that are drawn, too.
    width : int
        Widest picture, pixels.
    """
    scored, pictures = [], []
    for view in track(views, "score"):
        truth = load_truth(view)
        frames = {name: draw(view) for name, draw in {**methods.renderers, **methods.baselines}.items()}
        covered = covered_pixels(frames.values(), truth.mask)
        diffuse = frames["diffuse"].color
        assert diffuse is not None
        highlights = highlight_pixels(truth.color, to_srgb8(diffuse), covered, threshold)
        metrics = ViewMetrics(
            name=view.name,
            mask_pixels=int(truth.mask.sum()),
            covered_pixels=int(covered.sum()),
            highlight_pixels=int(highlights.sum()),
            renderers={name: score_frame(truth, frames[name], highlights, covered) for name in methods.renderers},
            baselines={name: score_frame(truth, frames[name], highlights, covered) for name in methods.baselines},
        )
        scored.append(metrics)
        if view.name in shown:
            pictures.append(draw_view(metrics, truth, frames, highlights, width))
    return scored, pictures
