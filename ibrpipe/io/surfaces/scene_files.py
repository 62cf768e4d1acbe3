"""Mesh files as parts that trimesh has read, with what it reads wrongly put right beforehand."""

from __future__ import annotations

import io
import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ibrpipe.errors import FormatError, IbrError, MissingFileError
from ibrpipe.io.surfaces.gltf_file import KEPT, plain_gltf
from ibrpipe.io.surfaces.mtl_file import Material
from ibrpipe.io.surfaces.obj_file import MATERIALS, plain_obj
from ibrpipe.io.surfaces.ply_polygons import read_polygons
from ibrpipe.io.surfaces.polygons import cut_ears, wrong_as_fans
from ibrpipe.io.untrusted.boundary import reader, reason
from ibrpipe.io.untrusted.inside import leads_inside
from ibrpipe.types import Array

#: name under which the material of an OBJ is kept with trimesh's
OBJ_MATERIAL = "_material"
SUFFIXES = (".ply", ".obj", ".glb", ".gltf", ".stl")


@dataclass(frozen=True, eq=False)
class MeshFile:
    """Parts of a mesh file, where its nodes put them; those of an OBJ know their `Material`."""

    parts: list[Any]


@reader("export the mesh again")
def read_parts(path: Path, materials: bool = True, strict: bool = True) -> MeshFile:
    """Read a mesh file.

    Parameters
    ----------
    path : Path
        PLY, OBJ, GLB/glTF or STL.
    materials : bool
        Textures are wanted, too.
    strict : bool
        A missing texture is an error.

    Raises
    ------
    MissingFileError, FormatError
        The file, or one that it names, does not exist; it is of another kind, damaged, or has no faces.
    """
    import trimesh

    if path.suffix.lower() not in SUFFIXES:
        raise FormatError(f"{path}: unknown kind of mesh file; expected {', '.join(SUFFIXES)}")
    if not path.is_file():
        raise MissingFileError(f"{path}: the mesh does not exist")
    logging.getLogger("trimesh").setLevel(logging.CRITICAL)
    try:
        scene, known = _scene(path, materials, strict)
        parts = [part for part in scene.dump() if isinstance(part, trimesh.Trimesh)]
        for part in parts:
            _transform_tangents(part, scene)
            _keep_material(part, known)
    except IbrError:
        raise
    except Exception as error:  # trimesh raises nearly everything on damaged files
        raise FormatError(f"{path}: the mesh is damaged ({reason(error)}); export it again") from error
    if not parts:
        raise FormatError(f"{path}: holds no triangles; give a surface, not a point cloud or an empty file")
    return MeshFile(parts)


def _scene(path: Path, materials: bool, strict: bool) -> tuple[Any, Mapping[str, Material]]:
    import trimesh

    kind, options = path.suffix.lower()[1:], {"process": False}
    if kind == "obj":
        options["skip_materials"] = not materials
    if kind in ("glb", "gltf"):
        return load_gltf(path, plain_gltf(path, materials, strict), materials), {}
    if kind == "obj":
        plain = plain_obj(path, materials, strict)
        resolver = _Resolver(trimesh.resolvers.FilePathResolver(str(path)), path.parent, plain.mtl)
        scene = trimesh.load_scene(io.BytesIO(plain.text), file_type=kind, resolver=resolver, **options)
        return scene, plain.materials
    if kind == "ply":
        return _ply_scene(path, options), {}
    return trimesh.load_scene(str(path), **options), {}


def load_gltf(path: Path, content: bytes, materials: bool = True) -> Any:
    """Let trimesh read the `content` of the glTF file `path`, as `plain_gltf` returns it."""
    import trimesh

    return trimesh.load_scene(
        io.BytesIO(content),
        file_type=path.suffix.lower()[1:],
        resolver=trimesh.resolvers.FilePathResolver(str(path)),
        process=False,
        skip_materials=not materials,
    )


def _ply_scene(path: Path, options: dict[str, bool]) -> Any:
    import trimesh

    try:
        scene = trimesh.load_scene(str(path), **options)
    except ValueError:
        if b"format binary" not in path.read_bytes()[:1000]:
            raise
        points, polygons = read_polygons(path)  # trimesh takes all faces to be of one size
        return trimesh.Scene(trimesh.Trimesh(points, _triangles(points, polygons), process=False))
    for part in scene.geometry.values():
        _cut_polygons(path, part)
    return scene


class _Resolver:
    """Finds files beside a mesh, and its materials."""

    def __init__(self, files: Any, folder: Path, mtl: bytes) -> None:
        self._files, self._folder, self._mtl = files, folder, mtl

    def get(self, name: str) -> bytes:
        """Return the content of a file."""
        if name == MATERIALS:
            return self._mtl
        place = Path(name)
        inside = place.is_absolute() and leads_inside(self._folder, place)
        return place.read_bytes() if inside else bytes(self._files.get(name))

    def __getitem__(self, name: str) -> bytes:
        return self.get(name)


def _cut_polygons(path: Path, part: Any) -> None:
    """Put polygons of a PLY right that a fan cuts wrongly."""
    stored = getattr(part, "metadata", {}).get("_ply_raw", {})
    polygons = _polygons(stored.get("face", {}).get("data"))
    if polygons is None:
        return
    points = np.column_stack([np.asarray(stored["vertex"]["data"][axis], np.float64) for axis in "xyz"])
    if not wrong_as_fans(points, polygons):
        return
    if len(part.vertices) != len(points):
        raise FormatError(f"{path}: has texture coordinates and polygons that are not convex; export triangles")
    part.faces = _triangles(points, polygons)


def _triangles(points: Array, polygons: Sequence[Array]) -> Array:
    """Cut polygons into triangles, (F, 3) int64."""
    if any(int(np.max(polygon)) >= len(points) or int(np.min(polygon)) < 0 for polygon in polygons):
        raise ValueError(f"a face names a vertex that is not among the {len(points)}")
    wrong, faces = set(wrong_as_fans(points, polygons)), []
    for index, polygon in enumerate(polygons):
        corners = np.asarray(polygon, np.int64)
        fan = np.array([(0, n, n + 1) for n in range(1, len(corners) - 1)], np.int64)
        faces.append(corners[cut_ears(points[corners]) if index in wrong else fan])
    return np.concatenate(faces) if faces else np.zeros((0, 3), np.int64)


def _polygons(data: Any) -> Any:
    """Faces of a PLY as trimesh holds them raw; None where all are triangles or there is no list of them."""
    names = ("vertex_indices", "vertex_index")
    if isinstance(data, dict):
        data = next((data[name] for name in names if name in data), None)
    elif isinstance(data, np.ndarray) and data.dtype.names:
        name = next((name for name in (*names, data.dtype.names[0]) if name in data.dtype.names), None)
        found = None if name is None else data[name]
        data = found["f1"] if found is not None and found.dtype.names and "f1" in found.dtype.names else found
    if data is None or len(data) == 0 or (isinstance(data, np.ndarray) and data.ndim == 2 and data.shape[1] == 3):
        return None
    if isinstance(data, np.ndarray) and data.ndim == 2:
        return data
    return [polygon for polygon in data if len(polygon) >= 3]


def _keep_material(part: Any, known: Mapping[str, Material]) -> None:
    material = getattr(part.visual, "material", None)
    found = known.get(str(getattr(material, "name", None)))
    if material is not None and found is not None:
        material.kwargs = {**(getattr(material, "kwargs", None) or {}), OBJ_MATERIAL: found}


def _transform_tangents(part: Any, scene: Any) -> None:
    """Bring tangents to where the part stands in the scene, as its vertices are."""
    transform, name = scene.graph[part.metadata["node"]]
    tangents: Array | None = scene.geometry[name].vertex_attributes.get(KEPT)
    if tangents is not None:
        part.metadata[KEPT] = np.asarray(tangents, np.float64)[:, :3] @ transform[:3, :3].T
