"""A whole run from Python: what ``ibrpipe run`` does, and what came of it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from ibrpipe.capture.pipeline_choice import choose_pipeline
from ibrpipe.compile_progress import compiling_told, line_of
from ibrpipe.engine.artifacts import products
from ibrpipe.engine.event_words import told
from ibrpipe.engine.executor import executor
from ibrpipe.engine.pipeline_file import Pipeline, load_pipeline
from ibrpipe.engine.runner import Event, Run, run_pipeline
from ibrpipe.errors import ConfigError, MissingFileError
from ibrpipe.evaluation.metrics import MetricsModel, Scores, read_metrics
from ibrpipe.io.assets import read_asset
from ibrpipe.progress import Listener
from ibrpipe.stages.registry import load_stages
from ibrpipe.stages.stills import preparation
from ibrpipe.types import Asset


@dataclass(frozen=True, eq=False)
class FinishedRun:
    """What a run has made.

    Attributes
    ----------
    out : Path
        Run folder.
    pipeline : str
        Name of the pipeline.
    seconds : mapping
        Stage to its seconds of work, be it done now or earlier.
    """

    out: Path
    pipeline: str
    seconds: Mapping[str, float]

    @cached_property
    def asset(self) -> Asset:
        """The asset, read when it is first asked for.

        Raises
        ------
        MissingFileError
            The run has ended before that stage.
        """
        return read_asset(self._made("asset"))

    @property
    def report(self) -> Path:
        """The page with pictures and scores; raises as `asset`."""
        return self._made("report")

    @cached_property
    def metrics(self) -> MetricsModel:
        """All figures of ``metrics.json``; raises as `asset`."""
        return read_metrics(self._made("metrics"))

    @property
    def scores(self) -> Scores:
        """Mean over the held-out views; where there are none, over photos that made the asset. Raises as `asset`."""
        known = self.metrics
        if known.training is not None and not known.views:
            return known.training.renderers[known.renderer]
        return known.mean

    def _made(self, name: str) -> Path:
        source = products(load_stages())[name]
        path = self.out / source.path
        if source.stage.name not in self.seconds or not path.exists():
            raise MissingFileError(f"{path}: the run has not come to stage {source.stage.name}; run it to there")
        return path

    def __repr__(self) -> str:
        return f"FinishedRun({str(self.out)!r}, pipeline {self.pipeline}, {len(self.seconds)} stages)"


def run(
    capture: Path | str | None = None,
    out: Path | str = "out",
    pipeline: Path | str | None = None,
    settings: Mapping[str, Any] | None = None,
    *,
    first: str | None = None,
    last: str | None = None,
    force: bool = False,
    workers: int = 0,
    dask: str | None = None,
    progress: Callable[[str], None] | None = None,
) -> FinishedRun:
    """Make an asset of photos and measure it; stages that are up to date are skipped.

    Parameters
    ----------
    capture : Path or str, optional
        Capture folder, or a video; by default that of the run that `out` holds.
    out : Path or str
        Run folder.
    pipeline : Path or str, optional
        A file or the name of a pipeline; by default what suits the capture: photos, calibrated or mesh.
    settings : mapping, optional
        What replaces the pipeline's: ``{"plan.k": 0.0625, "ingest": {"hold_out_every": 5}}``.
    first, last : str, optional
        Stages to begin and end with; earlier results are taken as they are.
    force : bool
        Run the stages even where nothing changed.
    workers : int
        Threads to use; 0 = all cores. The result is the same for any number.
    dask : str, optional
        Address of a Dask scheduler that takes the work units.
    progress : callable, optional
        Called with a line of text when a stage starts or ends, such as ``print``.

    Returns
    -------
    FinishedRun

    Raises
    ------
    IbrError
        As raised by a stage; what earlier stages have made stays.
    """
    given = None if capture is None else Path(capture)
    values = _flat(settings or {})
    if pipeline is None:
        if given is None:
            raise ConfigError("neither a capture nor a pipeline is given; give at least one of them")
        pipeline, why = suited_pipeline(given, loaded_with("photos", values))
        if progress is not None:
            progress(f"{given}: {why}: pipeline {pipeline}")
    chosen = loaded_with(pipeline, values)
    asked = asked_run(chosen, Path(out), given, first, last, force)

    def report(event: Event) -> None:
        if progress is not None:
            progress(told(event))

    with executor(workers, dask), compiling_told(None if progress is None else _lines(progress)):
        done = run_pipeline(asked, load_stages(), report)
    return FinishedRun(Path(out), chosen.name, {name: manifest.seconds for name, manifest in done.items()})


def _lines(progress: Callable[[str], None]) -> Listener:
    return lambda label, done, total: progress(line_of(label, done, total))


def loaded_with(pipeline: Path | str, values: Mapping[str, Any]) -> Pipeline:
    """Return a pipeline, by file or name, with values of ``stage.key`` in place."""
    return load_pipeline(Path(pipeline), load_stages(), values=values)


def suited_pipeline(capture: Path, usual: Pipeline) -> tuple[str, str]:
    """Return the name of the pipeline for a capture, and why; settings of `usual` say what it may consist of."""
    ingest: Any = usual.configs["ingest"]
    return choose_pipeline(capture, ingest.allow_outside)


def asked_run(
    pipeline: Pipeline, out: Path, capture: Path | None, first: str | None, last: str | None, force: bool
) -> Run:
    """Return what the runner is asked to do, videos included."""
    ingest: Any = pipeline.configs["ingest"]
    return Run(pipeline, out, capture, first, last, force, preparation(out, ingest.video_frames))


def _flat(settings: Mapping[str, Any]) -> dict[str, Any]:
    """Return settings as ``stage.key`` to value, be they written so or a mapping for every stage."""
    flat: dict[str, Any] = {}
    for name, value in settings.items():
        inner = isinstance(value, Mapping) and "." not in name
        flat.update({f"{name}.{key}": each for key, each in value.items()} if inner else {name: value})
    return flat
