"""Cameras around a scene: photos on rings of equal elevation, test views between the rings."""

from __future__ import annotations

import numpy as np

from ibrpipe.synthetic.light import direction
from ibrpipe.synthetic.scene import Rig
from ibrpipe.types import Array, Camera, Mesh

#: the object fills at most this share of a photo's width and height
_FILL = 0.94


def fitting_distance(mesh: Mesh, cameras: list[Camera], middle: Array) -> float:
    """Smallest distance from `middle`, the same for all cameras, at which no photo cuts the mesh off.

    The cameras' positions do not matter, only where they look; each looks at `middle`.
    """
    distance = 0.0
    for camera in cameras:
        local = (mesh.vertices - middle) @ camera.R.T
        half = _FILL * 0.5 * np.array([camera.width / camera.K[0, 0], camera.height / camera.K[1, 1]])
        distance = max(distance, float((np.abs(local[:, :2]) / half - local[:, 2:]).max()))
    return distance


def _ring_sizes(elevations: Array, photos: int) -> list[int]:
    """Share `photos` among rings by their circumference, by largest remainder, at least one each while they last."""
    weight = np.cos(np.radians(elevations))
    ideal = photos * weight / weight.sum()
    counts = np.maximum(np.floor(ideal).astype(int), 1 if photos >= len(elevations) else 0)
    while counts.sum() < photos:
        counts[np.argmax(ideal - counts)] += 1
    while counts.sum() > photos:
        counts[np.argmax(counts - ideal)] -= 1
    return [int(count) for count in counts]


def _azimuths(rig: Rig, count: int, shift: float) -> Array:
    """Spread `count` azimuths over the rig's span; a closed ring is turned by `shift` of a step."""
    first, last = rig.azimuths_deg
    if last - first >= 360.0:
        return first + (np.arange(count) + shift) * ((last - first) / max(count, 1))
    return first + (np.arange(count) + 0.5) * ((last - first) / max(count, 1))


def photo_directions(rig: Rig, photos: int) -> list[Array]:
    """Unit vectors from the object to the photos, ring by ring from below; rings are staggered."""
    elevations = np.linspace(*rig.elevations_deg, rig.rings)
    found: list[Array] = []
    for ring, count in enumerate(_ring_sizes(elevations, photos)):
        shift = (0.5 + ring * 0.6180339887498949) % 1.0
        found += [direction(a, elevations[ring]) for a in _azimuths(rig, count, shift)]
    return found


def test_directions(rig: Rig, tests: int) -> list[Array]:
    """Unit vectors from the object to the test views: half-way between rings, spread over the azimuths."""
    elevations = np.linspace(*rig.elevations_deg, rig.rings)
    between = 0.5 * (elevations[:-1] + elevations[1:]) if rig.rings > 1 else elevations + 7.0
    first, last = rig.azimuths_deg
    inset = 0.0 if last - first >= 360.0 else 0.12 * (last - first)
    step = (last - first - 2.0 * inset) / max(tests, 1)
    return [
        direction(first + inset + (i + 0.37) * step, between[i % len(between)] + (1.5 if i % 2 else -1.5))
        for i in range(tests)
    ]


def cameras_around(mesh: Mesh, rig: Rig, directions: list[Array], width: int, height: int) -> list[Camera]:
    """Cameras that look at the middle of the mesh's bounding box from the given directions.

    All are at one distance, the smallest at which none of them cuts the mesh off.
    """
    middle = 0.5 * (mesh.vertices.min(axis=0) + mesh.vertices.max(axis=0))

    def look(d: Array, distance: float) -> Camera:
        eye = middle + distance * d
        return Camera.look_at(eye, middle, fov_y_deg=rig.fov_y_deg, width=width, height=height)

    distance = fitting_distance(mesh, [look(d, 1.0) for d in directions], middle)
    return [look(d, distance) for d in directions]


def jittered(directions: list[Array], degrees: float, random: np.random.Generator) -> list[Array]:
    """Turn every direction by a random angle of standard deviation `degrees` along either axis."""
    found = []
    for d in directions:
        moved = d + np.radians(degrees) * random.standard_normal(3)
        found.append(moved / np.linalg.norm(moved))
    return found
