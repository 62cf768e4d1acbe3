"""Mesh files with their colours: at vertices, of materials, and textures with their coordinates."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ibrpipe.errors import FormatError, IbrError
from ibrpipe.io.surfaces.mesh_materials import laid_uv
from ibrpipe.io.surfaces.part_paint import PartPaint, part_paint, stored_albedo
from ibrpipe.io.surfaces.relief_images import read_color
from ibrpipe.io.surfaces.scene_files import read_parts
from ibrpipe.io.untrusted.boundary import reader
from ibrpipe.types import Array, Mesh
from ibrpipe.types.mesh import MeshColors

#: albedo of what brings no colour beside what does
PLAIN = (0.6, 0.6, 0.6)


@reader("export the mesh again")
def read_colored(path: Path, color: Path | None = None) -> tuple[Mesh, MeshColors | None]:
    """Read a mesh as `ibrpipe.io.surfaces.meshes.read_surface` does, and its colours.

    Parameters
    ----------
    path : Path
        PLY, OBJ, GLB/glTF or STL.
    color : Path, optional
        Image that is laid on the file's texture coordinates instead of its own colours.

    Returns
    -------
    mesh : Mesh
        Without vertices that no face uses.
    colors : MeshColors or None
        None where the file brings no colours. 8-bit colours at vertices are sRGB codes, floats (PLY, glTF) linear
        light.

    Raises
    ------
    MissingFileError, FormatError
        A file is missing or damaged, or there are no texture coordinates for `color`.
    """
    parts = read_parts(path, materials=True).parts
    starts = np.cumsum([0] + [len(part.vertices) for part in parts])
    vertices = np.concatenate([np.asarray(part.vertices, np.float64) for part in parts])
    faces = np.concatenate([np.asarray(part.faces, np.int64) + start for part, start in zip(parts, starts)])
    try:
        used, joined = np.unique(faces, return_inverse=True)
        mesh = Mesh(vertices[used], joined.reshape(-1, 3))
        if color is not None:
            return mesh, _colors(parts, [_laid(path, part, read_color(color)) for part in parts])
        paints = [part_paint(path, part) for part in parts]
        albedo = stored_albedo(path) if len(parts) == 1 else None
        if albedo is not None and len(albedo) == len(vertices):
            paints = [PartPaint(albedo)]
        return mesh, _colors(parts, paints) if any(paint is not None for paint in paints) else None
    except IbrError as error:
        if str(error).startswith((str(path), str(color))):
            raise
        raise FormatError(f"{path}: {error}") from error


def _laid(path: Path, part: Any, picture: Array) -> PartPaint:
    uv, count = getattr(part.visual, "uv", None), len(part.vertices)
    if uv is None or len(uv) != count:
        raise FormatError(
            f"{path}: has no texture coordinates for a colour image; map the mesh, or leave the image out"
        )
    laid = laid_uv(path, np.asarray(uv, np.float64), getattr(part.visual, "material", None))
    return PartPaint(np.ones((count, 3)), picture, laid)


def _colors(parts: Sequence[Any], paints: Sequence[PartPaint | None]) -> MeshColors:
    """Join the colours of parts: those of every corner, and one texture for each picture."""
    corner, uv, index = [], [], []
    pictures: list[Array] = []
    for part, paint in zip(parts, paints, strict=True):
        faces = np.asarray(part.faces, np.int64)
        base = np.tile(np.asarray(PLAIN), (len(part.vertices), 1)) if paint is None else paint.base
        corner.append(base[faces])
        if paint is None or paint.texture is None or paint.uv is None:
            uv.append(np.zeros((len(faces), 3, 2)))
            index.append(np.full(len(faces), -1))
            continue
        uv.append(paint.uv[faces] * (1.0, -1.0) + (0.0, 1.0))
        known = next((n for n, each in enumerate(pictures) if np.array_equal(each, paint.texture)), len(pictures))
        if known == len(pictures):
            pictures.append(paint.texture)
        index.append(np.full(len(faces), known))
    return MeshColors(np.concatenate(corner), np.concatenate(uv), tuple(pictures), np.concatenate(index))
