"""``ibrpipe depth-images``: a few perspective depth images that cover a mesh, written as an asset."""

from __future__ import annotations

from pathlib import Path

import click
import yaml

from ibrpipe.cli.options import PATH, example
from ibrpipe.errors import ConfigError, MissingFileError


@click.command(
    name="depth-images",
    epilog=example(
        "ibrpipe depth-images dragon.ply --maps 16 --size 512 --out dragon",
        "ibrpipe depth-images dragon.ply --frusta dragon/frusta.yaml --out edited",
        "ibrpipe render --asset dragon --renderers epipolar --path orbit:frames=8 --out frames",
    ),
)
@click.argument("mesh", type=PATH)
@click.option("--maps", type=click.IntRange(1, 256), default=6, show_default=True, help="Most depth images to place.")
@click.option("--size", type=click.IntRange(2, 8192), default=512, show_default=True, help="Pixels along each side.")
@click.option(
    "--arrange",
    type=click.Choice(["greedy", "cube"]),
    default="greedy",
    show_default=True,
    help="greedy: what adds most surface, again and again; cube: six along the axes.",
)
@click.option("--seed", type=int, default=0, show_default=True, help="Of the candidates that greedy chooses from.")
@click.option("--frusta", type=PATH, metavar="FILE", help="Take these frusta (YAML: eye, target, up, fov) instead.")
@click.option("--out", type=PATH, required=True, metavar="DIR", help="Asset folder to write; frusta.yaml goes into it.")
def command(mesh: Path, maps: int, size: int, arrange: str, seed: int, frusta: Path | None, out: Path) -> None:
    """Cover MESH with few perspective depth images (schaufler1999) that every renderer reads."""
    from ibrpipe.io.assets import write_asset
    from ibrpipe.io.meshes import read_mesh
    from ibrpipe.stages import frusta as placing
    from ibrpipe.stages.depth_images import depth_images_asset

    whole, note = read_mesh(mesh), ""
    if frusta is not None:
        placed = placing.frusta_from_entries(_read(frusta))
    elif arrange == "cube":
        placed = placing.cube_frusta(whole)
    else:
        placed, share = placing.greedy_frusta(whole, maps, seed)
        note = f", {100 * share:.1f} % of the surface that can be seen"
    write_asset(depth_images_asset(whole, placed, size, str(mesh)), out)
    placing.write_frusta(placed, out / "frusta.yaml")
    click.echo(f"{out}: {len(placed)} depth images of {size} x {size}{note}")


def _read(path: Path) -> object:
    if not path.is_file():
        raise MissingFileError(f"{path}: there is no such file of frusta")
    try:
        return yaml.safe_load(path.read_text(encoding="utf-8"))
    except yaml.YAMLError as error:
        raise ConfigError(f"{path}: is not YAML ({' '.join(str(error).split())})") from error
