"""OBJ files made plain before trimesh reads them: faces that it cuts or counts wrongly, materials that it leaves out.

trimesh cuts every polygon as a fan and counts relative indices from the file's end.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ibrpipe.errors import FormatError
from ibrpipe.io.surfaces.mtl_file import Material, plain_mtl, read_mtl
from ibrpipe.io.surfaces.polygons import cut_ears, wrong_as_fans
from ibrpipe.types import Array

#: name under which trimesh asks for the materials
MATERIALS = "materials.mtl"


@dataclass(frozen=True, eq=False)
class PlainObj:
    """What trimesh is given.

    Attributes
    ----------
    text : bytes
        Of the OBJ file.
    materials : mapping of str to Material
    mtl : bytes
        Text of all materials; empty = none.
    """

    text: bytes
    materials: dict[str, Material]
    mtl: bytes


def plain_obj(path: Path, materials: bool = True, strict: bool = True) -> PlainObj:
    """Return the content of a file with faces that trimesh reads rightly, and one material file.

    Parameters
    ----------
    path : Path
    materials : bool
        Textures are wanted.
    strict : bool
        What the materials name must exist.

    Raises
    ------
    FormatError, MissingFileError
        A face names a vertex that is not there; a material file or a texture is missing.
    """
    stored = path.read_bytes()
    try:
        text = stored.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = stored.decode("latin-1")
    lines = text.replace("\\\r\n", " ").replace("\\\n", " ").splitlines()
    named = [line.split(maxsplit=1)[1].strip() for line in lines if line.startswith("mtllib") and len(line.split()) > 1]
    known = read_mtl(path, named, strict) if materials and named else {}
    kept = [line for line in lines if not line.startswith("mtllib")]
    if materials and named:
        kept.insert(0, f"mtllib {MATERIALS}")
    changed = _faces(path, kept)
    return PlainObj("\n".join(changed).encode("utf-8"), known, plain_mtl(known))


def _faces(path: Path, lines: list[str]) -> list[str]:
    """Return the lines with absolute indices, and with triangles for what a fan would cut wrongly."""
    at = [index for index, line in enumerate(lines) if line.startswith(("f ", "f\t"))]
    if any("-" in lines[index] for index in at):
        _make_absolute(path, lines)
    many = [index for index in at if len(lines[index].split()) > 4]
    if not many:
        return lines
    try:
        points = np.array([line.split()[1:4] for line in lines if line.startswith(("v ", "v\t"))], np.float64)
        polygons = [np.array([int(word.partition("/")[0]) - 1 for word in lines[index].split()[1:]]) for index in many]
        wrong = [many[row] for row in _within(path, points, polygons)]
    except ValueError as error:
        raise FormatError(f"{path}: the mesh is damaged ({error}); export it again") from error
    for index in wrong:
        words = lines[index].split()[1:]
        corners = points[[int(word.partition("/")[0]) - 1 for word in words]]
        lines[index] = "\n".join(f"f {' '.join(words[n] for n in triangle)}" for triangle in cut_ears(corners))
    return lines


def _within(path: Path, points: Array, polygons: list[Array]) -> list[int]:
    largest = max(int(polygon.max()) for polygon in polygons)
    if largest >= len(points) or min(int(polygon.min()) for polygon in polygons) < 0:
        raise FormatError(f"{path}: a face names vertex {largest + 1} of {len(points)}; export the mesh again")
    return wrong_as_fans(points, polygons)


def _make_absolute(path: Path, lines: list[str]) -> None:
    """Count relative indices from where they stand, as the format does."""
    counts = {"v": 0, "vt": 0, "vn": 0}
    for index, line in enumerate(lines):
        kind = line.split(maxsplit=1)[0] if line.strip() else ""
        if kind in counts:
            counts[kind] += 1
        elif kind == "f" and "-" in line:
            corners = []
            for word in line.split()[1:]:
                pairs = zip(word.split("/"), counts.values())
                corners.append("/".join(_absolute(path, number, count) for number, count in pairs))
            lines[index] = f"f {' '.join(corners)}"


def _absolute(path: Path, number: str, count: int) -> str:
    if not number.startswith("-"):
        return number
    try:
        value = count + 1 + int(number)
    except ValueError as error:
        raise FormatError(f"{path}: the mesh is damaged ({error}); export it again") from error
    if value < 1:
        raise FormatError(f"{path}: a face counts {number} back from {count}; export the mesh again")
    return str(value)
