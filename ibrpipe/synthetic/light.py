"""A closed-form studio: a gradient sky, soft boxes and lamps.

Radiance (what a mirror sees) and irradiance (what a matt surface receives) are formulas of one direction each, so that
the shading of a synthetic photo is exact by definition. Nothing casts shadows; `occlusion` in `ibrpipe.synthetic.scene`
darkens what the object itself hides from the sky.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ibrpipe.types import Array

Triple = tuple[float, float, float]


def smooth_step(x: Array) -> Array:
    """Rise from 0 at x <= 0 to 1 at x >= 1 with no slope at either end."""
    t = np.clip(x, 0.0, 1.0)
    return t * t * (3.0 - 2.0 * t)


def direction(azimuth_deg: float, elevation_deg: float) -> Array:
    """Unit vector (3,) of an azimuth (from +x to +y) and an elevation (towards +z) in degrees."""
    azimuth, elevation = np.radians(azimuth_deg), np.radians(elevation_deg)
    across = np.cos(elevation)
    return np.array([across * np.cos(azimuth), across * np.sin(azimuth), np.sin(elevation)])


@dataclass(frozen=True)
class SoftBox:
    """A glowing rectangle at infinity.

    Attributes
    ----------
    azimuth_deg, elevation_deg : where its middle is
    half_width, half_height : tangents of its half angles
    softness : width of its blurred edge, same unit, at most the half angles
    radiance : linear Rec.709
    """

    azimuth_deg: float
    elevation_deg: float
    half_width: float
    half_height: float
    softness: float
    radiance: Triple

    @property
    def axes(self) -> tuple[Array, Array, Array]:
        """Unit vectors to its middle, to its right and upwards."""
        middle = direction(self.azimuth_deg, self.elevation_deg)
        right = np.cross((0.0, 0.0, 1.0), middle)
        right = right / np.linalg.norm(right)
        return middle, right, np.cross(middle, right)

    def shape(self, d: Array) -> Array:
        """Share (0 to 1) of the box's radiance that arrives from directions (N, 3)."""
        middle, right, up = self.axes
        depth = d @ middle
        safe = np.maximum(depth, 1e-3)
        x, y = np.abs(d @ right) / safe, np.abs(d @ up) / safe
        inside = smooth_step((self.half_width - x) / self.softness) * smooth_step(
            (self.half_height - y) / self.softness
        )
        return np.where(depth > 1e-3, inside, 0.0)

    @property
    def power(self) -> float:
        """What a surface facing the box receives per unit of radiance: its area at unit distance, over pi."""
        return 4.0 * (self.half_width - self.softness / 2.0) * (self.half_height - self.softness / 2.0) / np.pi


@dataclass(frozen=True)
class Lamp:
    """A small distant light whose reflection is a Phong lobe.

    Attributes
    ----------
    azimuth_deg, elevation_deg : where it is
    radiance : of the peak of its reflection in a perfect mirror
    irradiance : on a surface that faces it
    """

    azimuth_deg: float
    elevation_deg: float
    radiance: Triple
    irradiance: Triple


@dataclass(frozen=True)
class Studio:
    """All the light there is.

    Attributes
    ----------
    zenith, horizon, ground : colours of the sky's gradient, linear Rec.709 radiance
    boxes, lamps : the lights
    """

    zenith: Triple
    horizon: Triple
    ground: Triple
    boxes: tuple[SoftBox, ...] = ()
    lamps: tuple[Lamp, ...] = ()

    def radiance(self, d: Array) -> Array:
        """Radiance (N, 3) from unit directions (N, 3): sky and soft boxes, no lamps."""
        zenith, horizon, ground = (np.array(c) for c in (self.zenith, self.horizon, self.ground))
        above = np.clip(d[:, 2:], 0.0, 1.0)
        sky = horizon + (zenith - horizon) * (above * (2.0 - above))
        light = sky + (ground - sky) * smooth_step((0.08 - d[:, 2:]) / 0.25)
        for box in self.boxes:
            light += box.shape(d)[:, None] * np.array(box.radiance)
        return light

    def irradiance(self, n: Array) -> Array:
        """What a white matt surface with unit normals (N, 3) sends back, (N, 3)."""
        upper = 0.5 * (np.array(self.zenith) + np.array(self.horizon))
        light = 0.5 * (upper + np.array(self.ground)) + n[:, 2:] * (0.5 * (upper - np.array(self.ground)))
        for box in self.boxes:
            light += (box.power * np.maximum(n @ box.axes[0], 0.0))[:, None] * np.array(box.radiance)
        for lamp in self.lamps:
            cosine = n @ direction(lamp.azimuth_deg, lamp.elevation_deg)
            light += np.maximum(cosine, 0.0)[:, None] * np.array(lamp.irradiance)
        return light

    def glints(self, r: Array, exponent: float) -> Array:
        """Phong lobes (N, 3) of the lamps about unit mirror directions (N, 3)."""
        total = np.zeros_like(r)
        for lamp in self.lamps:
            cosine = np.maximum(r @ direction(lamp.azimuth_deg, lamp.elevation_deg), 0.0)
            total += (cosine**exponent)[:, None] * np.array(lamp.radiance)
        return total
