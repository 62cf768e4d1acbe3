"""``ibrpipe synth``: a synthetic capture with exact truth."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click

from ibrpipe.cli.options import PATH, config_options, example, given, json_option
from ibrpipe.cli.show import Display, display, told
from ibrpipe.engine.runner import Job, run_job
from ibrpipe.engine.stage import Stage, StageOutputs
from ibrpipe.engine.yaml_settings import Key, Settings, validated
from ibrpipe.errors import ConfigError
from ibrpipe.io.manifest import Hasher, Manifest
from ibrpipe.synthetic.capture import SynthConfig, write_capture
from ibrpipe.synthetic.scenes import scene_names


@dataclass(frozen=True)
class Inputs:
    """The scene and the capture folder to fill."""

    scene: str
    out: Path


def _run(inputs: Inputs, config: SynthConfig) -> Path:
    return write_capture(inputs.scene, inputs.out, config)


STAGE = Stage(
    name="synth",
    summary="Make a synthetic capture with exact truth: photos, masks, cameras, mesh, and test views with depth.",
    inputs=Inputs,
    outputs=StageOutputs,
    config=SynthConfig,
    run=_run,
    example="ibrpipe synth glossy captures/glossy --photos 40",
)


def made(scene: str, out: Path, config: SynthConfig, shown: Display) -> Manifest:
    """Make the capture unless `out` holds the same one already."""
    job = Job(STAGE, {"scene": scene}, config, out)
    return run_job(job, Hasher(), report=lambda event: shown.say(told(event)))


def _callback(scene: str, out: Path, as_json: bool, **settings: Any) -> None:
    values = given(click.get_current_context(), lambda name: name in SynthConfig.model_fields)
    places: dict[Key, str] = {(name,): f"--{name.replace('_', '-')}" for name in values}
    try:
        config = validated(SynthConfig, Settings(values, {(): "settings"} | places))
    except ConfigError as error:
        raise click.UsageError(str(error)) from error
    with display() as shown:
        manifest = made(scene, out, config, shown)
    if as_json:
        click.echo(json.dumps(manifest.model_dump(mode="json"), indent=2))


command = click.Command(
    STAGE.name,
    callback=_callback,
    params=[
        click.Argument(["scene"], type=click.Choice(list(scene_names()))),
        click.Argument(["out"], type=PATH),
        *config_options(SynthConfig),
        json_option,
    ],
    help=f"{STAGE.summary}\n\nThe capture is written to the folder OUT, which is made.",
    epilog=example(STAGE.example),
)
