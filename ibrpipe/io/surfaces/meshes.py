"""Triangle mesh files: PLY, OBJ, GLB/glTF and STL in, binary PLY out. Coordinates stay float64."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ibrpipe.errors import FormatError, IbrError
from ibrpipe.io.surfaces.scene_files import read_parts
from ibrpipe.io.untrusted.boundary import reader
from ibrpipe.types import Array, Mesh

_PLY_KINDS = {"double": "<f8", "float": "<f4", "int": "<i4", "uint": "<u4", "uchar": "u1", "short": "<i2"}


@reader("export the mesh again")
def read_mesh(path: Path) -> Mesh:
    """Read a triangle mesh; a scene's parts are joined, polygons are cut into triangles, materials are left out.

    Parameters
    ----------
    path : Path
        PLY, OBJ, GLB/glTF or STL.

    Returns
    -------
    Mesh
        In the file's own coordinates (a glTF scene's node transforms applied).

    Raises
    ------
    MissingFileError, FormatError
        The file does not exist, is of another kind, is damaged, has no faces, or holds NaN.
    """
    vertices, faces = _load(path)
    try:
        return Mesh(vertices, faces)
    except IbrError as error:
        raise FormatError(f"{path}: {error}") from error


def read_surface(path: Path) -> Mesh:
    """Read a mesh as `read_mesh` does, without vertices that no face uses; raises as that."""
    mesh = read_mesh(path)
    used, faces = np.unique(mesh.faces, return_inverse=True)
    if len(used) == len(mesh.vertices):
        return mesh
    return Mesh(mesh.vertices[used], faces.reshape(-1, 3))


@reader("export the mesh again")
def has_faces(path: Path) -> bool:
    """Say whether a file holds a surface: a PLY may be a point cloud. Other kinds, and damaged files, count as such."""
    if path.suffix.lower() != ".ply":
        return True
    with path.open("rb") as source:
        for _ in range(1000):
            words = source.readline(1000).decode("ascii", "replace").split()
            if words[:2] in (["element", "face"], ["element", "tristrips"]):
                return words[2:] != ["0"]
            if words[:1] == ["end_header"]:
                return False
    return True


def write_mesh(mesh: Mesh, path: Path, values: Mapping[str, Array] | None = None) -> None:
    """Write a binary PLY with double coordinates, so that nothing is lost.

    Parameters
    ----------
    mesh : Mesh
    path : Path
    values : mapping of name to (V,) float32 or int32, optional
        More properties of the vertices.
    """
    extra = {name: np.asarray(value) for name, value in (values or {}).items()}
    kinds = {name: "int" if np.issubdtype(value.dtype, np.integer) else "float" for name, value in extra.items()}
    properties = "".join(f"property {kind} {name}\n" for name, kind in kinds.items())
    header = (
        "ply\nformat binary_little_endian 1.0\n"
        f"element vertex {len(mesh.vertices)}\nproperty double x\nproperty double y\nproperty double z\n{properties}"
        f"element face {len(mesh.faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    layout = [("position", "<f8", 3), *((name, "<i4" if kind == "int" else "<f4") for name, kind in kinds.items())]
    vertices = np.empty(len(mesh.vertices), dtype=layout)
    vertices["position"] = mesh.vertices
    for name, value in extra.items():
        vertices[name] = value
    faces = np.empty(len(mesh.faces), dtype=[("count", "u1"), ("corners", "<i4", 3)])
    faces["count"], faces["corners"] = 3, mesh.faces
    with path.open("wb") as target:
        target.write(header.encode("ascii"))
        target.write(vertices.tobytes())
        target.write(faces.tobytes())


@reader("export the mesh again")
def read_vertex_values(path: Path) -> dict[str, Array]:
    """Read the further properties of the vertices of a PLY that `write_mesh` wrote, name to (V,); none in others."""
    with path.open("rb") as source:
        count, names, kinds = 0, [], []
        for line in iter(source.readline, b""):
            words = line.decode("ascii", "replace").split()
            if words[:2] == ["element", "vertex"]:
                count = int(words[2])
            elif words[:1] == ["property"] and len(words) == 3 and words[1] in _PLY_KINDS:
                kinds.append(_PLY_KINDS[words[1]])
                names.append(words[2])
            elif words[:2] == ["element", "face"]:
                break
        for line in iter(source.readline, b""):
            if line.strip() == b"end_header":
                break
        if names[:3] != ["x", "y", "z"] or not names[3:]:
            return {}
        layout = np.dtype(list(zip(names, kinds)))
        content = source.read(count * layout.itemsize)
    if len(content) < count * layout.itemsize:
        raise FormatError(f"{path}: the mesh was cut off; write it again")
    table = np.frombuffer(content, layout)
    return {name: np.ascontiguousarray(table[name]) for name in names[3:]}


def _load(path: Path) -> tuple[Any, Any]:
    """Vertices (V, 3) float64 and faces (F, 3) as trimesh reads them."""
    parts = read_parts(path, materials=False).parts
    starts = np.cumsum([0] + [len(part.vertices) for part in parts])
    vertices = np.concatenate([np.asarray(part.vertices, np.float64) for part in parts])
    faces = np.concatenate([np.asarray(part.faces, np.int64) + start for part, start in zip(parts, starts)])
    return vertices, faces
