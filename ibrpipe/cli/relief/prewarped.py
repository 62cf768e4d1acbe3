"""``ibrpipe relief prewarp``: pre-warped textures as pictures."""

from __future__ import annotations

import json
from pathlib import Path

import click

from ibrpipe.cli.options import PATH, config_options, example
from ibrpipe.renderers.prewarp.options import PrewarpOptions

#: options of renderer `prewarp` that matter to the texture
_OPTIONS = ("method", "depth_bits", "level", "max_step", "quads")


@click.command(
    name="prewarp",
    epilog=example(
        "ibrpipe relief prewarp brick --path orbit:frames=1,up=y --out warped",
        "ibrpipe relief prewarp brick --stage rows --path orbit:frames=1,up=y --out warped",
    ),
)
@click.argument("asset", type=PATH)
@click.option(
    "--stage", type=click.Choice(["both", "rows"]), default="both", show_default=True, help="After which pass."
)
@click.option(
    "--path", default="orbit:frames=1,up=y", show_default=True, help="Orbit, COLMAP model folder, or transforms.json."
)
@click.option("--out", type=PATH, required=True, metavar="DIR", help="Folder for the pictures and prewarp.json.")
def command(asset: Path, stage: str, path: str, out: Path, **options: object) -> None:
    """Write the textures that ASSET is pre-warped to for each view: what is then mapped onto plain rectangles.

    VIEW_NUMBER.png has colour and alpha; prewarp.json says where the corners of each lie.
    """
    import ibrpipe
    from ibrpipe.engine.run_folder import made_folder
    from ibrpipe.io.paths import camera_path
    from ibrpipe.io.views import ViewSet
    from ibrpipe.picture_files import write_png

    source = ibrpipe.read_asset(asset)
    cameras = camera_path(path, source, ViewSet((), ()))
    prepared, listed = ibrpipe.prepare(source, "prewarp"), []
    asked = {name: value for name, value in options.items() if value is not None}
    with made_folder(out):
        for name, camera in cameras:
            for number, each in enumerate(ibrpipe.prewarp(prepared, camera, stage, **asked)):  # type: ignore[arg-type]
                write_png(out / f"{name}_{number}.png", each.color, each.alpha)
                places = {key: getattr(each, key).tolist() for key in ("corner", "across", "down")}
                listed.append({"file": f"{name}_{number}.png", "view": name, "eye": camera.center.tolist(), **places})
        (out / "prewarp.json").write_text(json.dumps(listed, indent=1) + "\n", encoding="utf-8")
    click.echo(f"{out}: {len(listed)} pre-warped texture{'s' if len(listed) != 1 else ''} of {len(cameras)} views")


command.params += config_options(PrewarpOptions, _OPTIONS)
