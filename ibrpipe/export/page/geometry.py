"""Meshes and sparse points as pages hold them: places in 16 bits an axis, colours in 8."""

from __future__ import annotations

from typing import Any

import numpy as np

from ibrpipe.core.color import srgb_encode, to_bytes
from ibrpipe.export.page.packing import Packer, foretell
from ibrpipe.types import Array, PaintedMesh

#: codes of a place along the longest side of the box
STEPS = (1 << 16) - 1


def pack_places(places: Array, packer: Packer) -> dict[str, Any]:
    """Pack world positions (N, 3), N > 0, in equal steps along all axes."""
    low = places.min(axis=0)
    step = float((places.max(axis=0) - low).max()) / STEPS or 1.0
    codes = np.round((places - low) / step).astype(np.uint16)
    return {"count": len(places), "low": low.tolist(), "step": step, "places": _in_a_row(codes.T, packer)}


def pack_mesh(mesh: PaintedMesh, confidence: Array | None, packer: Packer) -> dict[str, Any]:
    """Pack a mesh; `confidence` (V,), 0 to 1, of its vertices where it is known."""
    one_color = (mesh.color == mesh.color[0]).all()
    sure = None if confidence is None else to_bytes(np.clip(confidence, 0.0, 1.0))[None]
    return {
        **pack_places(mesh.mesh.vertices, packer),
        "faces": _in_a_row(mesh.mesh.faces.reshape(1, -1), packer)[0],
        "color": None if one_color else _in_a_row(to_bytes(srgb_encode(mesh.color)).T, packer),
        "confidence": None if sure is None else _in_a_row(sure, packer)[0],
    }


def pack_points(xyz: Array, color: Array, packer: Packer) -> dict[str, Any]:
    """Pack points (P, 3), P > 0, and their colours (P, 3) uint8 sRGB; those that lie close stand close in memory."""
    cells = np.round((xyz - xyz.min(axis=0)) / (np.ptp(xyz, axis=0).max() or 1.0) * 31).astype(int)
    order = np.lexsort(cells.T)
    return {**pack_places(xyz[order], packer), "color": _in_a_row(color[order].T, packer)}


def _in_a_row(planes: Array, packer: Packer) -> list[dict[str, Any]]:
    """Pack planes (C, N), every value foretold by the one before."""
    before = np.arange(planes.shape[1]) - 1
    around = np.stack([before, np.full_like(before, -1), np.full_like(before, -1)])
    return [packer.add(plane, foretell(plane, around)) for plane in np.ascontiguousarray(planes)]
