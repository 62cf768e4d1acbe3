"""Textured meshes with a relief: glTF and OBJ with the textures of their material, or with files given beside them.

In files v counts upward and normal maps are those of OpenGL (green up); both are turned here, once.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ibrpipe.core.color import srgb_decode
from ibrpipe.errors import FormatError, IbrError, MissingFileError, ShapeError, ValueRangeError
from ibrpipe.io.image_files import read_stored
from ibrpipe.io.meshes import SUFFIXES
from ibrpipe.io.relief_images import read_color, read_height, read_normals, read_relief_folder
from ibrpipe.io.uv_maps import map_mesh
from ibrpipe.relief_mesh import ReliefMesh
from ibrpipe.types import Array, Mesh

#: thickness of a relief that is not told, as a share of the mean size of one texture on the mesh
THICKNESS = 0.05


@dataclass(frozen=True, eq=False)
class Textured:
    """A mesh as a file brings it: texture coordinates (F, 3, 2) with v downward, and its textures, or None."""

    mesh: Mesh
    uv: Array | None
    normals: Array | None
    color: Array | None
    normal: Array | None
    height: Array | None


def read_relief_mesh(
    path: str | Path,
    relief: str | Path | None = None,
    *,
    height: str | Path | None = None,
    color: str | Path | None = None,
    normal: str | Path | None = None,
    packed: str | Path | None = None,
    thickness: float | None = None,
    height_range: tuple[float, float] = (0.0, 1.0),
    repeat: tuple[float, float] = (1.0, 1.0),
    uv: str = "auto",
    up: str = "y",
    edges: str = "wrap",
    green_up: bool = True,
) -> ReliefMesh:
    """Read a mesh whose polygons carry a relief.

    Parameters
    ----------
    path : path
        glTF, GLB, OBJ, PLY or STL. All its parts become one mesh with one material.
    relief : path, optional
        Folder with ``height.*`` and, where there are any, ``color.*`` and ``normal_gl.*``.
    height, color, normal : path, optional
        Single files; they come before the folder's, and those before the textures of the mesh file. Where no height map
        is given, heights are the alpha of the normal map.
    packed : path, optional
        Image of four channels: x and y of the normal, depth of the front, depth of the back (see `write_packed`).
    thickness : float, optional
        Scene units from height 0 to height 1; a twentieth of a texture's mean size on the mesh unless given.
    height_range : (low, high)
        Heights in the file that are 0 and 1; files of integers run from 0 to 1.
    repeat : (along u, along v)
        How often the texture is repeated along the texture coordinates.
    uv : {"auto", "file", "cylinder", "sphere", "planar", "box"}
        Where texture coordinates come from; auto: from the file, where it has none a cylinder.
    up : {"x", "y", "z"}
        Axis of made texture coordinates.
    edges : {"wrap", "cut"}
    green_up : bool
        The normal map's second component points up the picture (OpenGL); otherwise down (DirectX).

    Returns
    -------
    ReliefMesh

    Raises
    ------
    MissingFileError, FormatError, ShapeError, ValueRangeError
        Files are missing or damaged, there is no height, or heights leave 0 to 1.
    """
    file = Path(path)
    found = read_textured(file)
    pictures: dict[str, Any] = {"color": found.color, "normal": found.normal, "height": found.height, "back": None}
    if relief is not None:
        folder = read_relief_folder(relief)
        pictures.update(height=folder.height, normal=folder.normal)
        pictures["color"] = folder.color if folder.color is not None else pictures["color"]
    if packed is not None:
        pictures.update(read_packed(packed, green_up))
    if normal is not None:
        pictures["normal"] = read_normals(normal, green_up)
        pictures["height"] = _alpha(Path(normal)) if height is None else None
    if height is not None:
        pictures["height"] = read_height(height)
    if color is not None:
        pictures["color"] = read_color(color)
    if pictures["height"] is None:
        raise FormatError(f"{file}: brings no heights (alpha of its normal map); give height, relief or packed")
    low, high = height_range
    if not (np.isfinite([low, high]).all() and low != high):
        raise ValueRangeError(f"height_range is {height_range}; give two different finite numbers")
    pictures["height"] = (pictures["height"] - low) / (high - low)
    coordinates = _coordinates(file, found, uv, up) * np.asarray(repeat, np.float64)
    try:
        return ReliefMesh(
            found.mesh,
            coordinates,
            thickness=thickness or THICKNESS * texture_size(found.mesh, coordinates),
            edges=edges,
            normals=found.normals,
            **pictures,
        )
    except IbrError as error:
        raise type(error)(f"{height or packed or normal or relief or file}: {error}") from error


def texture_size(mesh: Mesh, uv: Array) -> float:
    """Return the side of a square on the mesh that has the area which one texture covers on average, scene units."""
    from ibrpipe.core.normals import face_normals

    world = float(np.linalg.norm(face_normals(mesh.vertices, mesh.faces), axis=1).sum())
    p, q = uv[:, 1] - uv[:, 0], uv[:, 2] - uv[:, 0]
    textures = float(np.abs(p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]).sum())
    return float(np.sqrt(world / textures)) if textures > 0 and world > 0 else 1.0


def _coordinates(file: Path, found: Textured, uv: str, up: str) -> Array:
    if uv == "file" and found.uv is None:
        raise FormatError(f"{file}: has no texture coordinates; choose uv cylinder, sphere, planar or box")
    if uv in ("auto", "file") and found.uv is not None:
        return found.uv
    return map_mesh(found.mesh, "cylinder" if uv == "auto" else uv, up)


def read_textured(path: Path) -> Textured:
    """Read a mesh file with texture coordinates and the textures of its material, where it has them.

    Raises
    ------
    MissingFileError, FormatError
        The file is missing, damaged, or has several materials.
    """
    import trimesh

    if path.suffix.lower() not in SUFFIXES:
        raise FormatError(f"{path}: unknown kind of mesh file; expected {', '.join(SUFFIXES)}")
    if not path.is_file():
        raise MissingFileError(f"{path}: the mesh does not exist")
    logging.getLogger("trimesh").setLevel(logging.CRITICAL)
    try:
        scene = trimesh.load_scene(str(path), process=False)
        parts = [part for part in scene.dump() if isinstance(part, trimesh.Trimesh)]
    except (ValueError, TypeError, KeyError, IndexError, AttributeError, OSError, EOFError, ArithmeticError) as error:
        raise FormatError(f"{path}: the mesh is damaged ({' '.join(str(error).split())}); export it again") from error
    if not parts:
        raise FormatError(f"{path}: holds no triangles; give a surface, not a point cloud or an empty file")
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
        uv = np.concatenate([np.asarray(each, np.float64)[part.faces] for each, part in zip(found, parts)])
        uv = np.ascontiguousarray(np.stack([uv[..., 0], 1.0 - uv[..., 1]], axis=-1))
    return Textured(mesh, uv, _stored_normals(parts), *_textures(path, parts))


def _stored_normals(parts: list[Any]) -> Array | None:
    """(F, 3, 3) normals of the corners where all parts bring them."""
    if not all("vertex_normals" in part._cache.cache for part in parts):
        return None
    normals = np.concatenate([np.asarray(part.vertex_normals)[part.faces] for part in parts])
    lengths = np.linalg.norm(normals, axis=-1, keepdims=True)
    return (normals / lengths).astype(np.float32) if (lengths > 0.5).all() else None


def _textures(path: Path, parts: list[Any]) -> tuple[Array | None, Array | None, Array | None]:
    """Colour (linear), normals and heights (alpha of the normal map) of the one material."""
    materials = {id(part.visual.material): part.visual.material for part in parts if hasattr(part.visual, "material")}
    shown = [each for each in materials.values() if _image(each) is not None or _normal_image(path, each) is not None]
    if len(shown) > 1:
        raise FormatError(f"{path}: has {len(shown)} textured materials; split it and read one at a time")
    if not shown:
        return None, None, None
    image, bumps = _image(shown[0]), _normal_image(path, shown[0])
    color = normal = height = None
    if image is not None:
        color = srgb_decode(np.asarray(image.convert("RGB"), np.float32) / 255.0)
        factor = getattr(shown[0], "baseColorFactor", None)
        if factor is not None:
            scale = np.asarray(factor, np.float64)[:3]
            color = color * (scale / 255.0 if np.asarray(factor).dtype == np.uint8 else scale)
        color = np.ascontiguousarray(color, np.float32)
    if bumps is not None:
        if "A" in bumps.getbands():
            height = np.asarray(bumps.getchannel("A"), np.float32) / 255.0
        normal = _decoded(2.0 * np.asarray(bumps.convert("RGB"), np.float64) / 255.0 - 1.0, path)
    return color, normal, height


def _image(material: Any) -> Any:
    return getattr(material, "baseColorTexture", None) or getattr(material, "image", None)


def _normal_image(path: Path, material: Any) -> Any:
    from PIL import Image

    image = getattr(material, "normalTexture", None)
    names = getattr(material, "kwargs", None) or {}
    for key in ("norm", "map_kn"):
        if image is None and names.get(key):
            file = path.parent / str(names[key][-1])
            if not file.is_file():
                raise MissingFileError(f"{file}: the normal map that {path.name} names does not exist")
            image = Image.open(file)
    return image


def _decoded(normal: Array, path: Path) -> Array:
    """Turn the green of a normal map downward, make its vectors unit."""
    normal = normal * (1.0, -1.0, 1.0)
    length = np.linalg.norm(normal, axis=-1, keepdims=True)
    if not (length > 1e-3).all():
        raise ValueRangeError(f"{path}: its normal map holds vectors without a length; export it again")
    normal = normal / length
    normal[..., 2] = np.maximum(normal[..., 2], 0.0)
    return np.ascontiguousarray(normal, np.float32)


def _alpha(path: Path) -> Array | None:
    """Alpha of a normal map as heights, 0 to 1; None where it has none."""
    pixels, header = read_stored(path)
    if not header.has_alpha:
        return None
    alpha = pixels[:, :, header.channels.index("A")].astype(np.float32)
    return alpha / np.iinfo(pixels.dtype).max if header.integer else alpha


def read_packed(path: str | Path, green_up: bool = True) -> dict[str, Array]:
    """Read a packed relief: height, back (1 minus the depths) and normal, z of the normal from its x and y.

    Raises
    ------
    ShapeError
        The image has not four channels.
    """
    pixels, header = read_stored(Path(path))
    if pixels.shape[2] != 4:
        raise ShapeError(f"{path}: a packed relief has four channels, got {pixels.shape[2]}")
    values = pixels.astype(np.float64) / (np.iinfo(pixels.dtype).max if header.integer else 1.0)
    x, y = 2.0 * values[..., 0] - 1.0, (2.0 * values[..., 1] - 1.0) * (-1.0 if green_up else 1.0)
    normal = np.stack([x, y, np.sqrt(np.maximum(1.0 - x * x - y * y, 0.0))], axis=-1)
    return {
        "height": (1.0 - values[..., 2]).astype(np.float32),
        "back": (1.0 - values[..., 3]).astype(np.float32),
        "normal": (normal / np.linalg.norm(normal, axis=-1, keepdims=True)).astype(np.float32),
    }


def write_packed(source: ReliefMesh, path: Path, bits: int = 16) -> None:
    """Write normals and both depths of a relief as one PNG of four channels (policarpo2005, sec. 4), green up.

    Without a back its depth is 1: solid down to the bottom. Without normals they are those of the heights.
    """
    import cv2

    from ibrpipe.core.relief_map import slopes

    rows, columns = source.height.shape
    normal = source.normal
    if normal is None:
        scale = source.thickness / texture_size(source.mesh, source.uv)
        normal = slopes(source.height, source.edges == "wrap") * scale + (0.0, 0.0, 1.0)
        normal = normal / np.linalg.norm(normal, axis=-1, keepdims=True)
    if normal.shape[:2] != (rows, columns):
        raise ShapeError(f"normals are {normal.shape[:2]}, heights {(rows, columns)}; bring them to one size")
    back = np.zeros_like(source.height) if source.back is None else source.back
    values = np.stack(
        [0.5 + 0.5 * normal[..., 0], 0.5 - 0.5 * normal[..., 1], 1.0 - source.height, 1.0 - back], axis=-1
    )
    kind = np.uint16 if bits == 16 else np.uint8
    codes = np.rint(values * np.iinfo(kind).max).astype(kind)
    if not cv2.imwrite(str(path), codes[..., [2, 1, 0, 3]]):
        raise FormatError(f"{path}: cannot be written; choose a name that ends in .png")
