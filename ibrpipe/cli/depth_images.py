"""``ibrpipe depth-images``: perspective depth images that cover a mesh, or photos with depth maps, as an asset."""

from __future__ import annotations

import json
from pathlib import Path

import click

from ibrpipe.cli.options import PATH, example, json_option, mesh_color_option
from ibrpipe.errors import MissingFileError
from ibrpipe.io.untrusted.boundary import utf8_text
from ibrpipe.io.yaml_settings import value_of


@click.command(
    name="depth-images",
    epilog=example(
        "ibrpipe depth-images dragon.ply --maps 16 --size 512 --out dragon",
        "ibrpipe depth-images dragon.ply --frusta dragon/frusta.yaml --out edited",
        "ibrpipe depth-images captures/room --out room",
        "ibrpipe render --asset dragon --renderers epipolar --path orbit:frames=8 --out frames",
    ),
)
@click.argument("source", metavar="MESH|CAPTURE", type=PATH)
@click.option("--maps", type=click.IntRange(1, 256), default=6, show_default=True, help="Most depth images to place.")
@click.option("--size", type=click.IntRange(2, 8192), default=512, show_default=True, help="Pixels along each side.")
@click.option(
    "--arrange",
    type=click.Choice(["greedy", "cube", "center"]),
    default="greedy",
    show_default=True,
    help="greedy: what adds most surface, again and again; cube: six along the axes; center: six from the middle.",
)
@click.option("--seed", type=int, default=0, show_default=True, help="Of the candidates that greedy chooses from.")
@click.option("--frusta", type=PATH, metavar="FILE", help="Take these frusta (YAML: eye, target, up, fov) instead.")
@mesh_color_option
@click.option("--out", type=PATH, required=True, metavar="DIR", help="Asset folder to write; frusta.yaml goes into it.")
def command(
    source: Path,
    maps: int,
    size: int,
    arrange: str,
    seed: int,
    frusta: Path | None,
    color: Path | None,
    out: Path,
    as_json: bool,
) -> None:
    """Cover MESH with few perspective depth images (schaufler1999), as an asset.

    Of a CAPTURE folder, the photos that have depth maps (depth/*.exr or .npy along camera z, beside images/) are
    taken as they are; the options that place images are not for it.
    """
    from ibrpipe.io.assets import write_asset
    from ibrpipe.io.surfaces.colored_meshes import read_colored
    from ibrpipe.modelling import frusta as placing
    from ibrpipe.modelling.depth_images import depth_images_asset

    if source.is_dir():
        if color is not None:
            raise click.UsageError("--color is for a mesh; photos bring their colours")
        count = _write_views(source, out)
        click.echo(json.dumps({"maps": count}) if as_json else f"{out}: {count} depth images of the photos")
        return
    whole, colors = read_colored(source, color)
    if frusta is None and arrange == "greedy":
        chosen, share = placing.greedy_frusta(whole, maps, seed)
    else:
        usual = {"cube": placing.cube_frusta, "center": placing.central_frusta}.get(arrange, placing.cube_frusta)
        chosen = placing.frusta_from_entries(_read(frusta)) if frusta else usual(whole)
        share = placing.covered_share(whole, chosen, seed)
    write_asset(depth_images_asset(whole, chosen, size, str(source), colors), out)
    placing.write_frusta(chosen, out / "frusta.yaml")
    if as_json:
        click.echo(json.dumps({"maps": len(chosen), "size": size, "covered": share}))
    else:
        covered = f"{100 * share:.1f} % of the surface that can be seen"
        click.echo(f"{out}: {len(chosen)} depth images of {size} x {size}, {covered}")


command.params.append(json_option)


def _write_views(capture: Path, out: Path) -> int:
    """Write the asset of a capture's photos with depth maps; return how many."""
    import numpy as np

    from ibrpipe.io.assets import write_asset
    from ibrpipe.io.captures import read_capture
    from ibrpipe.io.views import load_depth, load_view
    from ibrpipe.modelling.depth_images import asset_of_views
    from ibrpipe.types import DepthImage

    whole = read_capture(capture)
    views = [view for view in (*whole.train, *whole.test) if view.depth is not None]
    if not views:
        raise MissingFileError(f"{capture}: no view has a depth map; put them into depth/ beside images/")
    images = []
    for view in views:
        color, mask = load_view(view)
        images.append(DepthImage(view.camera, color, np.where(mask >= 0.5, load_depth(view), np.inf)))
    write_asset(asset_of_views(images, [view.name for view in views], str(capture)), out)
    return len(images)


def _read(path: Path) -> object:
    if not path.is_file():
        raise MissingFileError(f"{path}: there is no such file of frusta")
    return value_of(utf8_text(path, "write it again"), str(path))
