"""Painted patterns: closed-form reflectance of a point, coarse shapes and fine detail, soft edges against aliasing.

Every paint maps world points (N, 3) to linear reflectances (N, 3) in [0, 1].
"""

from __future__ import annotations

import numpy as np

from ibrpipe.synthetic.light import Triple, smooth_step
from ibrpipe.types import Array

IVORY: Triple = (0.52, 0.46, 0.35)
COBALT: Triple = (0.02, 0.05, 0.20)
TEAL: Triple = (0.04, 0.26, 0.28)
RED: Triple = (0.40, 0.04, 0.03)
GOLD: Triple = (0.52, 0.30, 0.05)
STONE: Triple = (0.46, 0.39, 0.29)
SLATE: Triple = (0.14, 0.17, 0.20)
OCHRE: Triple = (0.52, 0.29, 0.08)


def mix(below: Array, color: Triple, share: Array) -> Array:
    """Paint `color` over `below` (N, 3) with coverage `share` (N,)."""
    return below + (np.array(color) - below) * share[:, None]


def stripe(x: Array, middle: float | Array, half_width: float, edge: float) -> Array:
    """Coverage of a stripe of x around `middle` whose edges are `edge` wide."""
    return smooth_step((half_width - np.abs(x - middle)) / edge + 0.5)


def row_of_dots(along: Array, across: Array, pitch: float, radius: float, edge: float) -> Array:
    """Coverage of discs every `pitch` along the line across = 0, the first centre at half a pitch."""
    offset = (np.mod(along / pitch, 1.0) - 0.5) * pitch
    return smooth_step((radius - np.hypot(offset, across)) / edge + 0.5)


def grain(points: Array, frequency: float) -> Array:
    """Smooth repeatable grain in [-1, 1], (N,): plane waves in nine directions spread over the hemisphere."""
    total = np.zeros(len(points))
    for i in range(9):
        z, angle = (i + 0.5) / 9.0, i * np.pi * (3.0 - np.sqrt(5.0))
        across = np.sqrt(1.0 - z * z)
        wave = points @ np.array([across * np.cos(angle), across * np.sin(angle), z])
        total += np.sin(frequency * (1.0 + 0.37 * (i % 3)) * wave + 1.7 * i)
    return total / 9.0


def _ground(points: Array, color: Triple, amount: float, frequency: float) -> Array:
    """One colour with grain."""
    return np.array(color) * (1.0 + amount * grain(points, frequency))[:, None]


def glazed_ball(points: Array) -> Array:
    """Cobalt glaze with an ivory frieze, red medallions, gold lines and petals, rows of dots, about the origin."""
    azimuth = np.arctan2(points[:, 1], points[:, 0])
    latitude = np.arctan2(points[:, 2], np.hypot(points[:, 0], points[:, 1]))
    color = _ground(points, COBALT, 0.35, 38.0)
    color = mix(color, IVORY, stripe(latitude, 0.0, 0.25, 0.012) * (0.94 + 0.06 * np.sin(90.0 * azimuth)))
    wave = 0.14 * np.sin(8.0 * azimuth)
    color = mix(color, TEAL, stripe(latitude, wave, 0.022, 0.012))
    color = mix(color, COBALT, stripe(latitude, -wave, 0.022, 0.012))
    color = mix(color, RED, row_of_dots(azimuth, latitude, np.pi / 8.0, 0.07, 0.014))
    return _caps(color, azimuth, np.abs(latitude))


def _caps(color: Array, azimuth: Array, latitude: Array) -> Array:
    """Paint what repeats on both halves of the ball, from the frieze to the poles."""
    color = mix(color, GOLD, stripe(latitude, 0.265, 0.018, 0.01))
    color = mix(color, TEAL, stripe(latitude, 0.36, 0.03, 0.012))
    petal = 0.50 + 0.26 * np.abs(np.cos(6.0 * azimuth))
    color = mix(color, GOLD, stripe(latitude, petal, 0.022, 0.012))
    color = mix(color, IVORY, row_of_dots(azimuth, latitude - 0.56, np.pi / 6.0, 0.05, 0.014))
    color = mix(color, RED, row_of_dots(azimuth * 0.6, latitude - 0.95, np.pi / 40.0, 0.026, 0.012))
    color = mix(color, GOLD, stripe(latitude, 1.06, 0.02, 0.012))
    return mix(color, IVORY, smooth_step((latitude - 1.25) / 0.02 + 0.5))


class BandedRing:
    """Red enamel with ivory bands edged in cobalt, counted around the axis of a torus.

    Parameters
    ----------
    frame : (3, 3) rotation whose third column is the axis
    center : world point in the middle of the ring
    bands : number of bands around the ring
    """

    def __init__(self, frame: Array, center: tuple[float, float, float], bands: int) -> None:
        self._frame, self._center, self._bands = frame, np.array(center), bands

    def __call__(self, points: Array) -> Array:
        """Paint world points (N, 3)."""
        local = (points - self._center) @ self._frame
        beat = np.mod(np.arctan2(local[:, 1], local[:, 0]) * (self._bands / (2.0 * np.pi)), 1.0)
        color = _ground(points, RED, 0.10, 60.0)
        color = mix(color, COBALT, stripe(beat, 0.5, 0.24, 0.06))
        color = mix(color, IVORY, stripe(beat, 0.5, 0.16, 0.06))
        return mix(color, GOLD, stripe(beat, 0.5, 0.04, 0.04))


def carved_stone(points: Array) -> Array:
    """Sandstone in the x-z plane: coarse courses, ochre rings around the middle, fine grain."""
    color = _ground(points, STONE, 0.16, 30.0) * (1.0 + 0.10 * grain(points, 9.0))[:, None]
    x, z = points[:, 0], points[:, 2]
    radius, angle = np.hypot(x, z), np.arctan2(z, x)
    color = mix(color, OCHRE, stripe(radius, 0.86, 0.035, 0.012))
    color = mix(color, SLATE, stripe(radius, 0.26 + 0.07 * np.cos(8.0 * angle), 0.022, 0.012))
    color = mix(color, SLATE, row_of_dots(angle * 0.75, radius - 0.75, 0.75 * np.pi / 16.0, 0.028, 0.012))
    frame = np.maximum(np.abs(x) / 1.45, np.abs(z) / 1.05)
    color = mix(color, OCHRE, stripe(frame, 0.95, 0.02, 0.01))
    checker = 0.5 + 0.5 * np.clip(6.0 * np.sin(24.0 * x) * np.sin(24.0 * z), -1.0, 1.0)
    return mix(color, SLATE, checker * stripe(frame, 0.87, 0.045, 0.01))


class DarkRing:
    """Slate with ochre bands around the axis of a torus; parameters as in `BandedRing`."""

    def __init__(self, frame: Array, center: tuple[float, float, float], bands: int) -> None:
        self._frame, self._center, self._bands = frame, np.array(center), bands

    def __call__(self, points: Array) -> Array:
        """Paint world points (N, 3)."""
        local = (points - self._center) @ self._frame
        beat = np.mod(np.arctan2(local[:, 1], local[:, 0]) * (self._bands / (2.0 * np.pi)), 1.0)
        color = _ground(points, SLATE, 0.15, 70.0)
        return mix(color, OCHRE, stripe(beat, 0.5, 0.2, 0.08))
