"""``ibrpipe prerender``: images of a scene's parts, made once and kept."""

from __future__ import annotations

import json
from pathlib import Path

import click

from ibrpipe.cli.options import PATH, dask_option, example, json_option, workers_option
from ibrpipe.cli.show import display
from ibrpipe.engine.event_words import size
from ibrpipe.engine.run_folder import made_folder


@click.command(
    name="prerender",
    epilog=example(
        "ibrpipe prerender scenes/forest --out scenes/forest-slices",
        "ibrpipe render --scene scenes/forest --slices scenes/forest-slices --path orbit:frames=24 --out out",
    ),
)
@click.argument("scene", type=PATH)
@click.option("--out", type=PATH, required=True, metavar="DIR", help="Folder to write.")
@click.option(
    "--directions", type=click.IntRange(6, 1024), default=128, show_default=True, help="Directions; 6 = as published."
)
@click.option(
    "--slab-texels", type=click.FloatRange(1, 64), default=6.0, show_default=True, help="Thickness of a slab in texels."
)
@click.option(
    "--rays", type=click.IntRange(1, 16), default=4, show_default=True, help="Rays along either side of a texel."
)
@click.option("--finest", type=click.IntRange(2, 64), default=32, show_default=True, help="Most texels across a part.")
def command(
    scene: Path,
    out: Path,
    directions: int,
    slab_texels: float,
    rays: int,
    finest: int,
    workers: int,
    dask: str | None,
    as_json: bool,
) -> None:
    """Prerender every part of SCENE that occurs more than once, for the renderer hierarchical.

    Two forms are kept: prefiltered slices, and the six views of the published method (mode=reproject).
    SCENE is a folder with scene.yaml, or a .glb or .gltf file. Scenes that differ only in where copies
    stand share their slices.
    """
    from ibrpipe.engine.executor import executor
    from ibrpipe.io.prerendered import write_prerendered
    from ibrpipe.io.scenes import read_scene
    from ibrpipe.renderers.hierarchical.forms import prerender
    from ibrpipe.renderers.hierarchical.prefiltering import Slicing

    with display() as shown, made_folder(out), executor(workers, dask) as pool:
        shown.say(f"reading {scene}")
        whole = read_scene(scene)
        shown.say("slicing parts")
        library = prerender(whole, Slicing(directions, slab_texels, rays, finest), pool).library
        document = write_prerendered(library, out)
    if as_json:
        click.echo(json.dumps(document.model_dump(mode="json"), indent=2))
        return
    click.echo(
        f"{out}: {len(document.parts)} parts from {document.directions} directions, {document.slabs} slabs, "
        f"{size(document.file_bytes)} ({size(library.bytes)} in memory), {document.seconds:.1f} s"
    )
    click.echo(f"{out}: six views of them, {size(document.views_bytes)}, {document.views_seconds:.1f} s")
    for form in ("slices", "views"):
        levels = [each.psnr for part in document.parts if (each := getattr(part, form)) and each.psnr is not None]
        if levels:
            click.echo(f"  {form}: {min(levels):.1f} to {max(levels):.1f} dB against polygons, a texel a pixel wide")


command.params += [workers_option, dask_option, json_option]
