"""``ibrpipe relief``: relief textures from images, assets, meshes and range data, written as assets."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click

from ibrpipe.cli.options import PATH, LiteralChoice, example, mesh_color_option
from ibrpipe.cli.relief.meshes import dual, mesh_map
from ibrpipe.cli.relief.prewarped import command as prewarp
from ibrpipe.errors import ConfigError, IbrError, MissingFileError
from ibrpipe.io.untrusted.boundary import utf8_text
from ibrpipe.io.yaml_settings import value_of

_OUT = click.option("--out", type=PATH, required=True, metavar="DIR", help="Asset folder to write.")
_BITS = click.option(
    "--bits",
    type=LiteralChoice((8, 16, "float")),
    default=None,
    help="Write relief textures, one image of colour and displacement each, of 8 or 16 bits or floats.",
)
_TEXELS = click.option(
    "--texels",
    type=click.IntRange(2, 8192),
    default=256,
    show_default=True,
    help="Texels along the longer edge of a face.",
)


@click.group(
    name="relief",
    epilog=example(
        "ibrpipe relief images materials/brick --size 2 1 --depth-range 0 0.05 --out brick",
        "ibrpipe relief box bunny.ply --texels 512 --out bunny",
        "ibrpipe render --asset bunny --renderers prewarp --path orbit:frames=8,up=y --out frames",
    ),
)
def command() -> None:
    """Make relief textures, assets with one depth sample per texel; map reliefs onto meshes.

    The asset is rendered without any capture: ibrpipe render --asset DIR --path orbit.
    """


@command.command(epilog=example("ibrpipe relief images materials/brick --size 2 1 --depth-range 0 0.05 --out brick"))
@click.argument("folder", type=PATH, required=False)
@click.option("--height", type=PATH, metavar="FILE", help="Height map, instead of the one in FOLDER.")
@click.option("--color", type=PATH, metavar="FILE", help="Colour image, instead of the one in FOLDER.")
@click.option(
    "--size", type=(float, float), default=(1.0, 1.0), show_default=True, help="Width and height, scene units."
)
@click.option(
    "--depth-range",
    type=(float, float),
    default=None,
    help="Heights of code 0 and of full scale, scene units.  [default: 0 1 for integers, as stored for floats]",
)
@click.option(
    "--part", is_flag=True, help="Part neighbours whose heights differ by over 4 texels; else all are joined."
)
@_BITS
@_OUT
def images(
    folder: Path | None,
    height: Path | None,
    color: Path | None,
    size: tuple[float, float],
    depth_range: tuple[float, float] | None,
    part: bool,
    bits: Any,
    out: Path,
) -> None:
    """Lay the height map and colours of FOLDER (height.*, color.*) on a rectangle, heights along +z.

    Writes a relief texture, of 16 bits unless --bits says otherwise.
    """
    from ibrpipe.io.surfaces.relief_images import read_color, read_height, read_relief_folder
    from ibrpipe.modelling.relief_textures import PARTED, relief_from_images, steep_share

    if folder is None and height is None:
        raise click.UsageError("give FOLDER or --height FILE")
    if folder is not None and height is None:
        found = read_relief_folder(folder, depth_range)
        heights, colors = found.height, found.color
    else:
        heights, colors = read_height(height or Path(), depth_range), None
    colors = read_color(color) if color is not None else colors
    made = relief_from_images(heights, colors, size)
    _write([made], ["front"], folder or height, out, bits or 16, joined=not part)
    steep = steep_share(made)
    if steep > 1e-3:
        done = "parted" if part else "joined all the same; --part parts them"
        click.echo(
            f"{100 * steep:.1f} % of neighbouring texels differ by over {PARTED:g} texels of height; they are {done}"
        )


@command.command(epilog=example("ibrpipe relief asset out/asset --out first_layers"))
@click.argument("asset", type=PATH)
@_BITS
@_OUT
def asset(asset: Path, bits: Any, out: Path) -> None:
    """Keep the first layer of every texture of ASSET."""
    from ibrpipe.io.assets import read_asset
    from ibrpipe.modelling.relief_textures import relief_from_layers

    whole = read_asset(asset)
    names = [entry["name"] for entry in whole.info["textures"]]
    _write([relief_from_layers(texture) for texture in whole.textures], names, asset, out, bits)


@command.command(epilog=example("ibrpipe relief mesh dragon.ply --side +z --texels 512 --out front"))
@click.argument("mesh", type=PATH)
@click.option("--side", default="+z", show_default=True, help="Side it is seen from: +x, -x, +y, -y, +z or -z.")
@_TEXELS
@mesh_color_option
@_BITS
@_OUT
def mesh(mesh: Path, side: str, texels: int, color: Path | None, bits: Any, out: Path) -> None:
    """Sample one side of MESH orthographically from its bounding box, in its colours; clay without any."""
    from ibrpipe.io.surfaces.colored_meshes import read_colored
    from ibrpipe.modelling.relief_textures import relief_from_mesh

    surface, colors = read_colored(mesh, color)
    _write([relief_from_mesh(surface, side, texels, colors)], [side], mesh, out, bits)


@command.command(epilog=example("ibrpipe relief box bunny.ply --texels 512 --out bunny"))
@click.argument("mesh", type=PATH)
@_TEXELS
@mesh_color_option
@_BITS
@_OUT
def box(mesh: Path, texels: int, color: Path | None, bits: Any, out: Path) -> None:
    """Sample all six sides of MESH in its colours: an object that is seen from everywhere."""
    from ibrpipe.io.surfaces.colored_meshes import read_colored
    from ibrpipe.modelling.relief_textures import SIDES, box_from_mesh

    surface, colors = read_colored(mesh, color)
    _write(box_from_mesh(surface, texels, colors), list(SIDES), mesh, out, bits)


@command.command(name="range", epilog=example("ibrpipe relief range captures/room --planes planes.yaml --out room"))
@click.argument("capture", type=PATH)
@click.option(
    "--planes",
    type=PATH,
    required=True,
    metavar="FILE",
    help="YAML list of planes: origin, across, down (3 numbers each), columns, rows, and optional near, far.",
)
@_BITS
@_OUT
def range_data(capture: Path, planes: Path, bits: Any, out: Path) -> None:
    """Resample the views of CAPTURE that have depth maps onto planes that the user places."""
    from ibrpipe.io.captures import read_capture
    from ibrpipe.io.views import load_depth, load_view
    from ibrpipe.modelling.relief_textures import reliefs_from_range
    from ibrpipe.types import DepthImage

    frames = _planes(planes)
    whole = read_capture(capture)
    views = [view for view in (*whole.train, *whole.test) if view.depth is not None]
    if not views:
        raise MissingFileError(f"{capture}: no view has a depth map; put them into depth/ beside images/")
    scans = [DepthImage(view.camera, load_view(view)[0], load_depth(view)) for view in views]
    _write(reliefs_from_range(scans, frames), [f"plane_{i:02d}" for i in range(len(frames))], capture, out, bits)


def _planes(path: Path) -> list[Any]:
    from ibrpipe.modelling.relief_textures import Plane

    if not path.is_file():
        raise MissingFileError(f"{path}: there is no such file of planes")
    try:
        entries = value_of(utf8_text(path, "write it again"), str(path))
        return [Plane(**{**entry, **{k: [float(x) for x in entry[k]] for k in _VECTORS}}) for entry in entries]
    except (TypeError, KeyError, ValueError) as error:
        if isinstance(error, IbrError):
            raise
        raise ConfigError(
            f"{path}: is no list of planes ({' '.join(str(error).split())}); "
            "each needs origin, across, down, columns, rows"
        ) from error


_VECTORS = ("origin", "across", "down")


def _write(
    reliefs: Sequence[Any], names: Sequence[str], source: Path | None, out: Path, bits: Any, joined: bool = False
) -> None:
    """Write relief textures of so many bits; None: an asset."""
    from ibrpipe.io.assets import write_asset
    from ibrpipe.io.surfaces.reliefs import write_reliefs
    from ibrpipe.modelling.relief_textures import asset_from_reliefs

    if bits is None:
        write_asset(asset_from_reliefs(reliefs, names, str(source)), out)
    else:
        write_reliefs(reliefs, out, names, bits=bits, joined=joined, made_from=str(source))
    texels = sum(relief.height.size for relief in reliefs)
    click.echo(f"{out}: {len(reliefs)} relief texture{'s' if len(reliefs) > 1 else ''}, {texels} texels")


command.add_command(mesh_map)
command.add_command(dual)
command.add_command(prewarp)
