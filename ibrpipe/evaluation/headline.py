"""Which figures a verdict is spoken by: over the mask, or inside what the methods cover; of new views or of photos.

Where photos have masks, the mask says what is to be shown, and what a render leaves out counts as black. Where they
have none, sky and walls that no method knows would drown everything else: the figures inside what all methods cover
come first then, with the coverage beside them.
"""

from __future__ import annotations

from dataclasses import dataclass

from ibrpipe.evaluation.metrics import MetricsModel, Scores, ViewMetrics


@dataclass(frozen=True)
class Likeness:
    """PSNR in dB, SSIM and FLIP over one set of pixels; None = unknown."""

    psnr: float | None
    ssim: float | None
    flip: float | None


def headline(metrics: MetricsModel, scores: Scores) -> Likeness:
    """Return the figures to judge `scores` by."""
    return _covered(scores) if metrics.headline == "covered" else _masked(scores)


def second(metrics: MetricsModel, scores: Scores) -> Likeness:
    """Return the same over the other set of pixels."""
    return _masked(scores) if metrics.headline == "covered" else _covered(scores)


@dataclass(frozen=True)
class Judged:
    """What the verdict speaks of: the held-out views, or the photos themselves where there are none (`new` False)."""

    views: list[ViewMetrics]
    renderers: dict[str, Scores]
    baselines: dict[str, Scores]
    new: bool

    @property
    def covered_share(self) -> float:
        """Share of the mask's pixels that all methods cover, over all views."""
        covered = sum(view.mask_pixels if view.covered_pixels is None else view.covered_pixels for view in self.views)
        return covered / max(sum(view.mask_pixels for view in self.views), 1)

    @property
    def highlight_share(self) -> float:
        """Share of the covered pixels that count as highlights, over all views."""
        covered = self.covered_share * sum(view.mask_pixels for view in self.views)
        return sum(view.highlight_pixels for view in self.views) / max(covered, 1)


def judged(metrics: MetricsModel) -> Judged:
    """Return what the verdict speaks of."""
    fit = metrics.training
    if metrics.views or fit is None:
        return Judged(metrics.views, metrics.renderers, metrics.baselines, new=True)
    return Judged(fit.views, fit.renderers, fit.baselines, new=False)


def _masked(scores: Scores) -> Likeness:
    return Likeness(scores.psnr, scores.ssim, scores.flip)


def _covered(scores: Scores) -> Likeness:
    return Likeness(scores.psnr_covered, scores.ssim_covered, scores.flip_covered)
