"""What ``metrics.json`` holds: the verdict of a run, view by view and in the mean."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Literal

from pydantic import Field

from ibrpipe.config import Document
from ibrpipe.engine.machine import Machine

SCHEMA_VERSION = 1


class Scores(Document):
    """Error and speed of one method of rendering, in one view or in the mean over the views."""

    psnr: float | None = Field(description="dB over the mask, 8-bit sRGB; 100 = no pixel differs")
    ssim: float | None = Field(description="Structural similarity, mean of the map over the mask; 1 = equal")
    flip: float | None = Field(description="LDR-FLIP, mean of the map over the mask; 0 = no visible difference")
    depth_rmse: float | None = Field(
        default=None, description="Scene units along camera z over mask pixels hit in truth and render; null = no truth"
    )
    depth_median: float | None = Field(default=None, description="Median absolute depth error over the same pixels")
    coverage: float | None = Field(description="Share of the mask's pixels that are rendered, 0..1")
    psnr_covered: float | None = Field(default=None, description="As psnr, over the pixels that all methods cover")
    ssim_covered: float | None = Field(default=None, description="As ssim, over the pixels that all methods cover")
    flip_covered: float | None = Field(default=None, description="As flip, over the pixels that all methods cover")
    psnr_highlight: float | None = Field(default=None, description="dB over highlight pixels alone; null = none")
    psnr_rest: float | None = Field(default=None, description="dB over the other covered pixels; null = none")
    ms_per_frame: float | None = Field(default=None, description="Median milliseconds of a frame at the timing size")
    mpix_per_s: float | None = Field(default=None, description="Millions of pixels a second at the timing size")


class ViewMetrics(Document):
    """Scores of one held-out view."""

    name: str = Field(description="The view's name, as in the capture")
    mask_pixels: int = Field(description="Pixels with mask coverage of at least one half; all without a mask")
    covered_pixels: int | None = Field(
        default=None, description="Mask pixels that all renderers and baselines cover; null = not counted"
    )
    highlight_pixels: int = Field(description="Covered pixels whose truth is far from the diffuse-only picture")
    renderers: dict[str, Scores] = Field(description="By renderer")
    baselines: dict[str, Scores] = Field(description="By baseline")


class TrainingFit(Document):
    """How the asset shows photos that it was made from; nothing is said of new views."""

    views: list[ViewMetrics] = Field(description="Training photos, evenly spread; baselines: diffuse alone")
    renderers: dict[str, Scores] = Field(description="Mean over them by renderer")
    baselines: dict[str, Scores] = Field(description="Mean over them by baseline; of others their times")


class ThresholdScores(Document):
    """Shares of two surfaces that lie within a distance of each other."""

    share: float = Field(description="The distance as a share of the true surface's diagonal")
    distance: float = Field(description="The distance in scene units")
    precision: float = Field(description="Share of the reconstruction near the truth, 0..1")
    recall: float = Field(description="Share of the truth near the reconstruction, 0..1")
    f_score: float = Field(description="Harmonic mean of both")
    f_score_seen: float | None = Field(
        default=None,
        description="Harmonic mean with the precision of what depth maps show alone; null = the mesh does not tell",
    )


class DepthScores(Document):
    """Error of the depth maps that the surface was made from, along the cameras' axes."""

    maps: int = Field(description="Depth maps")
    known: float = Field(description="Share of the true surface's pixels that have depth")
    rmse: float = Field(description="Root mean square over pixels with depth, scene units")
    median: float = Field(description="Median absolute error, scene units")
    bad_shares: list[float] = Field(description="Shares of the pixels with depth that err by more than each threshold")


class GeometryScores(Document):
    """Error of a surface that was made from photos, over what at least two photos see."""

    truth: str = Field(description="File name of the true mesh")
    diagonal: float = Field(description="Of the true surface's bounding box, scene units")
    samples: int = Field(description="Points on either surface")
    seen_share: float = Field(description="Share of the true surface that at least two photos see")
    accuracy_mean: float = Field(description="Mean distance from the reconstruction to the truth, scene units")
    accuracy_median: float = Field(description="Median of the same")
    completeness_mean: float = Field(description="Mean distance from the truth to the reconstruction, scene units")
    completeness_median: float = Field(description="Median of the same")
    thresholds: list[ThresholdScores] = Field(description="By distance")
    depth: DepthScores | None = Field(default=None, description="Of the depth maps; null = none were kept")


class Protocol(Document):
    """How the figures were taken; `lines` say the same in words."""

    mask_threshold: float = Field(description="Least mask coverage of a pixel that counts")
    highlight_threshold: int = Field(description="Least difference of truth and diffuse-only, in 8-bit codes")
    ssim_window: str = Field(description="Window of SSIM")
    flip_ppd: float = Field(description="Pixels per degree that FLIP assumes")
    psnr_cap: float = Field(description="dB stated for equal pictures")
    timing_width: int = Field(description="Width of the timed frames in pixels")
    timing_height: int = Field(description="Height of the timed frames of the first view in pixels")
    timing_repeats: int = Field(description="Timed frames for each view and method; the median counts")
    timing_views: int = Field(description="Views that were timed")
    threads: int = Field(description="Threads that every timed method may use")
    lines: list[str] = Field(description="The protocol in sentences, as the report prints it")


class MetricsModel(Document):
    """The whole of ``metrics.json``."""

    schema_version: int = Field(default=SCHEMA_VERSION, description="Version of this layout")
    renderer: str = Field(description="The renderer that `mean` speaks of")
    headline: Literal["mask", "covered"] = Field(
        default="mask",
        description="Figures to judge by: psnr, ssim, flip over the masks; or, where photos have no mask and show more "
        "than there is surface, psnr_covered, ssim_covered, flip_covered, beside coverage",
    )
    views: list[ViewMetrics] = Field(description="Held-out views in the capture's order; none: nothing is held out")
    mean: Scores = Field(description="Mean over the views of the first renderer")
    renderers: dict[str, Scores] = Field(description="Mean over the views by renderer")
    baselines: dict[str, Scores] = Field(description="Mean over the views by baseline: diffuse, ulr, mesh")
    training: TrainingFit | None = Field(
        default=None, description="Where nothing is held out: the fit to the photos themselves; null = not needed"
    )
    not_measured: list[str] = Field(default=[], description="What could not be measured, why, and the remedy")
    geometry: GeometryScores | None = Field(
        default=None, description="Error of the surface; null = it was given, or no true mesh is known"
    )
    geometry_truth: str | None = Field(
        default=None,
        description="Where the true surface comes from and how it was placed, or why nothing was measured; null = none",
    )
    bytes: dict[str, int] = Field(description="Sizes on disk: asset and its parts, photos, masks, mesh")
    view_dependence: dict[str, int] = Field(
        default={}, description="Sizes on disk of every kind of view dependence, together the residuals of `bytes`"
    )
    seconds: dict[str, float] = Field(description="Seconds by stage, from the stages' manifests")
    machine: Machine
    protocol: Protocol


def mean_scores(scores: Sequence[Scores]) -> Scores:
    """Return the mean of every figure over the views that have it; None where no view has it."""
    means: dict[str, float | None] = {}
    for field in Scores.model_fields:
        values = [value for value in (getattr(score, field) for score in scores) if value is not None]
        means[field] = sum(values) / len(values) if values else None
    return Scores(**means)


def write_metrics(metrics: MetricsModel, path: Path) -> None:
    """Write ``metrics.json``: UTF-8, two spaces, keys in the order of the model."""
    path.write_text(json.dumps(metrics.model_dump(mode="json"), indent=2, ensure_ascii=False) + "\n", encoding="utf-8")


def read_metrics(path: Path) -> MetricsModel:
    """Read a ``metrics.json``; unknown keys and wrong types are errors."""
    return MetricsModel.read(Path(path), "is no list of scores", "evaluate")
