"""What a part of a mesh file says of its colour: colours at vertices, the material's own, and its texture."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ibrpipe.core.color import srgb_decode
from ibrpipe.io.surfaces.gltf_file import KEPT_COLOR
from ibrpipe.io.surfaces.mesh_materials import laid_uv, material_color
from ibrpipe.io.surfaces.meshes import read_vertex_values
from ibrpipe.io.surfaces.scene_files import OBJ_MATERIAL
from ibrpipe.types import Array

#: properties of a PLY's vertices that hold linear albedo as floats
CHANNELS = ("red", "green", "blue")


@dataclass(frozen=True, eq=False)
class PartPaint:
    """Colours of a part's V vertices: (V, 3) linear, times a texture (H, W, 3) at uv (V, 2), v upward, or None."""

    base: Array
    texture: Array | None = None
    uv: Array | None = None


def part_paint(path: Path, part: Any, factor: ArrayLike | None = None) -> PartPaint | None:
    """Return the colours of a mesh of trimesh's; None = it brings none.

    Parameters
    ----------
    path : Path
        For messages.
    part : trimesh.Trimesh
    factor : (3,), optional
        The material's own colour, linear, exactly; trimesh keeps 8 bits of it.
    """
    count = len(part.vertices)
    kept = part.vertex_attributes.get(KEPT_COLOR)
    material = getattr(part.visual, "material", None)
    if path.suffix.lower() == ".obj" and material is not None and not _is_named(material):
        return None  # trimesh gives it a grey one of its own
    if material is None and kept is None:
        if not part.visual.defined:
            return None
        return PartPaint(srgb_decode(np.asarray(part.visual.vertex_colors, np.float32)[:, :3] / 255.0))
    base = np.ones((count, 3)) if kept is None else np.asarray(kept, np.float64)[:, :3]
    picture = None if material is None else material_color(path, material, factored=factor is None)
    if factor is not None:
        base = base * np.asarray(factor, np.float64)
    if picture is None:
        return None if factor is None and kept is None else PartPaint(base)
    uv = getattr(part.visual, "uv", None)
    if picture.shape[:2] == (1, 1) or uv is None or len(uv) != count:
        return PartPaint(base * picture.mean(axis=(0, 1)))
    return PartPaint(base, picture, laid_uv(path, np.asarray(uv, np.float64), material))


def _is_named(material: Any) -> bool:
    return OBJ_MATERIAL in (getattr(material, "kwargs", None) or {})


def stored_albedo(path: Path) -> Array | None:
    """Linear albedo (V, 3) that the vertices of a PLY hold as floats; None = they hold none."""
    stored = read_vertex_values(path) if path.suffix.lower() == ".ply" else {}
    if not all(name in stored and stored[name].dtype == np.float32 for name in CHANNELS):
        return None
    return np.stack([stored[name] for name in CHANNELS], axis=1)
