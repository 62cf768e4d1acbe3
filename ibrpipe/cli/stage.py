"""Every stage as a command, made of its `Stage` object."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import click

from ibrpipe.cli.options import (
    PATH,
    config_options,
    dask_option,
    example,
    given,
    json_option,
    out_option,
    workers_option,
)
from ibrpipe.cli.show import display
from ibrpipe.engine.artifacts import GIVEN, Source, input_fields, paths_below, sources
from ibrpipe.engine.event_words import told
from ibrpipe.engine.executor import executor
from ibrpipe.engine.run_folder import only_run
from ibrpipe.engine.runner import Job, run_job, upstream_keys
from ibrpipe.engine.stage import Stage
from ibrpipe.errors import ConfigError, MissingFileError
from ibrpipe.io.manifest import Hasher, Manifest
from ibrpipe.io.yaml_settings import Key, Settings, validated
from ibrpipe.stages.registry import load_stage, load_stages, registered


def stage_command(stage: Stage, stages: Sequence[Stage] | None = None) -> click.Command:
    """Return the command that runs `stage` of `stages`: its inputs, its settings, and the shared options."""
    everyone = load_stages() if stages is None else stages
    known = sources(stage, everyone)
    params: list[click.Parameter] = _input_params(stage, known)
    params.append(out_option(f"Run folder; {stage.folder} in it is written."))
    params += [*config_options(stage.config), workers_option, dask_option, json_option]

    def callback(**values: Any) -> None:
        ctx = click.get_current_context()
        config = stage_config(stage, given(ctx, lambda name: name in stage.config.model_fields))
        manifest = run_stage(stage, everyone, config, values, values["out"] / stage.folder)
        if values["as_json"]:
            click.echo(json.dumps(manifest.model_dump(mode="json"), indent=2))

    return click.Command(
        stage.name, callback=callback, params=params, help=stage.summary, epilog=example(stage.example)
    )


def _input_params(stage: Stage, known: Mapping[str, Source]) -> list[click.Parameter]:
    params: list[click.Parameter] = []
    names = input_fields(stage)
    if "capture" in names:
        params.append(click.Argument(["capture"], type=PATH))
    for name in names:
        if name in known:
            text = f"{known[name].artifact.meaning}  [default: {known[name].path} in the run folder]"
            params.append(click.Option([f"--{name}"], type=PATH, metavar="PATH", help=text))
    if "seed" in names:
        params.append(click.Option(["--seed"], type=click.IntRange(0), default=0, help=GIVEN["seed"]))
    return params


def stage_config(stage: Stage, values: dict[str, Any]) -> Any:
    """Return the settings of a stage that were given as options; a wrong one is a wrong call."""
    places: dict[Key, str] = {(name,): f"--{name.replace('_', '-')}" for name in values}
    try:
        return validated(stage.config, Settings(values, {(): "settings"} | places))
    except ConfigError as error:
        raise click.UsageError(str(error)) from error


def run_stage(stage: Stage, stages: Sequence[Stage], config: Any, values: dict[str, Any], target: Path) -> Manifest:
    """Run one of `stages` on what was given on the command line; it fills the folder `target`."""
    out: Path = values["out"]
    places = {**paths_below(out, sources(stage, stages)), "run": out}
    fields = {name: _input(stage, name, required, values, places) for name, required in input_fields(stage).items()}
    fields = {name: value for name, value in fields.items() if value is not None}
    job = Job(stage, fields, config, target, upstream_keys(stage, stages, out))
    with executor(values["workers"], values["dask"]), display() as shown, only_run(out):
        return run_job(job, Hasher(), force=True, report=lambda event: shown.say(told(event)))


def _input(stage: Stage, name: str, required: bool, values: dict[str, Any], places: Mapping[str, Path]) -> Any:
    """Return one input: as given, else from its place in the run folder."""
    given_value = values.get(name)
    if name == "seed":
        return given_value
    path = given_value or places.get(name)
    if path is None or path.exists():
        return path
    if given_value is not None:
        raise MissingFileError(f"{path} does not exist; stage {stage.name} needs it as {name}")
    if required:
        raise MissingFileError(
            f"stage {stage.name} needs {path}, which does not exist; run the earlier stages first or give --{name}"
        )
    return None


def __getattr__(name: str) -> click.Command:
    """Make the command of a stage when it is first asked for."""
    if name not in registered():
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return stage_command(load_stage(name))
