"""``ibrpipe render``: the stage, and scenes, which no run makes."""

from __future__ import annotations

import json
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING, Any

import click

from ibrpipe.cli.options import PATH, example, given
from ibrpipe.cli.show import display
from ibrpipe.cli.stage import run_stage, stage_command, stage_config
from ibrpipe.engine.artifacts import input_fields
from ibrpipe.engine.run_document import RunDocument
from ibrpipe.engine.run_folder import made_folder
from ibrpipe.engine.stage import Stage
from ibrpipe.io.manifest import RUN_NAME
from ibrpipe.io.paths import frames_folder
from ibrpipe.stages.registry import load_stage, load_stages

if TYPE_CHECKING:
    from ibrpipe.io.documents.frames import Frames

#: settings of scenes where they are not given: nothing was photographed, and pictures are filtered already
_USUAL = {"renderers": ["hierarchical"], "path": "orbit", "samples": 1}


def _scene_command(stage: Stage, scene: Path, slices: Path | None, values: dict[str, Any]) -> None:
    context = click.get_current_context()
    unused = list(given(context, lambda name: name == "dask" or name in input_fields(stage)))
    if unused:
        raise click.UsageError(f"--{unused[0]} does nothing for a scene; leave out either it or --scene")
    asked = given(context, lambda name: name in stage.config.model_fields)
    config: Any = stage_config(stage, {**_USUAL, **asked})
    folder = values["out"] / frames_folder(stage.folder, config.path, str(_USUAL["path"]))
    with made_folder(folder):
        _render(scene, slices, folder, config, values["workers"])
    frames = _frames_in(folder)
    if values["as_json"]:
        click.echo(json.dumps(frames.model_dump(mode="json"), indent=2))
    else:
        _tell(folder, frames)


def _asset_command(stage: Stage, values: dict[str, Any]) -> None:
    context = click.get_current_context()
    config: Any = stage_config(stage, given(context, lambda name: name in stage.config.model_fields))
    folder = values["out"] / frames_folder(stage.folder, config.path, _path_of_run(values["out"], stage))
    manifest = run_stage(stage, load_stages(), config, values, folder)
    if values["as_json"]:
        click.echo(json.dumps({"folder": str(folder), **manifest.model_dump(mode="json")}, indent=2))
    else:
        _tell(folder, _frames_in(folder))


def _path_of_run(out: Path, stage: Stage) -> str:
    """Return the camera path of the run that `out` holds: the folder of its frames is not for other ones."""
    usual = str(stage.config.model_fields["path"].default)
    if not (out / RUN_NAME).is_file():
        return usual
    known = RunDocument.read(out / RUN_NAME, "is no note of a run", stage.name)
    return str(known.settings.get(stage.name, {}).get("path", usual))


def _frames_in(folder: Path) -> Frames:
    from ibrpipe.io.documents.frames import Frames

    return Frames.read(folder / "frames.json", "is no list of frames", "render")


def _tell(folder: Path, frames: Frames) -> None:
    """Say where the frames and videos of every renderer are."""
    for renderer in frames.renderers:
        own = [frame for frame in frames.frames if frame.renderer == renderer]
        places = sorted({(folder / frame.file).parent for frame in own})
        click.echo(f"{places[0]}: {len(own)} frames of {renderer}, {median(frame.ms for frame in own):.1f} ms each")
        if renderer in frames.videos:
            click.echo(f"video: {folder / frames.videos[renderer]}")


def _render(scene: Path, slices: Path | None, out: Path, config: Any, workers: int) -> None:
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
        render_scene(source, out, config)


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
        _asset_command(stage, values)

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
        help=f"{stage.summary}\n\nFrames along another path than that of the run itself go to a folder of their own, "
        "render-PATH, so that earlier ones stay.\n\n"
        "With --scene, renders a scene; renderers, path and samples are then "
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
