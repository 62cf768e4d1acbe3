"""Where an asset's world lies in glTF's: y up, metres where the unit is known."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ibrpipe.types import Array, Camera

#: metres in the units that assets may name
METRES = {
    "m": 1.0, "metre": 1.0, "metres": 1.0, "meter": 1.0, "meters": 1.0,
    "cm": 0.01, "centimetres": 0.01, "centimeters": 0.01,
    "mm": 0.001, "millimetres": 0.001, "millimeters": 0.001,
}  # fmt: skip
#: an axis of the world that is so near to what photos call up is taken for it, degrees
NEAR_AXIS = 20.0


def metres_of(units: str) -> float | None:
    """Return how many metres a unit is that assets name, such as ``mm``; None = unknown."""
    words = units.replace(";", " ").replace(",", " ").split()
    return METRES.get(words[0].lower()) if words else None


def up_of(cameras: Sequence[Camera]) -> Array:
    """Return what is up in the world, (3,) float64: as most photos stand, an axis where one is near; else z."""
    if not cameras:
        return np.array([0.0, 0.0, 1.0])
    mean = -np.sum([each.R[1] for each in cameras], axis=0)
    length = float(np.linalg.norm(mean))
    if length < 1e-9:
        return np.array([0.0, 0.0, 1.0])
    mean = mean / length
    axis = int(np.argmax(abs(mean)))
    nearest = np.zeros(3)
    nearest[axis] = np.sign(mean[axis])
    return nearest if mean @ nearest >= np.cos(np.radians(NEAR_AXIS)) else mean


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
