"""glTF binary files of surface models.

Format: glTF 2.0, with KHR_materials_unlit, KHR_materials_ior, KHR_materials_specular, EXT_texture_webp.
"""

from __future__ import annotations

import json
import math
import struct
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ibrpipe.export.surface.model import SurfaceModel
from ibrpipe.export.surface.pictures import Pictures
from ibrpipe.export.surface.placement import rotation_of
from ibrpipe.types import Array
from ibrpipe.types.reflection import ReflectedLight
from ibrpipe.version import VERSION

_ARRAYS, _INDICES = 34962, 34963
_COMPONENTS = {"<f4": 5126, "<u4": 5125, "<u2": 5123}


@dataclass
class _Binary:
    """The file's one buffer, and what lies where in it."""

    data: bytearray
    views: list[dict[str, Any]]
    accessors: list[dict[str, Any]]

    def view(self, content: bytes, target: int | None = None) -> int:
        self.data += b"\0" * (-len(self.data) % 4)
        found = {"buffer": 0, "byteOffset": len(self.data), "byteLength": len(content)}
        self.views.append(found if target is None else {**found, "target": target})
        self.data += content
        return len(self.views) - 1

    def accessor(self, values: Array, kind: str, target: int, **more: Any) -> int:
        found: dict[str, Any] = {
            "bufferView": self.view(values.tobytes(), target),
            "componentType": _COMPONENTS[values.dtype.str],
            "count": len(values),
            "type": kind,
        }
        self.accessors.append({**found, **more})
        return len(self.accessors) - 1


def glb_bytes(
    model: SurfaceModel,
    pictures: Pictures,
    gltf_from_world: Array,
    light: ReflectedLight | None,
    name: str,
    extras: Mapping[str, Any],
) -> bytes:
    """Return a glTF binary file.

    Parameters
    ----------
    model : SurfaceModel
    pictures : Pictures
        With normals: the material is lit; without: unlit.
    gltf_from_world : (4, 4) float64
        A similarity.
    light : ReflectedLight or None
        What a lit material mirrors.
    name : str
        Of mesh, node and material.
    extras : mapping
        JSON that goes into ``asset.extras``.
    """
    binary = _Binary(bytearray(), [], [])
    turn = rotation_of(gltf_from_world)
    places = (model.vertices @ gltf_from_world[:3, :3].T + gltf_from_world[:3, 3]).astype("<f4")
    bounds = {"min": places.min(axis=0).tolist(), "max": places.max(axis=0).tolist()}
    attributes = {"POSITION": binary.accessor(places, "VEC3", _ARRAYS, **bounds)}
    if pictures.normal is not None:
        attributes["NORMAL"] = binary.accessor(unit_floats(model.normals @ turn.T), "VEC3", _ARRAYS)
        tangents = np.column_stack([unit_floats(model.tangents @ turn.T), np.ones(len(places), "<f4")])
        attributes["TANGENT"] = binary.accessor(tangents.astype("<f4"), "VEC4", _ARRAYS)
    attributes["TEXCOORD_0"] = binary.accessor(model.uv.astype("<f4"), "VEC2", _ARRAYS)
    whole = "<u2" if len(places) < 65535 else "<u4"
    indices = binary.accessor(model.faces.astype(whole).reshape(-1), "SCALAR", _INDICES)
    material, images, textures, used = _material(pictures, light, binary)
    document: dict[str, Any] = {
        "asset": {"version": "2.0", "generator": f"ibrpipe {VERSION}", "extras": dict(extras)},
        "scene": 0,
        "scenes": [{"nodes": [0], "name": name}],
        "nodes": [{"mesh": 0, "name": name}],
        "meshes": [
            {"primitives": [{"attributes": attributes, "indices": indices, "material": 0, "mode": 4}], "name": name}
        ],
        "materials": [{"name": name, **material}],
        "samplers": [{"magFilter": 9729, "minFilter": 9729, "wrapS": 33071, "wrapT": 33071}],
        "images": images,
        "textures": textures,
        "accessors": binary.accessors,
        "bufferViews": binary.views,
        "buffers": [{"byteLength": len(binary.data)}],
    }
    if used:
        document["extensionsUsed"] = sorted(used)
    if "EXT_texture_webp" in used:
        document["extensionsRequired"] = ["EXT_texture_webp"]
    return _joined(document, bytes(binary.data))


def ior_of(reflectance: float) -> float:
    """Return the index of refraction whose reflectance at normal incidence is this, below 1."""
    root = math.sqrt(min(reflectance, 0.98))
    return (1.0 + root) / (1.0 - root)


def unit_floats(vectors: Array) -> Array:
    """Return vectors (N, 3) as float32 of length 1."""
    return (vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-300)).astype("<f4")


def _material(
    pictures: Pictures, light: ReflectedLight | None, binary: _Binary
) -> tuple[dict[str, Any], list[dict[str, Any]], list[dict[str, Any]], set[str]]:
    images: list[dict[str, Any]] = []
    textures: list[dict[str, Any]] = []
    used: set[str] = set()

    def texture(content: bytes, name: str) -> dict[str, int]:
        webp = content[:4] == b"RIFF"
        images.append(
            {"bufferView": binary.view(content), "mimeType": f"image/{'webp' if webp else 'png'}", "name": name}
        )
        source = {"source": len(images) - 1}
        used.update({"EXT_texture_webp"} if webp else ())
        textures.append({"sampler": 0, **({"extensions": {"EXT_texture_webp": source}} if webp else source)})
        return {"index": len(textures) - 1}

    surface: dict[str, Any] = {"baseColorTexture": texture(pictures.color, "color"), "metallicFactor": 0.0}
    found: dict[str, Any] = {"pbrMetallicRoughness": surface, "alphaMode": "MASK", "alphaCutoff": 0.5}
    if pictures.normal is None:
        used.add("KHR_materials_unlit")
        return {**found, "extensions": {"KHR_materials_unlit": {}}}, images, textures, used
    found["normalTexture"] = texture(pictures.normal, "normal")
    if light is None:
        surface["roughnessFactor"] = 1.0
        return found, images, textures, used
    # photographed light shines by itself, what is mirrored is added; pictures of surroundings are blurred already
    surface |= {"baseColorFactor": [0.0, 0.0, 0.0, 1.0], "roughnessFactor": 0.0}
    found |= {"emissiveTexture": dict(surface["baseColorTexture"]), "emissiveFactor": [1.0, 1.0, 1.0]}
    specular: dict[str, Any] = {"specularFactor": min(pictures.gloss_scale, 1.0)}
    if pictures.gloss is not None:
        specular["specularTexture"] = texture(pictures.gloss, "gloss")
    found["extensions"] = {
        "KHR_materials_ior": {"ior": ior_of(light.reflectance[0])},
        "KHR_materials_specular": specular,
    }
    used.update(found["extensions"])
    return found, images, textures, used


def _joined(document: dict[str, Any], data: bytes) -> bytes:
    text = json.dumps(document, separators=(",", ":"), allow_nan=False).encode("utf-8")
    text += b" " * (-len(text) % 4)
    data += b"\0" * (-len(data) % 4)
    body = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(data), b"BIN\0") + data
    return struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body
