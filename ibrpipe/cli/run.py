"""``ibrpipe run``: a pipeline file, from photos to the report."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import click

from ibrpipe.cli.completion import pipeline_settings, pipelines_or_files
from ibrpipe.cli.options import dask_option, example, json_option, workers_option
from ibrpipe.cli.show import display
from ibrpipe.engine.artifacts import products
from ibrpipe.engine.event_words import duration, told
from ibrpipe.engine.executor import executor
from ibrpipe.engine.pipeline_file import Pipeline, load_pipeline, packaged_pipelines
from ibrpipe.engine.runner import Run, run_pipeline
from ibrpipe.errors import ConfigError, MissingFileError, closest
from ibrpipe.evaluation.metrics import read_metrics
from ibrpipe.io.manifest import Manifest
from ibrpipe.io.videos.read import is_video
from ibrpipe.stages.registry import load_stages, registered
from ibrpipe.stages.whole_run import asked_run, suited_pipeline

_PATH = click.Path(path_type=Path)


@click.command(
    name="run",
    epilog=example(
        "ibrpipe run photos-of-vase --out out",
        "ibrpipe run clip.mp4 --out out --set ingest.video_frames=80",
        "ibrpipe run pipelines/mesh.yaml --capture photos --out out",
        "ibrpipe run mesh --out out --from residuals --set residuals.k=0.0625",
    ),
)
@click.argument("what", metavar="CAPTURE|PIPELINE", shell_complete=pipelines_or_files)
@click.option("--capture", type=_PATH, metavar="DIR", help="Capture folder; needed the first time.")
@click.option("--out", type=_PATH, metavar="DIR", default="out", show_default=True, help="Run folder.")
@click.option(
    "--set",
    "changes",
    multiple=True,
    metavar="STAGE.KEY=VALUE",
    help="Replace a setting; may be repeated.",
    shell_complete=pipeline_settings,
)
@click.option(
    "--from", "first", type=click.Choice(list(registered())), help="Begin here; earlier results are taken as they are."
)
@click.option("--until", "last", type=click.Choice(list(registered())), help="End after this stage.")
@click.option("--force", is_flag=True, help="Run the stages even where nothing changed.")
@click.pass_context
def command(
    ctx: click.Context,
    what: str,
    capture: Path | None,
    out: Path,
    changes: tuple[str, ...],
    first: str | None,
    last: str | None,
    force: bool,
    **shared: Any,
) -> None:
    """Run a pipeline on the photos of CAPTURE, a folder: photos, calibrated or mesh, by what the folder holds.

    CAPTURE may be a video, or hold some: the sharpest frame of every step of the camera is taken as a photo
    (ingest.video_frames says how many).

    Or run PIPELINE, a file or the name of one that comes with ibrpipe, on the folder that --capture names. A name of a
    pipeline comes before a folder of that name: write ./mesh for the folder.

    Stages whose settings, inputs and code have not changed are skipped, so a run that was stopped goes on where it was.
    """
    pipeline = Path(what)
    if capture is None and _is_capture(what):
        pipeline, capture = _chosen(Path(what), changes), Path(what)
    loaded = _loaded(pipeline, changes)
    done = run_shown(asked_run(loaded, out, capture, first, last, force), shared["workers"], shared["dask"])
    if shared["as_json"]:
        click.echo(json.dumps(summary(out, done), indent=2))
    else:
        click.echo(f"{out}: {len(done)} stages, {duration(sum(each.seconds for each in done.values()))} of work")
        warned = _warnings(out, done)
        if warned:
            click.echo(warned)
        report = _fresh("report", out, done)
        if report is not None:
            click.echo(f"report: {report}")


command.params += [workers_option, dask_option, json_option]


def _is_capture(what: str) -> bool:
    """Say whether a folder or a video is meant; other files, and bare names of packaged pipelines, are pipelines.

    Raises
    ------
    MissingFileError
        It is nothing of the kind.
    """
    known = packaged_pipelines()
    if not Path(what).exists() and Path(what).stem not in known:
        advice = closest(Path(what).stem, known)
        raise MissingFileError(f"{what}: there is no such folder of photos, video, or pipeline; of pipelines, {advice}")
    return is_video(Path(what)) or (Path(what).is_dir() and what not in known)


def _chosen(capture: Path, changes: tuple[str, ...]) -> Path:
    """Return the name of the pipeline for a capture, and tell it on stderr."""
    name, why = suited_pipeline(capture, _loaded(Path("photos"), changes))
    click.echo(f"{capture}: {why}: pipeline {name}", err=True)
    return Path(name)


def _loaded(path: Path, changes: tuple[str, ...]) -> Pipeline:
    """Load the pipeline; a wrong --set is a wrong use of the command."""
    try:
        return load_pipeline(path, load_stages(), changes)
    except ConfigError as error:
        if str(error).startswith("--set"):
            raise click.UsageError(str(error)) from error
        raise


def run_shown(run: Run, workers: int, dask: str | None) -> dict[str, Manifest]:
    """Run a pipeline and show what happens."""
    with executor(workers, dask), display() as shown:
        return run_pipeline(run, load_stages(), lambda event: shown.say(told(event)))


def summary(out: Path, done: dict[str, Manifest]) -> dict[str, Any]:
    """Return the cost of every stage, and the mean scores if they were made."""
    stages = {
        name: {
            "seconds": manifest.seconds,
            "peak_memory_bytes": manifest.peak_memory_bytes,
            "bytes": sum(manifest.files.values()),
        }
        for name, manifest in done.items()
    }
    metrics = _fresh("metrics", out, done)
    mean = None if metrics is None else read_metrics(metrics).mean.model_dump(mode="json")
    return {"out": str(out), "stages": stages, "mean": mean}


def _warnings(out: Path, done: Mapping[str, Manifest]) -> str:
    """Return how many warnings the audit of the capture holds, and where; empty = none."""
    text = _fresh("audit_text", out, done)
    count = 0 if text is None else text.read_text(encoding="utf-8").count("\nwarning ")
    return f"warnings about the capture: {count}, in {text}" if count else ""


def _fresh(name: str, out: Path, done: Mapping[str, Manifest]) -> Path | None:
    """Return the artifact called `name` where its stage was among those done."""
    source = products(load_stages())[name]
    return out / source.path if source.stage.name in done and (out / source.path).exists() else None
