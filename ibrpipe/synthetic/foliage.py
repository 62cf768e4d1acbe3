"""The foliage scene: a plant of single-sheet leaves in a glazed pot, in a cage of thin wires.

Leaves are open sheets with another colour on either side; wires are 1 to 2 pixels wide in photos of 320 x 240 pixels.
Lengths are scene units, z is up.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ibrpipe.synthetic.light import Triple, direction
from ibrpipe.synthetic.paints import SLATE, grain, mix, row_of_dots, stripe
from ibrpipe.synthetic.surfaces import Surface
from ibrpipe.types import Array

LEAVES = 36
LIGHT_VEIN: Triple = (0.30, 0.42, 0.14)
PLUM: Triple = (0.24, 0.09, 0.16)
PALE_VEIN: Triple = (0.50, 0.38, 0.36)
CREAM: Triple = (0.55, 0.52, 0.34)
SOIL: Triple = (0.075, 0.05, 0.035)
STEM: Triple = (0.16, 0.22, 0.07)
GLAZE_BLUE: Triple = (0.03, 0.16, 0.24)
COPPER: Triple = (0.42, 0.19, 0.09)

#: radius and height along the outline of the pot, from the middle of its bottom over its rim to its inside
_POT = np.array(
    [(0.0, 0.0), (0.24, 0.0), (0.26, 0.02), (0.36, 0.60), (0.41, 0.61), (0.42, 0.63), (0.42, 0.71), (0.41, 0.72),
     (0.37, 0.72), (0.36, 0.70), (0.33, 0.58), (0.0, 0.57)]
)  # fmt: skip
_SOIL_LEVEL, _SOIL_RADIUS = 0.66, 0.345


@dataclass(frozen=True, eq=False)
class Leaf:
    """A pointed sheet that droops and folds about its midrib.

    Attributes
    ----------
    base : (3,) float64, where it leaves the stem
    axes : (3, 3) float64, rows: along the midrib, across it, to the front of the sheet
    length, half_width : scene units
    droop, fold : how far the tip and the sides leave the plane, shares of the length
    green : colour of the front
    """

    base: Array
    axes: Array
    length: float
    half_width: float
    droop: float
    fold: float
    green: Triple

    def surface(self, u: Array, v: Array) -> Array:
        """Points (..., 3): u from -1 to 1 across, v from -1 to 1 along."""
        along = 0.5 * self.length * (v + 1.0)
        across = -u * self.half_width * ((1.0 - v * v) * (1.0 - 0.35 * v) + 0.03)
        rise = (along / self.length) ** 2
        height = self.fold * across**2 / self.half_width - self.droop * self.length * rise
        height += 0.02 * self.length * np.sin(9.0 * along / self.length) * across / self.half_width
        return self.base + np.stack([along, across, height], axis=-1) @ self.axes

    def front(self, points: Array) -> Array:
        """Paint the front: green with light veins and a cream margin."""
        along, across = self._place(points)
        color = np.array(self.green) * (1.0 + 0.25 * grain(points, 26.0))[:, None]
        outline = self.half_width * np.maximum((1.0 - (2 * along - 1) ** 2) * (1.35 - 0.7 * along), 0.0)
        color = mix(color, CREAM, stripe(np.abs(across), outline, 0.018, 0.012))
        return mix(color, LIGHT_VEIN, self._veins(along, across))

    def back(self, points: Array) -> Array:
        """Paint the back: plum with pale veins."""
        along, across = self._place(points)
        color = np.array(PLUM) * (1.0 + 0.3 * grain(points, 20.0))[:, None]
        return mix(color, PALE_VEIN, self._veins(along, across))

    def _place(self, points: Array) -> tuple[Array, Array]:
        local = (points - self.base) @ self.axes.T
        return local[:, 0] / self.length, local[:, 1]

    def _veins(self, along: Array, across: Array) -> Array:
        midrib = stripe(across, 0.0, 0.010, 0.010)
        beat = np.mod((along * self.length - 0.8 * np.abs(across)) / 0.075, 1.0)
        return np.maximum(midrib, 0.75 * stripe(beat, 0.5, 0.07, 0.14))


def leaves(count: int = LEAVES, seed: int = 5) -> list[Leaf]:
    """Return leaves around the stem, from below to above, always the same."""
    random, found = np.random.default_rng(seed), []
    for number in range(count):
        share = (number + 0.5) / count
        azimuth = np.degrees(number * np.pi * (3.0 - np.sqrt(5.0))) + random.uniform(-12.0, 12.0)
        elevation = -8.0 + 62.0 * share + random.uniform(-14.0, 14.0)
        along = direction(azimuth, elevation)
        turn = np.radians(random.uniform(-40.0, 40.0))
        level = direction(azimuth + 90.0, 0.0)
        across = np.cos(turn) * level + np.sin(turn) * np.cross(along, level)
        axes = np.stack([along, across, np.cross(along, across)])
        length = random.uniform(0.46, 0.60) * (1.0 - 0.25 * share)
        base = np.array([0.0, 0.0, 0.84 + 0.86 * share]) + 0.03 * direction(azimuth, 0.0)
        green = (random.uniform(0.05, 0.12), random.uniform(0.19, 0.30), random.uniform(0.04, 0.08))
        found.append(
            Leaf(base, axes, length, length * random.uniform(0.24, 0.32), random.uniform(0.10, 0.35), 0.35, green)
        )
    return found


def hoop(width: float, height: float, radius: float, frame: Array, center: tuple[float, float, float]) -> Surface:
    """Return a wire of a `radius` bent to an ellipse of half axes `width`, `height` along the frame's first columns."""
    offset = np.asarray(center, float)

    def surface(u: Array, v: Array) -> Array:
        normal = np.stack([height * np.cos(u), width * np.sin(u)])
        normal = normal / np.linalg.norm(normal, axis=0)
        x = width * np.cos(u) + radius * np.cos(v) * normal[0]
        y = height * np.sin(u) + radius * np.cos(v) * normal[1]
        return np.stack([x, y, radius * np.sin(v)], axis=-1) @ frame.T + offset

    return surface


def cage() -> list[tuple[str, Surface]]:
    """Return the wires of the cage by name: upright hoops that end in the soil, and level rings."""
    middle, wide, tall = 1.38, 0.80, 0.80
    found = []
    for number in range(3):
        outward, upward = direction(25.0 + 60.0 * number, 0.0), np.array([0.0, 0.0, 1.0])
        frame = np.stack([outward, upward, np.cross(outward, upward)], axis=1)
        found.append((f"hoop {number}", hoop(wide, tall, 0.0075 + 0.0015 * number, frame, (0.0, 0.0, middle))))
    for number, level in enumerate((1.10, 1.72)):
        reach = wide * np.sqrt(1.0 - ((level - middle) / tall) ** 2) + 0.006
        found.append((f"ring {number}", hoop(reach, reach, 0.0065, np.eye(3), (0.0, 0.0, level))))
    return found


def pot(u: Array, v: Array) -> Array:
    """Closed outline of the pot turned about z; v is the latitude of `surfaces.ball`."""
    steps = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(_POT, axis=0), axis=1))])
    at = steps[-1] * (v / np.pi + 0.5)
    radius, height = np.interp(at, steps, _POT[:, 0]), np.interp(at, steps, _POT[:, 1])
    return np.stack([radius * np.cos(u), radius * np.sin(u), height], axis=-1)


def soil(u: Array, v: Array) -> Array:
    """Flat lens of soil in the pot, a little bumpy."""
    across = _SOIL_RADIUS * np.cos(v)
    bump = 0.008 * np.sin(5.0 * u) * np.cos(v) ** 2 * np.sin(v)
    return np.stack([across * np.cos(u), across * np.sin(u), _SOIL_LEVEL - 0.02 + 0.02 * np.sin(v) + bump], axis=-1)


def stem(u: Array, v: Array) -> Array:
    """Upright stem, rounded off at both ends."""
    radius, height = 0.028 * np.cos(v) ** 0.25, 0.64 + 1.12 * (v / np.pi + 0.5)
    bend = 0.015 * np.sin(5.0 * height)
    return np.stack([radius * np.cos(u) + bend, radius * np.sin(u), height], axis=-1)


def paint_pot(points: Array) -> Array:
    """Blue glaze with copper bands and cream dots."""
    azimuth, height = np.arctan2(points[:, 1], points[:, 0]), points[:, 2]
    color = np.array(GLAZE_BLUE) * (1.0 + 0.2 * grain(points, 30.0))[:, None]
    color = mix(color, COPPER, stripe(height, 0.10, 0.02, 0.012))
    color = mix(color, COPPER, stripe(height, 0.50, 0.02, 0.012))
    color = mix(color, CREAM, row_of_dots(0.32 * azimuth, height - 0.30, 0.32 * np.pi / 8.0, 0.05, 0.014))
    return mix(color, COPPER, stripe(height, 0.67, 0.018, 0.012))


def paint_soil(points: Array) -> Array:
    """Dark crumbs."""
    return np.array(SOIL) * (1.0 + 0.6 * grain(points, 70.0))[:, None]


def paint_stem(points: Array) -> Array:
    """Green with darker rings."""
    color = np.array(STEM) * (1.0 + 0.2 * grain(points, 40.0))[:, None]
    return mix(color, SLATE, 0.6 * stripe(np.mod(points[:, 2] / 0.11, 1.0), 0.5, 0.06, 0.1))


def paint_wire(points: Array) -> Array:
    """Copper with a dull grain."""
    return np.array(COPPER) * (1.0 + 0.15 * grain(points, 25.0))[:, None]
