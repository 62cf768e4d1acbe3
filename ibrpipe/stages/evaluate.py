"""Stage evaluate: held-out views against the render and plain baselines: ``metrics.json`` and ``report.html``."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from time import perf_counter

import numba
from pydantic import Field, ValidationError, field_validator

import ibrpipe
from ibrpipe.capture.photo_set import load_photos
from ibrpipe.config import StageConfig
from ibrpipe.embree import MeshCaster
from ibrpipe.engine.machine import describe_machine
from ibrpipe.engine.stage import Stage, StageOutputs, artifact
from ibrpipe.errors import IbrError
from ibrpipe.evaluation.compared_methods import ComparedMethods, compare_methods
from ibrpipe.evaluation.geometry_scores import GeometryRules, filled_vertices, measure_geometry
from ibrpipe.evaluation.ground_truth import TrueSurface, find_truth, placed_truth
from ibrpipe.evaluation.held_out import not_measured
from ibrpipe.evaluation.metrics import (
    GeometryScores,
    MetricsModel,
    Scores,
    TrainingFit,
    ViewMetrics,
    mean_scores,
    write_metrics,
)
from ibrpipe.evaluation.protocol import make_protocol
from ibrpipe.evaluation.report import ViewPictures, read_sources, write_report
from ibrpipe.evaluation.report.error_pictures import ErrorPictures, draw_errors
from ibrpipe.evaluation.report.surface_pictures import SurfacePictures, draw_surface
from ibrpipe.evaluation.report.words import summary_lines
from ibrpipe.evaluation.scoring import score_views
from ibrpipe.evaluation.sizes import bytes_of, seconds_of, view_dependence_bytes
from ibrpipe.evaluation.timing import time_methods, timed_size
from ibrpipe.io.assets import read_index
from ibrpipe.io.documents.texture_errors import TextureErrors
from ibrpipe.io.frames import read_frames
from ibrpipe.io.surfaces.meshes import read_mesh, read_vertex_values
from ibrpipe.io.views import PHOTOMETRY, ViewSet, read_views, spread
from ibrpipe.stages.embedded_page import embedded_page
from ibrpipe.types import Asset, Camera, Mesh


class EvaluateConfig(StageConfig):
    """Settings of the evaluate stage."""

    highlight_threshold: int = Field(
        default=24, ge=1, le=255, description="Least difference from diffuse-only of a highlight pixel, 8-bit codes"
    )
    timing_width: int = Field(default=640, ge=16, le=16384, description="Width of the timed frames in pixels")
    timing_repeats: int = Field(
        default=7, ge=1, le=1000, description="Timed frames per view and method; the median counts"
    )
    timing_views: int = Field(
        default=4, ge=1, le=1000, description="Views that are timed, spread over the held-out ones"
    )
    timing_seconds: float = Field(
        default=20.0, gt=0, description="Time for all timing; slow methods take fewer turns, s"
    )
    report_views: int = Field(default=8, ge=0, le=1000, description="Views that the report shows in pictures")
    truth: str | None = Field(
        None,
        description="True mesh to measure a reconstructed one against; absent = the capture's own, if withheld, or "
        "truth/mesh.ply in the capture",
    )
    surface_thresholds: tuple[float, ...] = Field(
        (0.0025, 0.005, 0.01), description="Distances of the F-scores, shares of the true surface's diagonal"
    )
    surface_samples: int = Field(60_000, ge=1000, le=10_000_000, description="Points on either surface")
    surface_views: int = Field(3, ge=0, le=100, description="Views of a reconstructed surface that the report shows")
    picture_width: int = Field(default=480, ge=32, le=4096, description="Widest picture in the report in pixels")
    turntable: bool = Field(True, description="Put the object's page into the report, to turn it there")

    @field_validator("truth")
    @classmethod
    def _truth_is_there(cls, truth: str | None) -> str | None:
        if truth is not None and not Path(truth).is_file():  # told before a run has spent minutes
            raise ValueError("there is no such mesh file")
        return truth


@dataclass(frozen=True)
class Inputs:
    """A finished asset, the frames rendered from it, the views and mesh it was made from, and the folder to write to.

    The report also tells of `plan`, `audit` and the manifests in the run folder `run`; None leaves them out.
    `geometry` says how the mesh was made and `dense` holds its depth maps. `given` is the capture's own mesh: the truth
    where `mesh` was made without it; `calibration` tells whether both lie in one world.
    """

    asset: Path
    views: Path
    mesh: Path
    frames: Path
    out: Path
    run: Path | None = None
    given: Path | None = None
    calibration: Path | None = None
    plan: Path | None = None
    audit: Path | None = None
    geometry: Path | None = None
    dense: Path | None = None


@dataclass(frozen=True)
class Outputs(StageOutputs):
    """Figures for machines and a report for people."""

    metrics: Path = artifact("metrics.json", "Figures for machines.", MetricsModel)
    report: Path = artifact("report.html", "Report for people.")


def run(inputs: Inputs, config: EvaluateConfig) -> Outputs:
    """Score the frames of the held-out views beside the baselines, time them, and write figures and report.

    Where no view is held out, the asset is scored on some of the photos it was made from, and the report says what
    could not be measured.

    Raises
    ------
    MissingFileError, FormatError
        An input is missing or damaged.
    """
    began = perf_counter()
    views = read_views(inputs.views)
    frames = read_frames(inputs.frames)
    mesh = read_mesh(inputs.mesh)
    truth, geometry, surfaces = _surface(inputs, config, mesh, views)
    caster = MeshCaster(mesh, threads=numba.get_num_threads())
    asset = ibrpipe.read_asset(inputs.asset)
    methods = compare_methods(asset, frames, caster, load_photos(views.train, caster))
    scored, pictures = _scored(methods, views, config)
    cameras = spread([timed_size(view.camera, config.timing_width) for view in views.shown], config.timing_views)
    speeds = _speeds(time_methods(methods.timed, cameras, config.timing_repeats, config.timing_seconds), cameras)
    tested = scored if views.test else []
    renderers = _means(methods.renderers, [view.renderers for view in tested], speeds)
    metrics = MetricsModel(
        renderer=frames.renderers[0],
        headline="mask" if all(view.masked for view in views.shown) else "covered",
        views=tested,
        mean=renderers[frames.renderers[0]],
        renderers=renderers,
        baselines=_means(methods.baselines, [view.baselines for view in tested], speeds),
        training=None if views.test else _fit(methods, scored, speeds),
        not_measured=not_measured(views),
        geometry=geometry,
        geometry_truth=None if truth is None else truth.told,
        bytes=bytes_of(inputs.asset, views.train, inputs.mesh),
        view_dependence=view_dependence_bytes(inputs.asset),
        seconds={**seconds_of(inputs.run, STAGE.name), STAGE.name: perf_counter() - began},
        machine=describe_machine(),
        protocol=make_protocol(
            cameras[0],
            config.timing_repeats,
            len(cameras),
            config.highlight_threshold,
            frames.samples,
            views.info.get(PHOTOMETRY),
        ),
    )
    outputs = Outputs.below(inputs.out)
    write_metrics(metrics, outputs.metrics)
    told = read_sources(views, inputs.plan, inputs.audit, inputs.geometry)
    errors = _errors(inputs, config, asset, views)
    turntable = embedded_page(asset, told.name, inputs.views, metrics) if config.turntable else None
    write_report(outputs.report, metrics, pictures, told, surfaces, errors, turntable)
    lines = summary_lines(metrics) + ([] if truth is None else _told(truth, geometry))
    (inputs.out / "summary.txt").write_text("\n".join(lines) + "\n", encoding="utf-8")
    return outputs


def _measured(
    inputs: Inputs, config: EvaluateConfig, mesh: Mesh, views: ViewSet
) -> tuple[TrueSurface | None, GeometryScores | None]:
    """Measure the surface where there is a truth; one that nobody named must not cost the report when it is bad."""
    capture = Path(views.info["capture"]) if "capture" in views.info else None
    named = None if config.truth is None else Path(config.truth)
    path = find_truth(named, inputs.given, inputs.geometry, capture)
    if path is None:
        return None, None
    try:
        truth = placed_truth(path, views.train, capture, inputs.calibration)
        if truth.mesh is None:
            return truth, None
        rules = GeometryRules(config.surface_thresholds, config.surface_samples)
        filled = filled_vertices(inputs.mesh)
        return truth, measure_geometry(mesh, truth.mesh, path.name, views.train, inputs.dense, rules, filled)
    except IbrError as error:
        if config.truth is not None:
            raise
        return TrueSurface(path, None, f"The surface was not measured against the true one: {error}"), None


def _surface(
    inputs: Inputs, config: EvaluateConfig, mesh: Mesh, views: ViewSet
) -> tuple[TrueSurface | None, GeometryScores | None, list[SurfacePictures]]:
    """Measure the surface where there is a truth, and draw it where it was made from photos."""
    truth, scores = _measured(inputs, config, mesh, views)
    true = None if truth is None else truth.mesh
    confidence = read_vertex_values(inputs.mesh).get("confidence") if inputs.mesh.suffix == ".ply" else None
    if true is None and confidence is None:
        return truth, None, []
    shown = spread(views.shown, config.surface_views)
    return truth, scores, draw_surface(mesh, shown, config.picture_width, confidence, true)


def _errors(inputs: Inputs, config: EvaluateConfig, asset: Asset, views: ViewSet) -> list[ErrorPictures]:
    """Draw what the asset says of its own errors, if it does."""
    said = [texture.measured.get("error") for texture in read_index(inputs.asset).textures]
    try:
        errors = [TextureErrors.model_validate(each) for each in said]
    except ValidationError:
        return []
    return draw_errors(asset, errors, spread(views.shown, config.surface_views), config.picture_width)


def _told(truth: TrueSurface, scores: GeometryScores | None) -> list[str]:
    """Say in two lines at most what the surface is worth."""
    lines = [truth.told]
    if scores is not None:
        each = ", ".join(f"{score.f_score:.3f} at {100 * score.share:g} %" for score in scores.thresholds)
        lines.append(f"F-score of the surface {each} of the diagonal")
    return lines


def _scored(
    methods: ComparedMethods, views: ViewSet, config: EvaluateConfig
) -> tuple[list[ViewMetrics], list[ViewPictures]]:
    """Score the held-out views, or, where there are none, the asset on some of its own photos, and draw some."""
    if not views.test:  # the photos themselves, blended, would be no comparison
        methods = replace(methods, baselines={"diffuse": methods.baselines["diffuse"]})
    drawn = {view.name for view in spread(views.shown, config.report_views)}
    return score_views(methods, views.shown, config.highlight_threshold, drawn, config.picture_width)


def _means(
    names: Iterable[str], scored: Sequence[Mapping[str, Scores]], speeds: Mapping[str, Mapping[str, float]]
) -> dict[str, Scores]:
    """Return, by method, the means of its scores, as far as it was scored, and its speed."""
    return {
        name: mean_scores([scores[name] for scores in scored if name in scores]).model_copy(update=dict(speeds[name]))
        for name in names
    }


def _fit(methods: ComparedMethods, scored: list[ViewMetrics], speeds: Mapping[str, Mapping[str, float]]) -> TrainingFit:
    return TrainingFit(
        views=scored,
        renderers=_means(methods.renderers, [view.renderers for view in scored], speeds),
        baselines=_means(methods.baselines, [view.baselines for view in scored], speeds),
    )


def _speeds(times: Mapping[str, Sequence[float]], cameras: Sequence[Camera]) -> dict[str, dict[str, float]]:
    """Return, by method, mean milliseconds a frame and millions of pixels a second."""
    pixels = sum(camera.width * camera.height for camera in cameras)
    return {
        name: {"ms_per_frame": sum(taken) / len(taken), "mpix_per_s": pixels / (1e3 * sum(taken))}
        for name, taken in times.items()
    }


STAGE = Stage(
    name="evaluate",
    summary="Score frames of held-out views beside plain baselines; write metrics.json and report.html.",
    inputs=Inputs,
    outputs=Outputs,
    config=EvaluateConfig,
    run=run,
    example="ibrpipe evaluate --out runs/vase",
    folder="report",
)
