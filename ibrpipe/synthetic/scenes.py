"""The built-in scenes: a glossy ball and a ring, a carved matt wall, a potted plant, and a plain ball for tests."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ibrpipe.errors import ConfigError
from ibrpipe.synthetic import foliage as plant
from ibrpipe.synthetic.light import Lamp, SoftBox, Studio
from ibrpipe.synthetic.paints import BandedRing, DarkRing, carved_stone, glazed_ball
from ibrpipe.synthetic.scene import Gloss, Part, Rig, Scene
from ibrpipe.synthetic.surfaces import Surface, ball, lobed_ball, sheet, tilt, torus, tube
from ibrpipe.types import Array

#: windows and lamps of the glossy scenes
STUDIO = Studio(
    zenith=(0.30, 0.38, 0.52),
    horizon=(0.50, 0.48, 0.45),
    ground=(0.14, 0.125, 0.11),
    boxes=(
        SoftBox(40.0, 38.0, 0.85, 0.95, 0.80, (1.9, 1.84, 1.7)),
        SoftBox(165.0, 22.0, 0.70, 1.05, 0.70, (1.2, 1.4, 1.7)),
        SoftBox(285.0, 50.0, 0.95, 0.65, 0.65, (1.9, 1.6, 1.2)),
    ),
    lamps=(
        Lamp(100.0, 62.0, (3.2, 3.0, 2.6), (0.32, 0.30, 0.26)),
        Lamp(230.0, 28.0, (3.6, 2.8, 2.0), (0.40, 0.32, 0.24)),
    ),
)

#: satin: reflections that photos about 20 degrees apart can capture
GLAZE = Gloss(normal_reflectance=0.10, grazing_reflectance=0.5, exponent=40.0)

#: daylight from the upper left for the matt scene
DAYLIGHT = Studio(
    zenith=(0.50, 0.56, 0.66),
    horizon=(0.46, 0.46, 0.46),
    ground=(0.22, 0.20, 0.17),
    lamps=(Lamp(-130.0, 42.0, (0.0, 0.0, 0.0), (1.05, 0.98, 0.86)),),
)


def _cells(count: int, detail: float) -> int:
    return max(8, round(count * detail))


def glossy(detail: float = 1.0) -> Scene:
    """Return a lobed glazed ball with a tilted enamelled ring around it: two to four depth layers from every side."""
    frame, center = tilt("x", 27.0) @ tilt("y", 14.0), (0.0, 0.0, 0.0)
    body = ball(lobed_ball(1.0, 10, 0.02, 0.92), _cells(240, detail), _cells(120, detail))
    ring = tube(torus(1.36, 0.115, frame, center), _cells(240, detail), _cells(40, detail))
    return Scene(
        "glossy",
        "a glazed ball with a ring around it: reflections, fine paint, several depth layers",
        (
            Part("ball", body, glazed_ball, GLAZE),
            Part("ring", ring, BandedRing(frame, center, 22), GLAZE),
        ),
        STUDIO,
    )


def _carving(u: Array, v: Array) -> Array:
    """Surface of the wall: x in [-1.5, 1.5], z in [-1.1, 1.1], relief along -y."""
    x, z = 1.5 * u, 1.1 * v
    radius, angle = np.hypot(x, z), np.arctan2(z, x)
    rosette = 0.16 * np.exp(-((radius / 0.42) ** 4)) * (1.0 + 0.4 * np.cos(8.0 * angle) * np.tanh((radius / 0.22) ** 4))
    moulding = 0.10 * np.exp(-(((radius - 0.86) / 0.09) ** 2))
    waves = 0.025 * np.sin(7.0 * x + 1.0) * np.sin(6.0 * z) * (1.0 - np.exp(-(radius**4)))
    return np.stack([x, -(rosette + moulding + waves), z], axis=-1)


def lambert(detail: float = 1.0) -> Scene:
    """Return a carved matt wall with a ring hanging before it: nothing depends on the view, two to three layers."""
    frame, center = tilt("x", 76.0), (0.0, -0.42, -0.10)
    wall: Surface = _carving
    ring = tube(torus(0.52, 0.07, frame, center), _cells(160, detail), _cells(32, detail))
    return Scene(
        "lambert",
        "a carved matt wall with a ring before it: no view dependence, fine paint, several depth layers",
        (
            Part("wall", sheet(wall, _cells(240, detail), _cells(176, detail)), carved_stone),
            Part("ring", ring, DarkRing(frame, center, 16)),
        ),
        DAYLIGHT,
        Rig(elevations_deg=(-30.0, 42.0), azimuths_deg=(-145.0, -35.0), rings=4, fov_y_deg=32.0),
    )


def foliage(detail: float = 1.0) -> Scene:
    """Return a matt plant of single-sheet leaves in a glazed pot and a cage of wires: two-sided and thin things."""
    sheets = [
        Part(f"leaf {n}", sheet(leaf.surface, _cells(14, detail), _cells(26, detail)), leaf.front, back=leaf.back)
        for n, leaf in enumerate(plant.leaves())
    ]
    wires = [
        Part(name, tube(wire, _cells(200, detail), _cells(10, detail)), plant.paint_wire) for name, wire in plant.cage()
    ]
    return Scene(
        "foliage",
        "a plant of single-sheet leaves in a glazed pot, in a wire cage: both sides of sheets, thin things",
        (
            Part("pot", ball(plant.pot, _cells(120, detail), _cells(110, detail)), plant.paint_pot, GLAZE),
            Part("soil", ball(plant.soil, _cells(60, detail), _cells(30, detail)), plant.paint_soil),
            Part("stem", ball(plant.stem, _cells(16, detail), _cells(60, detail)), plant.paint_stem),
            *sheets,
            *wires,
        ),
        STUDIO,
        Rig(elevations_deg=(-24.0, 60.0), rings=5),
    )


def plain_ball(detail: float = 1.0) -> Scene:
    """Return a glossy unit ball whose depth and colour are known in closed form."""
    shape = ball(lobed_ball(1.0, 1, 0.0, 1.0), _cells(360, detail), _cells(180, detail))
    part = Part("ball", shape, glazed_ball, GLAZE)
    return Scene("ball", "a glossy unit ball: depth and colour in closed form", (part,), STUDIO)


_SCENES: dict[str, Callable[[float], Scene]] = {
    "glossy": glossy,
    "lambert": lambert,
    "foliage": foliage,
    "ball": plain_ball,
}


def scene_names() -> tuple[str, ...]:
    """Names that `make_scene` knows."""
    return tuple(_SCENES)


def make_scene(name: str, detail: float = 1.0) -> Scene:
    """Build a scene by name.

    Parameters
    ----------
    name : "glossy", "lambert", "foliage" or "ball"
    detail : multiplies the number of triangles along either parameter of every surface

    Raises
    ------
    ConfigError
        No scene has this name.
    """
    if name not in _SCENES:
        raise ConfigError(f"there is no scene named {name!r}; choose one of {', '.join(_SCENES)}")
    return _SCENES[name](detail)
