"""Mesh files as painted meshes: colours of vertices, materials and textures become linear albedo at vertices."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ibrpipe.errors import FormatError, IbrError
from ibrpipe.io.surfaces.colored_meshes import PLAIN
from ibrpipe.io.surfaces.meshes import write_mesh
from ibrpipe.io.surfaces.part_paint import CHANNELS, part_paint, stored_albedo
from ibrpipe.io.surfaces.scene_files import read_parts
from ibrpipe.types import Array, Mesh, PaintedMesh


def read_painted(
    path: Path, color: ArrayLike | None = None, specular: float = 0.0, shininess: float = 32.0
) -> tuple[PaintedMesh, ...]:
    """Read a mesh file.

    Parameters
    ----------
    path : Path
    color : (3,), optional
        Linear albedo of everything, instead of the file's own colours.
    specular, shininess : float
        Of the highlight.

    Returns
    -------
    tuple of PaintedMesh
        One for every mesh of the file. 8-bit colours at vertices are sRGB codes, floats (PLY, glTF) linear light.

    Raises
    ------
    MissingFileError, FormatError
        As `read_mesh`.
    """
    parts = read_parts(path, materials=color is None).parts
    albedo = stored_albedo(path) if len(parts) == 1 else None
    found = []
    for part in parts:
        count = len(part.vertices)
        if color is not None:
            paint = np.broadcast_to(np.asarray(color, np.float32), (count, 3))
        elif albedo is not None:
            paint = albedo
        else:
            paint = vertex_colors(path, part)
        found.append(painted(path, part, paint, specular, shininess))
    return tuple(found)


def painted(path: Path, part: Any, paint: Array, specular: float = 0.0, shininess: float = 32.0) -> PaintedMesh:
    """Return a mesh of trimesh's with linear albedo (V, 3); what is wrong with it is told with the file's name."""
    try:
        mesh = Mesh(np.asarray(part.vertices, np.float64), np.asarray(part.faces, np.int64))
        return PaintedMesh(mesh, np.ascontiguousarray(paint, np.float32), specular, shininess)
    except IbrError as error:
        raise FormatError(f"{path}: {error}") from error


def vertex_colors(path: Path, part: Any, factor: ArrayLike | None = None) -> Array:
    """Linear albedo (V, 3) at the vertices of a mesh of trimesh's.

    Parameters
    ----------
    path : Path
        For messages.
    part : trimesh.Trimesh
    factor : (3,), optional
        The material's own colour, linear, exactly; trimesh keeps 8 bits of it.
    """
    paint = part_paint(path, part, factor)
    if paint is None:
        return np.tile(np.asarray(PLAIN, np.float32), (len(part.vertices), 1))
    if paint.texture is None or paint.uv is None:
        return paint.base.astype(np.float32)
    return (paint.base * _sampled(paint.texture, paint.uv)).astype(np.float32)


def _sampled(picture: Array, uv: Array) -> Array:
    """Bilinear values (V, 3) of a repeated texture at coordinates (V, 2), v upward."""
    rows, columns = picture.shape[:2]
    x, y = (uv[:, 0] % 1.0) * columns - 0.5, ((1.0 - uv[:, 1]) % 1.0) * rows - 0.5
    left, top = np.floor(x).astype(int), np.floor(y).astype(int)
    right, below = (x - left)[:, None], (y - top)[:, None]
    corners = [picture[(top + j) % rows, (left + i) % columns] for j in (0, 1) for i in (0, 1)]
    upper, lower = (corners[n] * (1 - right) + corners[n + 1] * right for n in (0, 2))
    return upper * (1 - below) + lower * below


def write_painted(painted: PaintedMesh, path: Path) -> None:
    """Write a binary PLY with float64 places and float32 linear albedo, so that nothing is lost."""
    write_mesh(painted.mesh, path, dict(zip(CHANNELS, painted.color.T)))
