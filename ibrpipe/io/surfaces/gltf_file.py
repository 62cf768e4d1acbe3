"""glTF and GLB files made plain before trimesh reads them: floats for quantised numbers, one set of coordinates.

trimesh takes integers as they are stored, knows neither sparse accessors nor KHR_texture_transform, and shows textures
by TEXCOORD_0 alone; Draco needs the package DracoPy. Format: glTF 2.0, sec. 3.6 (accessors), 4.4 (GLB).
"""

from __future__ import annotations

import base64
import importlib.util
import json
import struct
from collections.abc import Collection
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np

from ibrpipe.errors import FormatError, MissingFileError
from ibrpipe.io.untrusted.boundary import reason
from ibrpipe.io.untrusted.inside import inside
from ibrpipe.types import Array

#: names under which trimesh keeps tangents, which it else leaves out
TANGENT, KEPT = "TANGENT", "_TANGEN"
#: and colours, of which it keeps 8 bits
COLOR, KEPT_COLOR = "COLOR_0", "_COLOR"
_DRACO, _TRANSFORM, _QUANTIZED = "KHR_draco_mesh_compression", "KHR_texture_transform", "KHR_mesh_quantization"
_KNOWN = (_DRACO, _TRANSFORM, _QUANTIZED, "EXT_texture_webp", "KHR_lights_punctual", "KHR_node_visibility")
_TYPES = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
_FLOATS = ("POSITION", "NORMAL", TANGENT, "TEXCOORD", COLOR)
_TEXTURES = ("baseColorTexture", "diffuseTexture", "normalTexture")
Json = dict[str, Any]
_BESIDE = "put what the mesh names beside it, and export it again"


def plain_gltf(path: Path, materials: bool = True, strict: bool = True) -> bytes:
    """Return the content of a file with plain floats, coordinates as its textures use them, and no Draco.

    Parameters
    ----------
    path : Path
        .glb or .gltf.
    materials : bool
        Textures are wanted.
    strict : bool
        What the materials name must exist.

    Raises
    ------
    FormatError, MissingFileError
        Damaged, an extension that is needed and not known, Draco without DracoPy, a missing file.
    """
    file = GltfFile(path)
    make_plain(file, materials, strict)
    return file.content()


def make_plain(file: GltfFile, materials: bool = True, strict: bool = True, known: Collection[str] = ()) -> None:
    """Do the same to a file in memory; extensions in `known` are the caller's."""
    path = file.path
    required = [name for name in file.json.get("extensionsRequired", []) if not name.startswith("KHR_materials_")]
    unknown = [name for name in required if name not in (*_KNOWN, *known) and (materials or "texture" not in name)]
    if unknown:
        raise FormatError(f"{path}: needs {', '.join(unknown)}, which is not read; export it without, as plain glTF")
    file.check_buffers()
    if materials:
        _check_images(file, strict)
    for mesh in file.json.get("meshes", []):
        for primitive in mesh["primitives"]:
            _make_plain(file, primitive, materials)


class GltfFile:
    """A file in memory, to which accessors can be added."""

    def __init__(self, path: Path) -> None:
        self.path, self.changed = path, False
        self.chunks: list[tuple[bytes, bytes]] = []
        self._buffers: dict[int, bytes] = {}
        text = stored = path.read_bytes()
        if stored[:4] == b"glTF":
            at = 12
            while at + 8 <= len(stored):
                length, kind = struct.unpack_from("<I4s", stored, at)
                self.chunks.append((kind, stored[at + 8 : at + 8 + length]))
                at += 8 + length
            text = self.chunks[0][1] if self.chunks else b""
        try:
            self.json: Json = json.loads(text)
        except (ValueError, RecursionError) as error:
            raise FormatError(f"{path}: the mesh is damaged ({reason(error)}); export it again") from error
        if not isinstance(self.json, dict):
            raise FormatError(f"{path}: the mesh is damaged (its JSON is no object); export it again")

    def view(self, index: int) -> bytes:
        """Return the bytes of a buffer view."""
        view = self.json["bufferViews"][index]
        number, start = view["buffer"], view.get("byteOffset", 0)
        if number not in self._buffers:
            self._buffers[number] = self._buffer(self.json["buffers"][number])
        return self._buffers[number][start : start + view["byteLength"]]

    def _buffer(self, buffer: Json) -> bytes:
        uri = buffer.get("uri")
        if uri is None:
            return next((content for kind, content in self.chunks if kind == b"BIN\0"), b"")
        if uri.startswith("data:"):
            return base64.b64decode(uri.partition(",")[2])
        return self._beside(uri).read_bytes()

    def check_buffers(self) -> None:
        """Look for the files of buffers beside the mesh: trimesh reads those that need no change by itself."""
        for buffer in self.json.get("buffers", []):
            if not buffer.get("uri", "data:").startswith("data:"):
                self._beside(buffer["uri"])

    def _beside(self, uri: str) -> Path:
        found = inside(self.path.parent, unquote(uri), self.path, _BESIDE)
        if not found.is_file():
            raise MissingFileError(f"{found}: the buffer that {self.path.name} names does not exist; put it there")
        return found

    def values(self, index: int) -> Array:
        """Return the numbers of an accessor, (count, width): floats where they are normalised, sparse ones in place."""
        accessor = self.json["accessors"][index]
        width, count = _WIDTHS[accessor["type"]], accessor["count"]
        kind = np.dtype(_TYPES[accessor["componentType"]])
        found = np.zeros((count, width), kind)
        if "bufferView" in accessor:
            stride = self.json["bufferViews"][accessor["bufferView"]].get("byteStride") or width * kind.itemsize
            data = self.view(accessor["bufferView"])[accessor.get("byteOffset", 0) :]
            found = np.ndarray((count, width), kind, data, strides=(stride, kind.itemsize)).copy()
        if "sparse" in accessor:
            sparse = accessor["sparse"]
            part = sparse["indices"]
            rows = np.frombuffer(
                self.view(part["bufferView"]), _TYPES[part["componentType"]], sparse["count"], part.get("byteOffset", 0)
            )
            part = sparse["values"]
            new = np.frombuffer(self.view(part["bufferView"]), kind, sparse["count"] * width, part.get("byteOffset", 0))
            found[rows] = new.reshape(-1, width)
        if accessor.get("normalized") and kind.kind in "iu":
            return np.maximum(found.astype(np.float64) / np.iinfo(kind).max, -1.0)
        return found

    def add(self, values: Array, like: Json | None = None) -> Json:
        """Store numbers; return an accessor of them."""
        whole = np.issubdtype(values.dtype, np.integer)
        stored = np.ascontiguousarray(values, "<u4" if whole else "<f4")
        rows = stored.reshape(len(stored), -1)
        names = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4"}
        buffers, views = self.json.setdefault("buffers", []), self.json.setdefault("bufferViews", [])
        data = rows.tobytes()
        uri = "data:application/octet-stream;base64," + base64.b64encode(data).decode("ascii")
        buffers.append({"byteLength": len(data), "uri": uri})
        views.append({"buffer": len(buffers) - 1, "byteLength": len(data)})
        self.changed = True
        return {
            "bufferView": len(views) - 1,
            "componentType": 5125 if whole else 5126,
            "count": len(rows),
            "type": like["type"] if like else names[rows.shape[1]],
        }

    def content(self, instead: Json | None = None) -> bytes:
        """Return the file with what was changed, or with another JSON."""
        if not self.changed and instead is None:
            return self.path.read_bytes()
        text = json.dumps(self.json if instead is None else instead).encode("utf-8")
        if not self.chunks:
            return text
        text += b" " * (-len(text) % 4)
        body = b"".join(
            struct.pack("<I4s", len(content), kind) + content for kind, content in [(b"JSON", text), *self.chunks[1:]]
        )
        return struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body


def _make_plain(file: GltfFile, primitive: Json, materials: bool) -> None:
    attributes, accessors = primitive["attributes"], file.json["accessors"]
    packed = primitive.get("extensions", {}).get(_DRACO)
    if packed is not None and "bufferView" not in accessors[attributes["POSITION"]]:
        _unpack(file, primitive, packed)
    wanted = [index for name, index in attributes.items() if name.startswith(_FLOATS)]
    for index in [*wanted, *([primitive["indices"]] if "indices" in primitive else [])]:
        accessor = accessors[index]
        integer = accessor["componentType"] != 5126 and index in wanted
        if integer or "sparse" in accessor:
            values = file.values(index)
            accessors[index] = file.add(values.astype(np.float64) if index in wanted else values, accessor)
    if materials and "material" in primitive:
        _lay_texture(file, primitive)
    if TANGENT in attributes:
        attributes[KEPT] = attributes.pop(TANGENT)
        file.changed = True
    if COLOR in attributes:
        attributes[KEPT_COLOR] = attributes.pop(COLOR)
        file.changed = True


def _unpack(file: GltfFile, primitive: Json, packed: Json) -> None:
    if importlib.util.find_spec("DracoPy") is None:
        raise FormatError(
            f"{file.path}: is compressed by Draco, which needs a package; type: pip install 'ibrpipe[draco]', or "
            "export the mesh without compression"
        )
    import DracoPy

    try:
        found = DracoPy.decode(file.view(packed["bufferView"]))
    except Exception as error:  # DracoPy raises its own and others
        raise FormatError(f"{file.path}: its Draco data are damaged ({error}); export the mesh again") from error
    names, accessors = {number: name for name, number in packed["attributes"].items()}, file.json["accessors"]
    for each in found.attributes:
        name = names.get(each["unique_id"])
        if name in primitive["attributes"]:
            accessors[primitive["attributes"][name]] = file.add(np.asarray(each["data"], np.float64))
    if "indices" in primitive:
        accessors[primitive["indices"]] = file.add(np.asarray(found.faces, np.uint32).reshape(-1))
    del primitive["extensions"][_DRACO]


def _lay_texture(file: GltfFile, primitive: Json) -> None:
    """Give a primitive the texture coordinates that its material's textures are laid by, as TEXCOORD_0."""
    material = file.json["materials"][primitive["material"]]
    parts = [material, material.get("pbrMetallicRoughness", {})]
    used = [(name, part[name]) for part in parts for name in _TEXTURES if name in part]
    transforms = {name: _uv_transform(info) for name, info in used}
    if not transforms or all(each == (0, (0.0, 0.0), 0.0, (1.0, 1.0)) for each in transforms.values()):
        return
    if len(set(transforms.values())) > 1:
        raise FormatError(
            f"{file.path}: {' and '.join(transforms)} of the material {material.get('name', primitive['material'])} "
            "use different texture coordinates; expected the same for both: bake them into one set"
        )
    number, offset, rotation, scale = next(iter(transforms.values()))
    name = f"TEXCOORD_{number}"
    if name not in primitive["attributes"]:
        raise FormatError(f"{file.path}: a material uses {name}, which the mesh does not have; export it again")
    uv = file.values(primitive["attributes"][name]).astype(np.float64) * scale
    sin, cos = np.sin(rotation), np.cos(rotation)
    uv = uv @ np.array([[cos, -sin], [sin, cos]]) + offset
    file.json["accessors"].append(file.add(uv))
    primitive["attributes"]["TEXCOORD_0"] = len(file.json["accessors"]) - 1


def _uv_transform(info: Json) -> tuple[int, tuple[float, ...], float, tuple[float, ...]]:
    """Which coordinates a texture is laid by, and offset, rotation and scale of them."""
    change = info.get("extensions", {}).get(_TRANSFORM, {})
    number = change.get("texCoord", info.get("texCoord", 0))
    offset, scale = (
        tuple(map(float, change.get(name, value))) for name, value in (("offset", (0, 0)), ("scale", (1, 1)))
    )
    return int(number), offset, float(change.get("rotation", 0.0)), scale


def _check_images(file: GltfFile, strict: bool) -> None:
    """Look for the files of textures beside the mesh: trimesh leaves out in silence what it does not find."""
    for image in file.json.get("images", []):
        uri = image.get("uri", "data:")
        if strict and (image.get("mimeType") == "image/ktx2" or uri.lower().endswith(".ktx2")):
            raise FormatError(f"{file.path}: a texture is KTX2, which is not read; export it with PNG or JPEG textures")
        if uri.startswith("data:"):
            continue
        found = inside(file.path.parent, unquote(uri), file.path, _BESIDE)
        if strict and not found.is_file():
            raise MissingFileError(f"{found}: the texture that {file.path.name} names does not exist; put it there")
