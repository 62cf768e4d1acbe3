"""Run stages in order: skip what is up to date, write whole folders only, and record what ran."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ibrpipe.config import StageConfig
from ibrpipe.engine.artifacts import check_capture, files_named, hashes, input_fields, needs, wire
from ibrpipe.engine.pipeline_file import Pipeline
from ibrpipe.engine.provenance import code_digest, measured, versions
from ibrpipe.engine.run_document import RunDocument
from ibrpipe.engine.run_folder import files_with_sizes, only_run, whole_folder
from ibrpipe.engine.stage import Stage
from ibrpipe.errors import ConfigError, ResourceError, closest
from ibrpipe.interruption import stop_if_asked
from ibrpipe.io.manifest import (
    NAME,
    RUN_NAME,
    Hasher,
    Manifest,
    difference,
    digest,
    read_manifest,
    write_manifest,
    write_text,
)


@dataclass(frozen=True)
class Event:
    """What happens to a stage.

    Attributes
    ----------
    stage : str
    kind : str
        "starts" (`text` says why), "done" (`manifest` says the cost, `text` what came of it) or "skipped".
    position : tuple of int or None
        Which stage it is of how many that were asked for, (k, n); None = it was asked for alone.
    """

    stage: str
    kind: str
    text: str = ""
    manifest: Manifest | None = None
    position: tuple[int, int] | None = None


Report = Callable[[Event], None]
_HASHES = ".hashes.json"


def _silent(event: Event) -> None:
    """Ignore `event`."""


@dataclass(frozen=True)
class Job:
    """One stage with everything it needs.

    Attributes
    ----------
    stage : Stage
    fields : mapping
        The inputs, name to value, without `out`.
    config : StageConfig
    target : Path
        Folder that the stage fills.
    upstream : mapping
        Stage whose output is read to the key of its manifest.
    """

    stage: Stage
    fields: Mapping[str, Any]
    config: StageConfig
    target: Path
    upstream: Mapping[str, str] = dataclasses.field(default_factory=dict)


def run_job(job: Job, hasher: Hasher, force: bool = False, report: Report = _silent) -> Manifest:
    """Run one stage unless its last result still holds; return its manifest.

    Raises
    ------
    IbrError
        As raised by the stage; an earlier result then stays as it was.
    ResourceError
        The target holds files that are not ours.
    """
    identity = _identity(job, hasher)
    known = read_manifest(job.target)
    why = difference(known, identity, job.target)
    if known is not None and why is None and not force:
        report(Event(job.stage.name, "skipped", manifest=known))
        return known
    _refuse_foreign(job.target)
    report(Event(job.stage.name, "starts", why or "forced"))
    with whole_folder(job.target) as folder:
        with measured() as cost:
            job.stage.run(job.stage.inputs(**job.fields, out=folder), job.config)
        stop_if_asked()
        manifest = Manifest(
            **identity,
            stage=job.stage.name,
            files=files_with_sizes(folder),
            seconds=cost.seconds,
            peak_memory_bytes=cost.peak_memory_bytes,
        )
        write_manifest(folder, manifest)
    report(Event(job.stage.name, "done", _summary(job.target), manifest))
    return manifest


def _summary(folder: Path) -> str:
    """Return what a stage has left to be told in its ``summary.txt``, if any."""
    path = folder / "summary.txt"
    return path.read_text(encoding="utf-8").strip() if path.is_file() else ""


def _identity(job: Job, hasher: Hasher) -> dict[str, Any]:
    """Return all that decides the result, and its hash as ``key``."""
    config = job.config.model_dump(mode="json")
    identity: dict[str, Any] = {
        "config": config,
        "inputs": {**hashes(job.fields, hasher, job.target.parent), **files_named(config, hasher)},
        "upstream": dict(job.upstream),
        "code": code_digest(job.stage.run.__module__),
        "versions": versions(),
    }
    return {**identity, "key": digest([job.stage.name, identity])}


def _refuse_foreign(target: Path) -> None:
    if not target.exists():
        return
    if not target.is_dir():
        raise ResourceError(f"{target} is a file, but a folder is to be written there; choose another --out")
    if any(target.iterdir()) and not (target / NAME).is_file():
        raise ResourceError(
            f"{target} holds files that ibrpipe did not write; they would be lost: choose another --out or empty it"
        )


@dataclass(frozen=True)
class Run:
    """What `run_pipeline` is asked to do.

    Attributes
    ----------
    pipeline : Pipeline
    out : Path
        Run folder.
    capture : Path or None
        Capture folder; None = the one of the run that is already there.
    first, last : str or None
        Stages to begin and end with. Earlier results are taken as they are.
    force : bool
        Run the chosen stages even where nothing changed.
    prepare : callable or None
        Returns the folder of photos that stands for what `capture` names, such as a video; it says itself what is
        wrong with it. None = a capture is a folder of photos.
    """

    pipeline: Pipeline
    out: Path
    capture: Path | None = None
    first: str | None = None
    last: str | None = None
    force: bool = False
    prepare: Callable[[Path, Hasher, Report], Path] | None = None


def run_pipeline(run: Run, stages: Sequence[Stage], report: Report = _silent) -> dict[str, Manifest]:
    """Run the stages that are out of date, in order; return the manifests of the chosen ones, by stage.

    Raises
    ------
    IbrError
        As raised by a stage. The results of the stages before it stay, and the next run goes on from there.
    """
    chosen = _chosen(run, stages)
    if run.capture is not None and not (run.prepare and run.capture.is_file()):
        check_capture(run.capture)
    fresh, done = not run.out.exists(), dict[str, Manifest]()
    try:
        _run_chosen(run, stages, chosen, done, report)
    except BaseException:
        if fresh and not done:
            _remove_bare(run.out)
        raise
    return done


def _run_chosen(
    run: Run, stages: Sequence[Stage], chosen: Sequence[Stage], done: dict[str, Manifest], report: Report
) -> None:
    """Run stages in order; `done` takes the manifest of each."""
    with only_run(run.out):
        capture = run.capture or recorded_capture(run.out)
        _record(run, capture)
        hasher = Hasher(run.out / _HASHES)
        try:
            if run.prepare is not None and capture is not None and _reads_capture(chosen):
                capture = run.prepare(capture, hasher, report)
            for number, stage in enumerate(chosen, 1):
                fields = wire(stage, stages, run.out, capture, run.pipeline.seed)
                config = run.pipeline.configs[stage.name]
                job = Job(stage, fields, config, run.out / stage.folder, upstream_keys(stage, stages, run.out))
                done[stage.name] = run_job(job, hasher, run.force, _counted(report, number, len(chosen)))
        finally:
            hasher.remember()


def _reads_capture(stages: Sequence[Stage]) -> bool:
    return any("capture" in input_fields(stage) for stage in stages)


def _remove_bare(out: Path) -> None:
    """Remove a run folder that holds no work: nothing but what every run notes first."""
    notes = (out / RUN_NAME, out / _HASHES)
    if out.is_dir() and not set(out.iterdir()) - set(notes):
        for note in notes:
            note.unlink(missing_ok=True)
        out.rmdir()


def _counted(report: Report, number: int, count: int) -> Report:
    """Return a report that also tells which stage of how many it is about."""
    return lambda event: report(dataclasses.replace(event, position=(number, count)))


def _chosen(run: Run, stages: Sequence[Stage]) -> list[Stage]:
    names = [stage.name for stage in stages]
    for option, name in (("--from", run.first), ("--until", run.last)):
        if name is not None and name not in names:
            raise ConfigError(f"{option} {name}: there is no such stage; {closest(name, names)}")
    first = names.index(run.first) if run.first else 0
    last = names.index(run.last) if run.last else len(names) - 1
    if first > last:
        raise ConfigError(f"--from {run.first} comes after --until {run.last}; the order is {', '.join(names)}")
    return list(stages[first : last + 1])


def upstream_keys(stage: Stage, stages: Sequence[Stage], out: Path) -> dict[str, str]:
    """Return the keys of the results that `stage` reads."""
    folders = {each.name: each.folder for each in stages}
    read = [name for name in needs(stage, stages) if name in folders]
    known = {name: read_manifest(out / folders[name]) for name in read}
    return {name: manifest.key for name, manifest in known.items() if manifest is not None}


def _record(run: Run, capture: Path | None) -> None:
    settings = {name: config.model_dump(mode="json") for name, config in run.pipeline.configs.items()}
    record = RunDocument(
        pipeline=run.pipeline.name,
        seed=run.pipeline.seed,
        capture=None if capture is None else str(capture.resolve()),
        settings=settings,
    )
    write_text(run.out / RUN_NAME, record.to_json(2) + "\n")


def recorded_capture(out: Path) -> Path | None:
    """Return the capture folder of the run that `out` holds, if any."""
    try:
        known = RunDocument.model_validate_json((out / RUN_NAME).read_bytes())
    except (OSError, ValueError):
        return None
    return None if known.capture is None else Path(known.capture)
