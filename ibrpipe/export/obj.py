"""An asset as Wavefront OBJ with its material and picture."""

from __future__ import annotations

import re
from pathlib import Path

from ibrpipe.export.registry import Exporter
from ibrpipe.export.surface.gltf import unit_floats
from ibrpipe.export.surface.model import SurfaceModel, build_model
from ibrpipe.export.surface.pictures import encode, shrunk
from ibrpipe.export.surface.placement import rotation_of
from ibrpipe.export.surface.settings import SurfaceOptions
from ibrpipe.export.surface.source import read_source
from ibrpipe.export.whole_file import megabytes, write_files
from ibrpipe.types import Array

#: settings where none are given
DEFAULTS = SurfaceOptions()


def write(source: Path, target: Path, options: SurfaceOptions = DEFAULTS) -> str:
    """Write the asset in folder `source` as `target`, with ``NAME.mtl`` and ``NAME.png`` beside it.

    y is up, lengths are metres where the unit is known, as in glTF. Return what was written.

    Raises
    ------
    MissingFileError, FormatError
        The asset is missing, damaged, or shows nothing.
    ConfigError, ResourceError
        The files cannot be written.
    """
    given = read_source(source, target)
    model = build_model(given.asset, given.cameras, options.tolerance)
    name = re.sub(r"[^\w.-]+", "-", target.stem).lstrip("-") or "surface"  # of any script; no spaces, no options
    picture = encode(shrunk(model.color), "png", 0)
    files = {
        f"{name}.png": picture,
        f"{name}.mtl": _material(f"{name}.png").encode("utf-8"),
        target.name: _geometry(model, given.gltf_from_world, f"{name}.mtl").encode("utf-8"),
    }
    write_files(target.parent, files)
    return f"{model.told()}, {megabytes(sum(map(len, files.values())))}"


def _material(picture: str) -> str:
    return f"newmtl surface\nKa 0 0 0\nKd 1 1 1\nKs 0 0 0\nillum 1\nmap_Kd {picture}\nmap_d {picture}\n"


def _geometry(model: SurfaceModel, gltf_from_world: Array, material: str) -> str:
    turn = rotation_of(gltf_from_world)
    places = model.vertices @ gltf_from_world[:3, :3].T + gltf_from_world[:3, 3]
    lines = [f"mtllib {material}", "o surface"]
    lines += [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in places.tolist()]
    lines += [f"vt {u:.7f} {1.0 - v:.7f}" for u, v in model.uv.tolist()]
    lines += [f"vn {x:.5f} {y:.5f} {z:.5f}" for x, y, z in unit_floats(model.normals @ turn.T).tolist()]
    lines += ["usemtl surface"]
    lines += [f"f {a}/{a}/{a} {b}/{b}/{b} {c}/{c}/{c}" for a, b, c in (model.faces + 1).tolist()]
    return "\n".join(lines) + "\n"


EXPORTER = Exporter("obj", "Mesh with an atlas as OBJ, MTL and PNG.", write, (".obj",), Options=SurfaceOptions)
