"""Meshes of glTF, OBJ, PLY and STL files with the textures of their materials.

In files v counts upward and normal maps are those of OpenGL (green up); both are turned here, once.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ibrpipe.core.color import srgb_decode
from ibrpipe.errors import FormatError, IbrError, MissingFileError, ValueRangeError
from ibrpipe.io.surfaces.gltf_file import KEPT
from ibrpipe.io.surfaces.mtl_file import Map, Material
from ibrpipe.io.surfaces.relief_images import read_height
from ibrpipe.io.surfaces.scene_files import OBJ_MATERIAL, SUFFIXES, read_parts
from ibrpipe.io.untrusted.boundary import reader
from ibrpipe.types import Array, Mesh

#: entries of an OBJ material that name a normal map, a height map, and one or the other (a normal map has colours)
NORMAL_KEYS, HEIGHT_KEYS, BUMP_KEYS = ("norm", "map_kn"), ("disp", "map_disp"), ("map_bump", "bump")


@dataclass(frozen=True, eq=False)
class Textured:
    """A mesh as a file brings it; uv (F, 3, 2) with v downward, normals and tangents (F, 3, 3), textures, or None."""

    mesh: Mesh
    uv: Array | None
    normals: Array | None
    color: Array | None
    normal: Array | None
    height: Array | None
    tangents: Array | None = None


@reader("export the mesh again")
def read_textured(path: Path) -> Textured:
    """Read a mesh file as one mesh with the textures of its material, where it has them.

    Raises
    ------
    MissingFileError, FormatError
        The file is missing, damaged, or has several textured materials.
    """
    parts = read_parts(path).parts
    groups = _by_material(path, parts)
    textured = [group for group in groups if _is_textured(path, group[0])]
    if len(textured) > 1:
        raise FormatError(f"{path}: has {len(textured)} textured materials; read it with read_relief_meshes")
    return _join(path, parts, textured[0][0] if textured else None)


@reader("export the mesh again")
def read_materials(path: Path) -> list[Textured]:
    """Read a mesh file as one mesh for each textured material, and one for all that has no texture.

    Raises
    ------
    MissingFileError, FormatError
        The file is missing or damaged.
    """
    return [_join(path, group, group[0]) for group in _by_material(path, read_parts(path).parts)]


def read_moved(folder: Path) -> list[Array]:
    """Read the vertices (V, 3) of all meshes of a folder, in order of names.

    Raises
    ------
    MissingFileError, FormatError
        There is no mesh, or one is damaged.
    """
    files = sorted(file for file in folder.glob("*") if file.suffix.lower() in SUFFIXES)
    if not files:
        raise MissingFileError(f"{folder}: holds no mesh files; expected {', '.join(SUFFIXES)}")
    return [_join(file, read_parts(file, strict=False).parts, None).mesh.vertices for file in files]


def _by_material(path: Path, parts: Sequence[Any]) -> list[list[Any]]:
    """Return the parts of every textured material, by its name, then all others."""
    groups: dict[int, list[Any]] = {}
    for part in parts:
        groups.setdefault(id(part.visual.material) if _is_textured(path, part) else 0, []).append(part)
    plain = groups.pop(0, None)
    named = sorted(groups.values(), key=lambda group: str(getattr(group[0].visual.material, "name", "")))
    return [*named, *([plain] if plain else [])]


def _is_textured(path: Path, part: Any) -> bool:
    material = getattr(part.visual, "material", None)
    if material is None:
        return False
    return (
        _image(path, material) is not None
        or any(_named(material, keys) for keys in (NORMAL_KEYS, HEIGHT_KEYS, BUMP_KEYS))
        or (getattr(material, "normalTexture", None) is not None)
    )


def _join(path: Path, parts: Sequence[Any], shown: Any) -> Textured:
    """Return parts as one mesh with the textures of the material of the part `shown`."""
    starts = np.cumsum([0] + [len(part.vertices) for part in parts])
    try:
        mesh = Mesh(
            np.concatenate([np.asarray(part.vertices, np.float64) for part in parts]),
            np.concatenate([np.asarray(part.faces, np.int64) + start for part, start in zip(parts, starts)]),
        )
    except IbrError as error:
        raise FormatError(f"{path}: {error}") from error
    found = [getattr(part.visual, "uv", None) for part in parts]
    uv = None
    if all(each is not None and len(each) for each in found):
        laid = [
            laid_uv(path, np.asarray(each, np.float64), getattr(part.visual, "material", None))
            for each, part in zip(found, parts)
        ]
        uv = np.concatenate([each[part.faces] for each, part in zip(laid, parts)])
        uv = np.ascontiguousarray(np.stack([uv[..., 0], 1.0 - uv[..., 1]], axis=-1))
    material = getattr(shown.visual, "material", None) if shown is not None else None
    textures = _textures(path, material) if material is not None else (None, None, None)
    tangents = [part.metadata.get(KEPT) for part in parts]
    corners = None
    if all(each is not None for each in tangents):
        corners = np.concatenate([each[part.faces] for each, part in zip(tangents, parts)]).astype(np.float32)
    return Textured(mesh, uv, _stored_normals(parts), *textures, tangents=corners)


def _stored_normals(parts: Sequence[Any]) -> Array | None:
    """(F, 3, 3) normals of the corners where all parts bring them."""
    if not all("vertex_normals" in part._cache.cache for part in parts):
        return None
    normals = np.concatenate([np.asarray(part.vertex_normals)[part.faces] for part in parts])
    lengths = np.linalg.norm(normals, axis=-1, keepdims=True)
    return (normals / lengths).astype(np.float32) if (lengths > 0.5).all() else None


def _textures(path: Path, material: Any) -> tuple[Array | None, Array | None, Array | None]:
    """Colour (linear), normals and heights of a material: those of its own image, else alpha of the normal map."""
    color, bumps = material_color(path, material), _normal_image(path, material)
    normal = height = None
    if bumps is not None:
        if "A" in bumps.getbands():
            height = np.asarray(bumps.getchannel("A"), np.float32) / 255.0
        normal = _decoded(2.0 * np.asarray(bumps.convert("RGB"), np.float64) / 255.0 - 1.0, path)
    file, bump = _named(material, HEIGHT_KEYS), _named(material, BUMP_KEYS)
    if file is None and bump is not None and not _is_colored(bump):
        file = bump
    if file is not None:
        height = read_height(file)
    return color, normal, height


def material_color(path: Path, material: Any, factored: bool = True) -> Array | None:
    """Colour texture (H, W, 3) float32, linear, times the material's own colour if `factored`; None without either."""
    image = _image(path, material)
    color = None if image is None else srgb_decode(np.asarray(image.convert("RGB"), np.float32) / 255.0)
    factor = getattr(material, "baseColorFactor", None) if factored else None
    if factor is None and image is None and factored:
        factor = getattr(material, "diffuse", None)  # Kd of an OBJ material
    if factor is not None:
        scale = np.asarray(factor, np.float64).ravel()[:3] / (255.0 if np.asarray(factor).dtype == np.uint8 else 1.0)
        color = scale.reshape(1, 1, 3) if color is None else color * scale
    return None if color is None else np.ascontiguousarray(color, np.float32)


def _image(path: Path, material: Any) -> Any:
    found = getattr(material, "baseColorTexture", None) or getattr(material, "image", None)
    named = _maps(material).get("map_kd")
    if found is None and named is not None:
        raise FormatError(f"{named.file}: the texture that {path.name} names is no image that is read; save it as PNG")
    return found


def _maps(material: Any) -> dict[str, Map]:
    """Maps of an OBJ material by their key."""
    stored: Material | None = (getattr(material, "kwargs", None) or {}).get(OBJ_MATERIAL)
    return {} if stored is None else stored.maps


def laid_uv(path: Path, uv: Array, material: Any) -> Array:
    """Apply scale and offset that an OBJ material gives its maps to texture coordinates (V, 2), v upward."""
    transforms = {(each.scale, each.offset) for each in _maps(material).values()}
    if len(transforms) > 1:
        name = getattr(material, "name", "")
        raise FormatError(f"{path}: maps of the material {name} have different scales or offsets; bake them into one")
    for scale, offset in transforms:
        uv = uv * scale + offset
    return uv


def _named(material: Any, keys: Sequence[str]) -> Path | None:
    """Return the file that an OBJ material names under one of the keys."""
    maps = _maps(material)
    return next((maps[key].file for key in keys if key in maps), None)


def _normal_image(path: Path, material: Any) -> Any:
    from PIL import Image

    image, file = getattr(material, "normalTexture", None), _named(material, NORMAL_KEYS)
    bump = _named(material, BUMP_KEYS)
    if file is None and bump is not None and _is_colored(bump):
        file = bump
    return Image.open(file) if image is None and file is not None else image


def _is_colored(file: Path) -> bool:
    """Tell whether an image has colours other than greys."""
    from PIL import Image

    with Image.open(file) as image:
        if len(image.getbands()) < 3:
            return False
        pixels = np.asarray(image.convert("RGB"), np.int16)
    return bool((np.ptp(pixels, axis=2) > 2).any())


def _decoded(normal: Array, path: Path) -> Array:
    """Turn the green of a normal map downward, make its vectors unit."""
    normal = normal * (1.0, -1.0, 1.0)
    length = np.linalg.norm(normal, axis=-1, keepdims=True)
    if not (length > 1e-3).all():
        raise ValueRangeError(f"{path}: its normal map holds vectors without a length; export it again")
    normal = normal / length
    normal[..., 2] = np.maximum(normal[..., 2], 0.0)
    return np.ascontiguousarray(normal, np.float32)
