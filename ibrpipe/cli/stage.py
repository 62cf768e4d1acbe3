"""Every stage as a command, made of its `Stage` object."""

from __future__ import annotations

import json
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
from ibrpipe.cli.show import display, told
from ibrpipe.engine.artifacts import MEANING, PLACES, input_fields
from ibrpipe.engine.executor import executor
from ibrpipe.engine.run_folder import only_run
from ibrpipe.engine.runner import Job, run_job
from ibrpipe.engine.stage import Stage
from ibrpipe.engine.yaml_settings import Key, Settings, validated
from ibrpipe.errors import ConfigError, MissingFileError
from ibrpipe.io.manifest import Hasher, Manifest, read_manifest
from ibrpipe.stages.registry import STAGES, load_stage


def stage_command(stage: Stage) -> click.Command:
    """Return the command that runs `stage`: its inputs, its settings, and the shared options."""
    params: list[click.Parameter] = [*_input_params(stage), out_option(f"Run folder; {stage.place} in it is written.")]
    params += [*config_options(stage.config), workers_option, dask_option, json_option]

    def callback(**values: Any) -> None:
        ctx = click.get_current_context()
        config = _config(stage, given(ctx, lambda name: name in stage.config.model_fields))
        manifest = _run(stage, config, values)
        if values["as_json"]:
            click.echo(json.dumps(manifest.model_dump(mode="json"), indent=2))

    return click.Command(
        stage.name, callback=callback, params=params, help=stage.summary, epilog=example(stage.example)
    )


def _input_params(stage: Stage) -> list[click.Parameter]:
    params: list[click.Parameter] = []
    names = input_fields(stage)
    if "capture" in names:
        params.append(click.Argument(["capture"], type=PATH))
    for name in names:
        if name not in ("capture", "seed", "run"):
            text = f"{MEANING[name]}  [default: {PLACES[name]} in the run folder]"
            params.append(click.Option([f"--{name}"], type=PATH, metavar="PATH", help=text))
    if "seed" in names:
        params.append(click.Option(["--seed"], type=click.IntRange(0), default=0, help=MEANING["seed"]))
    return params


def _config(stage: Stage, values: dict[str, Any]) -> Any:
    places: dict[Key, str] = {(name,): f"--{name.replace('_', '-')}" for name in values}
    try:
        return validated(stage.config, Settings(values, {(): "settings"} | places))
    except ConfigError as error:
        raise click.UsageError(str(error)) from error


def _run(stage: Stage, config: Any, values: dict[str, Any]) -> Manifest:
    out: Path = values["out"]
    fields = {name: _input(stage, name, required, values) for name, required in input_fields(stage).items()}
    fields = {name: value for name, value in fields.items() if value is not None}
    job = Job(stage, fields, config, out / stage.place, _keys(stage, out))
    with executor(values["workers"], values["dask"]), display() as shown, only_run(out):
        return run_job(job, Hasher(), force=True, report=lambda event: shown.say(told(event)))


def _input(stage: Stage, name: str, required: bool, values: dict[str, Any]) -> Any:
    """Return one input: as given, else from its place in the run folder."""
    given_value = values.get(name)
    if name == "seed":
        return given_value
    path: Path = given_value or values["out"] / PLACES[name]
    if path.exists():
        return path
    if given_value is not None:
        raise MissingFileError(f"{path} does not exist; stage {stage.name} needs it as {name}")
    if required:
        raise MissingFileError(
            f"stage {stage.name} needs {path}, which does not exist; run the earlier stages first or give --{name}"
        )
    return None


def _keys(stage: Stage, run: Path) -> dict[str, str]:
    """Return the keys of what the stage reads, as the runner would find them."""
    earlier = (load_stage(name) for name in stage.needs if name in STAGES)
    found = {each.name: read_manifest(run / each.place) for each in earlier}
    return {name: manifest.key for name, manifest in found.items() if manifest is not None}


def __getattr__(name: str) -> click.Command:
    """Make the command of a stage when it is first asked for."""
    if name not in STAGES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return stage_command(load_stage(name))
