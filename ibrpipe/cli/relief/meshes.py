"""``ibrpipe relief map`` and ``ibrpipe relief dual``: relief mapping on textured meshes."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import click

from ibrpipe.cli.options import PATH, config_options, example, json_option, mesh_color_option
from ibrpipe.renderers.option_check import checked_options
from ibrpipe.renderers.relief import ReliefRenderer
from ibrpipe.renderers.relief.options import ReliefOptions

_VECTOR = (float, float, float)
#: options of renderer `relief` that the command has, in the order of ``frames.json``
_LOOK = (
    "mapping", "model", "search", "ambient", "diffuse", "specular", "shininess", "shadows", "two_sided", "anisotropy",
    "linear_steps", "least_steps", "binary_steps", "level",
)  # fmt: skip
#: those of them that are one number, or three for red, green and blue
_SHARES = ("ambient", "diffuse", "specular")


class _Share(click.ParamType):
    """One number, or three with commas between them."""

    name = "share"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Read the numbers; how many and how great they may be, the renderer's options say."""
        if not isinstance(value, str):
            return value
        try:
            return tuple(float(each) for each in value.split(","))
        except ValueError:
            self.fail(f"{value!r} is neither a number nor three as 0.2,0.25,0.3", param, ctx)


def _look_options() -> list[click.Option]:
    """Return the options in `_LOOK`, their help without the word that they are for meshes."""
    options = config_options(ReliefOptions, _LOOK)
    for option in options:
        text = (option.help or "").removeprefix("Meshes: ")
        option.help = f"{text[0].upper()}{text[1:]}."
        if option.name in _SHARES:
            (default,) = ReliefOptions.model_fields[option.name].default
            option.type, option.multiple, option.metavar = _Share(), False, "SHARE[,G,B]"
            option.default = f"{default:g}"
    return options


@click.command(
    name="map",
    epilog=example(
        "ibrpipe relief map teapot.ply --relief materials/rock --repeat 4 4 --light 5 8 6 --out frames",
        "ibrpipe relief map scene.glb --path orbit:frames=24,up=y --model shell --out frames",
        "ibrpipe relief map flag.obj --height cloth.png --moved flag/ --light 1 2 3 --out frames",
        "ibrpipe relief map bunny/quad.obj --packed bunny/packed.png --thickness 0.12 --edges cut --out frames",
    ),
)
@click.argument("mesh", type=PATH)
@click.option("--relief", type=PATH, metavar="DIR", help="Folder with height.*, color.*, normal_gl.*.")
@click.option("--height", type=PATH, metavar="FILE", help="Height map.  [default: alpha of the normal map]")
@click.option("--color", type=PATH, metavar="FILE", help="Colour image, instead of the material's.")
@click.option("--normal", type=PATH, metavar="FILE", help="Normal map, instead of the material's.")
@click.option("--packed", type=PATH, metavar="FILE", help="Normal x, y and two depths in four channels.")
@click.option("--thickness", type=float, help="Height 0 to 1, scene units.  [default: a twentieth of a texture]")
@click.option(
    "--height-range",
    type=(float, float),
    default=(0.0, 1.0),
    show_default=True,
    help="File's heights that are 0 and 1.",
)
@click.option("--repeat", type=(float, float), default=(1.0, 1.0), show_default=True, help="Tiles along u and along v.")
@click.option(
    "--uv",
    type=click.Choice(["auto", "file", "cylinder", "sphere", "planar", "box"]),
    default="auto",
    show_default=True,
    help="Where texture coordinates come from.",
)
@click.option(
    "--up", type=click.Choice(["x", "y", "z"]), default="y", show_default=True, help="Axis of made coordinates."
)
@click.option(
    "--edges",
    type=click.Choice(["wrap", "cut"]),
    default="wrap",
    show_default=True,
    help="Tiled, or ends at its border.",
)
@click.option("--light", type=_VECTOR, help="Place of a lamp.  [default: colours as they are]")
@click.option("--sun", type=_VECTOR, help="Direction toward a distant light.")
@click.option(
    "--moved", type=PATH, metavar="DIR", help="Deformed copies of MESH in order of names, one for each frame."
)
@click.option(
    "--path", default="orbit:frames=1,up=y", show_default=True, help="Orbit, COLMAP model folder, or transforms.json."
)
@click.option(
    "--repeats", type=click.IntRange(1, 1000), default=1, show_default=True, help="Times each frame is timed."
)
@click.option("--out", type=PATH, required=True, metavar="DIR", help="Folder for the frames.")
def mesh_map(mesh: Path, moved: Path | None, path: str, repeats: int, out: Path, as_json: bool, **given: Any) -> None:
    """Render MESH (glTF, OBJ, PLY or STL) with a relief mapped onto its polygons: OpenEXR with depth, and PNG."""
    import numpy as np

    from ibrpipe.io.paths import is_orbit, orbit, parse_orbit, read_path
    from ibrpipe.io.surfaces.materials import read_relief_meshes
    from ibrpipe.io.surfaces.mesh_materials import read_moved
    from ibrpipe.stages.render import render_path

    if given["light"] and given["sun"]:
        raise click.UsageError("give --light or --sun, not both")
    light = given.pop("light") or ((*given["sun"], 0.0) if given["sun"] else None)
    given.pop("sun")
    asked = {name: given.pop(name) for name in _LOOK}
    look = {name: value for name, value in asked.items() if value is not None}
    checked_options(ReliefRenderer, {"light": light, **look})  # before anything is read
    sources = read_relief_meshes(mesh, **given)
    moves = read_moved(moved) if moved else []
    vertices = np.concatenate([source.mesh.vertices for source in sources])
    bounds = vertices.min(axis=0), vertices.max(axis=0)
    cameras = orbit(parse_orbit(path), bounds) if is_orbit(path) else read_path(Path(path))
    entries = render_path(sources, cameras, out, {"light": light, **look}, repeats, moves)
    if as_json:
        click.echo(json.dumps([each.model_dump(include={"view", "ms", "width", "height"}) for each in entries]))
        return
    thick = ", ".join(f"{source.thickness:.6g}" for source in sources)
    click.echo(f"{out}: {len(entries)} frame{'s' if len(entries) > 1 else ''}, thickness {thick}")


mesh_map.params += [*_look_options(), json_option]


@click.command(epilog=example("ibrpipe relief dual bunny.ply --side +z --texels 512 --out bunny"))
@click.argument("mesh", type=PATH)
@click.option("--side", default="+z", show_default=True, help="Side it is seen from: +x, -x, +y, -y, +z or -z.")
@click.option("--texels", type=click.IntRange(8, 8192), default=512, show_default=True, help="Along the longer edge.")
@mesh_color_option
@click.option("--out", type=PATH, required=True, metavar="DIR", help="Folder for quad.obj and packed.png.")
def dual(mesh: Path, side: str, texels: int, color: Path | None, out: Path) -> None:
    """Sample front and back of MESH onto one rectangle: normal x, y and two depths in one image."""
    from ibrpipe.io.surfaces.colored_meshes import read_colored
    from ibrpipe.modelling.dual_relief import dual_relief_from_mesh, write_relief_quad

    surface, colors = read_colored(mesh, color)
    source = dual_relief_from_mesh(surface, side, texels, colors)
    write_relief_quad(source, out)
    rows, columns = source.height.shape
    click.echo(f"{out}: {columns} x {rows} texels; relief map {out}/quad.obj --packed {out}/packed.png --edges cut "
               f"--thickness {source.thickness:.9g}")  # fmt: skip
