"""Lights of scenes whose colours are stored unshaded (max1999, sec. 3)."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ibrpipe.errors import ValueRangeError
from ibrpipe.types.arrays import Array, finite_array, numbers_of


@dataclass(frozen=True, eq=False)
class Light:
    """A light at infinity.

    Attributes
    ----------
    direction : (3,) float64
        Unit vector from the scene to the light, world axes; any length is taken and made 1.
    color : (3,) float64, linear
        What a white matt surface facing the light reflects of it.
    """

    direction: Array
    color: Array = field(default_factory=lambda: np.ones(3))

    def __repr__(self) -> str:
        """Return direction and colour."""
        return f"Light(from {numbers_of(self.direction)}, colour {numbers_of(self.color)})"

    def __post_init__(self) -> None:
        direction, color = finite_array("direction", self.direction, (3,)), finite_array("color", self.color, (3,))
        length = float(np.linalg.norm(direction))
        if not length > 0 or (color < 0).any():
            raise ValueRangeError(
                f"a light has direction {direction.tolist()} and colour {color.tolist()}; the direction must not be "
                "zero, the colour not negative"
            )
        object.__setattr__(self, "direction", finite_array("direction", direction / length, (3,)))
        object.__setattr__(self, "color", color)


@dataclass(frozen=True, eq=False)
class Lighting:
    """What lights a scene: albedo * (ambient + sum of light * max(0, n.L)), n turned to the viewer (max1999, sec. 3).

    Attributes
    ----------
    ambient : (3,) float64, linear
    lights : tuple of Light
    """

    ambient: Array = field(default_factory=lambda: np.full(3, 0.35))
    lights: tuple[Light, ...] = (Light(np.array([0.45, 0.30, 0.84]), np.full(3, 0.65)),)

    def __repr__(self) -> str:
        """Return the ambient light and how many lights there are."""
        return f"Lighting(ambient {numbers_of(self.ambient)}, {len(self.lights)} lights)"

    def __post_init__(self) -> None:
        ambient = finite_array("ambient", self.ambient, (3,))
        if (ambient < 0).any():
            raise ValueRangeError(f"ambient light is {ambient.tolist()}; it must not be negative")
        object.__setattr__(self, "ambient", ambient)
        object.__setattr__(self, "lights", tuple(self.lights))
