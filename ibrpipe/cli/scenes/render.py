"""``ibrpipe render``: the stage, and scenes, which no run makes."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import click

from ibrpipe.cli.options import PATH, example, given
from ibrpipe.cli.show import display
from ibrpipe.cli.stage import stage_command, stage_config
from ibrpipe.engine.artifacts import input_fields
from ibrpipe.engine.stage import Stage
from ibrpipe.stages.registry import load_stage

#: settings of scenes where they are not given: nothing was photographed, and pictures are filtered already
_USUAL = {"renderers": ["hierarchical"], "path": "orbit", "samples": 1}


def _scene_command(stage: Stage, scene: Path, slices: Path | None, values: dict[str, Any]) -> None:
    context = click.get_current_context()
    unused = list(given(context, lambda name: name == "dask" or name in input_fields(stage)))
    if unused:
        raise click.UsageError(f"--{unused[0]} does nothing for a scene; leave out either it or --scene")
    asked = given(context, lambda name: name in stage.config.model_fields)
    config = stage_config(stage, {**_USUAL, **asked})
    frames = _render(scene, slices, values["out"] / stage.folder, config, values["workers"])
    if values["as_json"]:
        click.echo(json.dumps(frames.model_dump(mode="json"), indent=2))
        return
    for renderer in frames.renderers:
        times = sorted(frame.ms for frame in frames.frames if frame.renderer == renderer)
        click.echo(
            f"{values['out'] / stage.folder}: {len(times)} frames of {renderer}, {times[len(times) // 2]:.1f} ms"
        )


def _render(scene: Path, slices: Path | None, out: Path, config: Any, workers: int) -> Any:
    from ibrpipe.io.documents.frames import Frames
    from ibrpipe.io.prerendered import read_prerendered
    from ibrpipe.io.scenes import read_scene
    from ibrpipe.renderers.frames import limited_threads
    from ibrpipe.stages.render import render_scene
    from ibrpipe.types.prerendered import PrerenderedScene

    with display() as shown, limited_threads(workers):
        shown.say(f"reading {scene}")
        whole = read_scene(scene)
        if slices is None:
            shown.say("slicing parts; ibrpipe prerender keeps them")
        source = whole if slices is None else PrerenderedScene(whole, read_prerendered(slices))
        written = render_scene(source, out, config)
    return Frames.read(written.frames_document, "is no list of frames", "render")


def render_command() -> click.Command:
    """Return the command of the stage, with the options of scenes."""
    stage = load_stage("render")
    of_assets = stage_command(stage)

    def callback(scene: Path | None, slices: Path | None, **values: Any) -> None:
        if scene is not None:
            _scene_command(stage, scene, slices, values)
            return
        if slices is not None:
            raise click.UsageError("--slices are those of a scene; give --scene, too")
        assert of_assets.callback is not None
        of_assets.callback(**values)

    return click.Command(
        of_assets.name,
        callback=callback,
        params=[
            click.Option(
                ["--scene"], type=PATH, metavar="PATH", help="Scene instead of an asset: a folder, .glb or .gltf."
            ),
            click.Option(
                ["--slices"], type=PATH, metavar="DIR", help="Scene: what ibrpipe prerender made; else made anew."
            ),
            *of_assets.params,
        ],
        help=f"{stage.summary}\n\nWith --scene, renders a scene; renderers, path and samples are then "
        + ", ".join(str(value if not isinstance(value, list) else value[0]) for value in _USUAL.values())
        + " unless given.",
        epilog=example(
            stage.example, "ibrpipe render --scene scenes/forest --path orbit:frames=24,elevation=12 --out out"
        ),
    )


def __getattr__(name: str) -> click.Command:
    """Make the command when it is asked for: what other packages' stages make may have changed."""
    if name != "command":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return render_command()
