"""``ibrpipe synth``: a synthetic capture with exact truth, or a generated scene of many copies."""

from __future__ import annotations

import json
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import click

from ibrpipe.cli.describe import scene_facts
from ibrpipe.cli.options import PATH, config_options, example, given, json_option
from ibrpipe.cli.show import Display, display
from ibrpipe.config import StageConfig
from ibrpipe.engine.event_words import size, told
from ibrpipe.engine.run_folder import made_folder
from ibrpipe.engine.runner import Job, run_job
from ibrpipe.engine.stage import Stage, StageOutputs
from ibrpipe.errors import ConfigError
from ibrpipe.io.manifest import Hasher, Manifest
from ibrpipe.io.scenes import write_scene
from ibrpipe.io.yaml_settings import Key, Settings, validated
from ibrpipe.synthetic.capture import SynthConfig, write_capture
from ibrpipe.synthetic.instanced.scenes import InstancedConfig, instanced_names, make_instanced, settings_of
from ibrpipe.synthetic.scenes import scene_names

Config = TypeVar("Config", bound=StageConfig)


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
    ctx = click.get_current_context()
    if scene in instanced_names():
        _write_instanced(ctx, scene, out, as_json)
        return
    config = _config(ctx, scene, SynthConfig, SynthConfig.model_fields)
    with display() as shown:
        manifest = made(scene, out, config, shown)
    if as_json:
        click.echo(json.dumps(manifest.model_dump(mode="json"), indent=2))


def _config(ctx: click.Context, scene: str, model: type[Config], own: Collection[str]) -> Config:
    """Return the settings of a scene; one that it does not have is told."""
    known = {*SynthConfig.model_fields, *InstancedConfig.model_fields}
    values = given(ctx, lambda name: name in known)
    foreign = [f"--{name.replace('_', '-')}" for name in values if name not in own]
    if foreign:
        raise click.UsageError(f"scene {scene} has no {', '.join(foreign)}; leave it out")
    places: dict[Key, str] = {(name,): f"--{name.replace('_', '-')}" for name in values}
    try:
        return validated(model, Settings(values, {(): "settings"} | places))
    except ConfigError as error:
        raise click.UsageError(str(error)) from error


def _write_instanced(ctx: click.Context, name: str, out: Path, as_json: bool) -> None:
    config = _config(ctx, name, InstancedConfig, settings_of(name))
    with display() as shown, made_folder(out):
        shown.say(f"making {name}")
        scene = make_instanced(name, config)
        write_scene(scene, out)
    facts = scene_facts(scene, out)
    if as_json:
        click.echo(json.dumps(facts, indent=2, ensure_ascii=False))
    else:
        click.echo(
            f"{out}: {len(scene.parts)} parts, {facts['sub_objects']:,} sub-objects, {facts['polygons']:,} polygons, "
            f"{size(facts['bytes'])}"
        )


def _options() -> list[click.Option]:
    """Return the options of captures, and those of generated scenes that these do not have, too."""
    options = config_options(SynthConfig)
    for option in options:
        if option.name == "seed":
            option.help = f"{option.help}; forest, city: of the layout and shapes, there 5 unless given"
    return options + config_options(InstancedConfig, set(InstancedConfig.model_fields) - set(SynthConfig.model_fields))


command = click.Command(
    STAGE.name,
    callback=_callback,
    params=[
        click.Argument(["scene"], type=click.Choice([*scene_names(), *instanced_names()])),
        click.Argument(["out"], type=PATH),
        *_options(),
        json_option,
    ],
    help=f"{STAGE.summary}\n\nOr generate a scene of many copies of few parts: {', '.join(instanced_names())}. The "
    "capture or scene is written to the folder OUT, which is made.",
    epilog=example(STAGE.example, "ibrpipe synth forest scenes/forest --trees 10000"),
)
