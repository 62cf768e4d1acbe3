"""``ibrpipe render``: the stage, and scenes, which no run makes."""

from __future__ import annotations

import json
from collections.abc import Callable, Collection, Mapping, Sequence
from functools import partial
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
from ibrpipe.io.surfaces.reliefs import is_reliefs
from ibrpipe.stages.registry import load_stage, load_stages

if TYPE_CHECKING:
    from ibrpipe.io.documents.frames import Frames
    from ibrpipe.types import Scene
    from ibrpipe.types.prerendered import PrerenderedScene

#: settings of scenes where they are not given: nothing was photographed, and pictures are filtered already
_USUAL = {"renderers": ["hierarchical"], "path": "orbit", "samples": 1}
#: settings of several assets where they are not given
_USUAL_TOGETHER = {"path": "orbit"}
#: reads what is to be rendered
Reader = Callable[[], "Scene | PrerenderedScene"]


def _scene_command(stage: Stage, scene: Path, slices: Path | None, values: dict[str, Any]) -> None:
    _tell_unused(stage, ("dask", "mesh", *input_fields(stage)), "a scene; leave out either it or --scene")
    told = f"reading {scene}" if slices else f"reading {scene} and slicing its parts; ibrpipe prerender keeps them"
    _render_scene(stage, values, _USUAL, str(_USUAL["path"]), partial(_read_scene, scene, slices), told)


def _together_command(stage: Stage, assets: Sequence[Path], meshes: Sequence[Path], values: dict[str, Any]) -> None:
    others = (name for name in input_fields(stage) if name != "asset")
    _tell_unused(stage, ("dask", *others), "several assets or meshes in one picture; leave it out")
    usual = _USUAL_TOGETHER if assets else _USUAL
    own = _path_of_run(values["out"], stage)
    _render_scene(stage, values, usual, own, partial(_read_together, assets, meshes), "reading assets and meshes")


def _tell_unused(stage: Stage, names: Collection[str], why: str) -> None:
    unused = list(given(click.get_current_context(), lambda name: name in names))
    if unused:
        raise click.UsageError(f"--{unused[0]} does nothing for {why}")


def _render_scene(
    stage: Stage, values: dict[str, Any], usual: Mapping[str, Any], path_of_run: str, read: Reader, told: str
) -> None:
    from ibrpipe.renderers.frames import limited_threads
    from ibrpipe.stages.render import render_scene

    asked = given(click.get_current_context(), lambda name: name in stage.config.model_fields)
    config: Any = stage_config(stage, {**usual, **asked})
    folder = values["out"] / frames_folder(stage.folder, config.path, path_of_run)
    with made_folder(folder), display() as shown, limited_threads(values["workers"]):
        shown.say(told)
        render_scene(read(), folder, config)
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


def _read_scene(scene: Path, slices: Path | None) -> Scene | PrerenderedScene:
    from ibrpipe.io.prerendered import read_prerendered
    from ibrpipe.io.scenes import read_scene
    from ibrpipe.types.prerendered import PrerenderedScene

    whole = read_scene(scene)
    return whole if slices is None else PrerenderedScene(whole, read_prerendered(slices))


def _read_together(assets: Sequence[Path], meshes: Sequence[Path]) -> Scene:
    """Return assets and meshes as one scene, each where its own coordinates put it."""
    import numpy as np

    from ibrpipe.io.assets import read_captured
    from ibrpipe.io.scenes.painted import read_painted
    from ibrpipe.types import Instances, Part, Scene

    shapes = Part("meshes", tuple(mesh for file in meshes for mesh in read_painted(file)))
    things = Part("assets", sources=tuple(each for folder in assets for each in read_captured(folder)))
    held = tuple(Instances(part.name, np.eye(4)) for part in (things, shapes))
    return Scene([things, shapes, Part("scene", children=held)], "scene")


def render_command() -> click.Command:
    """Return the command of the stage, with the options of scenes."""
    stage = load_stage("render")
    of_assets = stage_command(stage)

    def callback(
        scene: Path | None, slices: Path | None, asset: Sequence[Path], mesh: Sequence[Path], **values: Any
    ) -> None:
        if scene is not None:
            _scene_command(stage, scene, slices, values)
            return
        if slices is not None:
            raise click.UsageError("--slices are those of a scene; give --scene, too")
        if mesh or len(asset) > 1 or any(map(is_reliefs, asset)):
            _together_command(stage, asset, mesh, values)
        else:
            _asset_command(stage, {**values, "asset": asset[0] if asset else None})

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
            click.Option(
                ["--mesh"],
                type=PATH,
                multiple=True,
                metavar="FILE",
                help="Mesh in the same picture, beside assets or alone; may be given several times.",
            ),
            *map(_several, of_assets.params),
        ],
        help=f"{stage.summary}\n\nFrames along another path than that of the run itself go to a folder of their own, "
        "render-PATH, so that earlier ones stay.\n\n"
        "Several --asset and --mesh are shown in one picture, joined by depth, each where its own coordinates put it; "
        "a scene.yaml places them by matrices.\n\n"
        "With --scene, renders a scene; renderers, path and samples are then "
        + ", ".join(str(value if not isinstance(value, list) else value[0]) for value in _USUAL.values())
        + " unless given.",
        epilog=example(
            stage.example,
            "ibrpipe render --asset wall --asset bunny --mesh teapot.ply --renderers prewarp --path orbit --out out",
            "ibrpipe render --scene scenes/forest --path orbit:frames=24,elevation=12 --out out",
        ),
    )


def _several(param: click.Parameter) -> click.Parameter:
    """Return the option of assets so that it may be given several times, others as they are."""
    if isinstance(param, click.Option) and param.name == "asset":
        text = f"{param.help} Several are shown in one picture."
        return click.Option(["--asset"], type=PATH, multiple=True, metavar="PATH", help=text)
    return param


def __getattr__(name: str) -> click.Command:
    """Make the command when it is asked for: what other packages' stages make may have changed."""
    if name != "command":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return render_command()
