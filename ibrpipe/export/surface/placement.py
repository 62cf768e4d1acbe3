"""Where an asset's world lies in glTF's: y up, metres where the unit is known."""

from __future__ import annotations

import numpy as np

from ibrpipe.types import Array

#: metres in the units that assets may name
METRES = {
    "m": 1.0, "metre": 1.0, "metres": 1.0, "meter": 1.0, "meters": 1.0,
    "cm": 0.01, "centimetres": 0.01, "centimeters": 0.01,
    "mm": 0.001, "millimetres": 0.001, "millimeters": 0.001,
}  # fmt: skip


def metres_of(units: str) -> float | None:
    """Return how many metres a unit is that assets name, such as ``mm``; None = unknown."""
    words = units.replace(";", " ").replace(",", " ").split()
    return METRES.get(words[0].lower()) if words else None


def gltf_from_world(up: Array, scale: float, center: Array) -> Array:
    """(4, 4) float64: world to glTF; `up` becomes y, `center` the origin, lengths times `scale`."""
    other = np.eye(3)[int(np.argmin(abs(up)))]
    # of z up: x stays x, y becomes -z, as programs with z up expect of a glTF file
    across = np.cross(np.cross(up, other), up)
    across = across / np.linalg.norm(across)
    out = np.eye(4)
    out[:3, :3] = scale * np.stack([across, up, np.cross(across, up)])
    out[:3, 3] = -out[:3, :3] @ center
    return out


def rotation_of(similarity: Array) -> Array:
    """Return the rotation (3, 3) of a similarity (4, 4)."""
    return similarity[:3, :3] / np.cbrt(np.linalg.det(similarity[:3, :3]))
