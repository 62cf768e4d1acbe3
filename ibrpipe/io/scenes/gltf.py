"""glTF files as scenes: shared meshes as shared parts, nodes as the hierarchy, instances as copies.

trimesh reads the meshes and their textures; nodes are read here, as it knows nothing of EXT_mesh_gpu_instancing and
would make a flat list of them. Cameras, animation, skins and morph targets are left out.
Format: glTF 2.0, sec. 3.5 (nodes).
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ibrpipe.errors import FormatError, IbrError, MissingFileError
from ibrpipe.io.scenes.painted import painted, vertex_colors
from ibrpipe.io.scenes.placement import from_trs
from ibrpipe.io.surfaces.gltf_file import GltfFile, Json, make_plain
from ibrpipe.io.surfaces.scene_files import load_gltf
from ibrpipe.types import Array, Instances, PaintedMesh, Part, Scene

_INSTANCING, _VISIBILITY = "EXT_mesh_gpu_instancing", "KHR_node_visibility"
#: (part, matrices (N, 4, 4))
Held = tuple[str, Array]


def read_gltf(path: Path) -> Scene:
    """Read a .glb or .gltf file; see `ibrpipe.read_scene`."""
    if not path.is_file():
        raise MissingFileError(f"{path}: the scene does not exist")
    logging.getLogger("trimesh").setLevel(logging.CRITICAL)
    try:
        return _Reader(path).scene()
    except IbrError as error:
        if str(error).startswith(str(path)) or isinstance(error, MissingFileError):
            raise
        raise FormatError(f"{path}: {error}") from error
    except (ValueError, TypeError, KeyError, IndexError, AttributeError, OSError, EOFError, ArithmeticError) as error:
        told = " ".join(f"{type(error).__name__}: {error}".split())
        raise FormatError(f"{path}: the scene is damaged ({told}); export it again") from error


class _Reader:
    """One file on its way to a scene."""

    def __init__(self, path: Path) -> None:
        self._path, self._file = path, GltfFile(path)
        make_plain(self._file, known=(_INSTANCING,))
        self._json = self._file.json
        self._nodes: list[Json] = self._json.get("nodes", [])
        self._parts: dict[str, Part] = {}
        self._known: dict[tuple[Any, ...], str] = {}
        self._mesh_names: dict[int, str | None] = {}
        self._meshes = self._read_meshes()

    def scene(self) -> Scene:
        """Return the scene of the file's default scene, or of the first."""
        scenes = self._json.get("scenes", [])
        if scenes:
            top = scenes[self._json.get("scene", 0)].get("nodes", [])
        else:
            inner = {child for node in self._nodes for child in node.get("children", [])}
            top = [index for index in range(len(self._nodes)) if index not in inner]
        held = self._walk(top)
        if not held:
            raise FormatError(f"{self._path}: its scene shows no triangles; export surfaces")
        root = self._part("scene", held)
        return Scene(self._parts, root)

    def _walk(self, top: Sequence[int]) -> list[Held]:
        """Return what the nodes `top` hold; children first, without recursion, as files may be deep."""
        done: dict[int, list[Held]] = {}
        stack, path = [(index, False) for index in reversed(top)], list[int]()
        while stack:
            index, left = stack.pop()
            node = self._nodes[index]
            if left:
                path.pop()
                done[index] = self._held(index, node, done)
                continue
            if index in path:
                raise FormatError(f"{self._path}: node {self._name(index)} is its own child; export the scene again")
            if index in done or node.get("extensions", {}).get(_VISIBILITY, {}).get("visible", True) is False:
                done.setdefault(index, [])
                continue
            path.append(index)
            stack.append((index, True))
            stack += [(child, False) for child in reversed(node.get("children", []))]
        return [each for index in top for each in done[index]]

    def _held(self, index: int, node: Json, done: dict[int, list[Held]]) -> list[Held]:
        """What a node holds, in its parent's coordinates."""
        own: list[Held] = []
        if "mesh" in node:
            name = self._mesh(node["mesh"])
            if name is not None:
                own.append((name, self._copies(index, node)))
        inner = [each for child in node.get("children", []) for each in done[child]]
        if not inner and not own:
            return []
        place = self._place(index, node)
        if inner:
            return [(self._part(str(node.get("name", f"node {index}")), own + inner), place[None])]
        return [(name, place @ matrices) for name, matrices in own]

    def _part(self, wanted: str, held: Sequence[Held]) -> str:
        """Make a part of copies, or find the one that holds the very same; return its name."""
        grouped: dict[str, list[Array]] = {}
        for name, matrices in held:
            grouped.setdefault(name, []).append(matrices)
        children = tuple(Instances(name, np.concatenate(each)) for name, each in grouped.items())
        key = tuple((each.part, each.matrices.tobytes()) for each in children)
        if key not in self._known:
            self._known[key] = self._add(wanted, children=children)
        return self._known[key]

    def _add(self, wanted: str, **content: Any) -> str:
        plain = wanted.replace("/", "_").strip() or "part"
        name, number = plain, 2
        while name in self._parts:
            name, number = f"{plain} {number}", number + 1
        self._parts[name] = Part(name, **content)
        return name

    def _mesh(self, index: int) -> str | None:
        """Name of the part of a mesh; None where it has no triangles."""
        if index not in self._mesh_names:
            meshes = self._meshes.get(index)
            wanted = str(self._json["meshes"][index].get("name", f"mesh {index}"))
            self._mesh_names[index] = self._add(wanted, meshes=tuple(meshes)) if meshes else None
        return self._mesh_names[index]

    def _place(self, index: int, node: Json) -> Array:
        if "matrix" in node:
            matrix = np.array(node["matrix"], np.float64).reshape(4, 4).T
        else:
            parts = (("translation", (0, 0, 0)), ("rotation", (0, 0, 0, 1)), ("scale", (1, 1, 1)))
            matrix = from_trs(*(np.array([node.get(name, usual)], np.float64) for name, usual in parts))[0]
        if not np.isfinite(matrix).all():
            raise FormatError(f"{self._path}: the matrix of node {self._name(index)} holds NaN or infinity; repair it")
        return matrix

    def _copies(self, index: int, node: Json) -> Array:
        """Matrices (N, 4, 4) of the copies of a node's mesh, in the node's coordinates."""
        stated = node.get("extensions", {}).get(_INSTANCING)
        if stated is None:
            return np.eye(4)[None]
        found = {name: self._file.values(number) for name, number in stated["attributes"].items()}
        counts = {len(values) for values in found.values()}
        if len(counts) != 1:
            raise FormatError(
                f"{self._path}: the copies of node {self._name(index)} have {sorted(counts)} places, turns and sizes; "
                "expected one of each a copy: export the scene again"
            )
        count = counts.pop()
        parts = (("TRANSLATION", (0, 0, 0)), ("ROTATION", (0, 0, 0, 1)), ("SCALE", (1, 1, 1)))
        values = [np.asarray(found.get(name, np.tile(usual, (count, 1))), np.float64) for name, usual in parts]
        if not all(np.isfinite(each).all() for each in values):
            raise FormatError(f"{self._path}: copies of node {self._name(index)} are placed at NaN or infinity")
        lengths = np.linalg.norm(values[1], axis=1, keepdims=True)  # stored in few bits
        values[1] = values[1] / np.where(lengths > 0, lengths, 1.0)
        return from_trs(*values)

    def _name(self, index: int) -> str:
        return repr(self._nodes[index].get("name", index))

    def _read_meshes(self) -> dict[int, list[PaintedMesh]]:
        """Read all primitives, each as a mesh of its own without a node's transform, by the mesh they belong to."""
        stored = self._json.get("meshes", [])
        single = [(number, each) for number, mesh in enumerate(stored) for each in mesh["primitives"]]
        flat = {**self._json, "meshes": [{"name": f"p{k}", "primitives": [each]} for k, (_, each) in enumerate(single)]}
        flat["nodes"] = [{"name": f"n{k}", "mesh": k} for k in range(len(single))]
        flat |= {"scene": 0, "scenes": [{"nodes": list(range(len(single)))}]}
        for name in ("skins", "animations", "cameras", "extensionsRequired"):
            flat.pop(name, None)
        geometry = load_gltf(self._path, self._file.content(flat)).geometry if single else {}
        found: dict[int, list[PaintedMesh]] = {}
        for k, (number, primitive) in enumerate(single):
            part = geometry.get(f"p{k}")
            if part is not None and hasattr(part, "faces") and len(part.faces):
                paint = vertex_colors(self._path, part, self._factor(primitive))
                found.setdefault(number, []).append(painted(self._path, part, paint))
        return found

    def _factor(self, primitive: Json) -> list[float] | None:
        if "material" not in primitive:
            return None
        material = self._json["materials"][primitive["material"]]
        older = material.get("extensions", {}).get("KHR_materials_pbrSpecularGlossiness", {})
        factor = material.get("pbrMetallicRoughness", {}).get("baseColorFactor", older.get("diffuseFactor", [1, 1, 1]))
        return [float(each) for each in factor[:3]]
