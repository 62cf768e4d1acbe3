"""Textured meshes with a relief: glTF and OBJ with the textures of their materials, or with files given beside them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ibrpipe.errors import FormatError, IbrError, ShapeError, ValueRangeError
from ibrpipe.io.photos.image_files import read_stored
from ibrpipe.io.surfaces.mesh_materials import Textured, read_materials, read_textured
from ibrpipe.io.surfaces.relief_images import read_color, read_height, read_normals, read_relief_folder
from ibrpipe.io.surfaces.uv_maps import map_mesh
from ibrpipe.types import Array, Mesh
from ibrpipe.types.relief_mesh import ReliefMesh

#: thickness of a relief that is not told, as a share of the mean size of one texture on the mesh
THICKNESS = 0.05


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
        glTF, GLB, OBJ, PLY or STL. All its parts become one mesh with one material; see `read_relief_meshes` for more.
    relief : path, optional
        Folder with ``height.*`` and, where there are any, ``color.*`` and ``normal_gl.*``.
    height, color, normal : path, optional
        Single files; they come before the folder's, and those before the textures of the mesh file: for heights an OBJ
        material's ``disp`` or grey ``map_Bump``, else the alpha of the normal map.
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
    options = locals()
    file = Path(options.pop("path"))
    return _relief_of(file, read_textured(file), **options)


def read_relief_meshes(path: str | Path, relief: str | Path | None = None, **options: Any) -> list[ReliefMesh]:
    """Read a mesh file of several materials: one relief mesh for each, to be rendered as a list.

    Parameters
    ----------
    path, relief, options
        As `read_relief_mesh` takes them; files that are given take the place of every material's.

    Returns
    -------
    list of ReliefMesh
        Where some materials bring heights, those that bring none are flat.

    Raises
    ------
    as `read_relief_mesh`
    """
    file = Path(path)
    found = read_materials(file)
    if any(each.height is not None for each in found):
        flat = np.full((1, 1), options.get("height_range", (0.0, 1.0))[1], np.float32)
        found = [each if each.height is not None else replace(each, height=flat) for each in found]
    return [_relief_of(file, each, relief, **options) for each in found]


def _relief_of(
    file: Path,
    found: Textured,
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
            tangents=found.tangents if uv in ("auto", "file") and found.uv is not None else None,
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

    from ibrpipe.core.relief_mesh.map import slopes

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
