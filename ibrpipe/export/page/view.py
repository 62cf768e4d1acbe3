"""Which way is up, and from where an object is first seen."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ibrpipe.export.page.notes import PageNotes
from ibrpipe.io.views import read_views
from ibrpipe.types import Array, Asset, Camera
from ibrpipe.types.bounds import ball_around

#: photos count as taken from one side when the mean of their directions is longer than this
ONE_SIDED = 0.6
#: field of view of the poster along y, degrees
FIELD_OF_VIEW = 35.0


@dataclass(frozen=True)
class Start:
    """The first view.

    Attributes
    ----------
    center, radius : (3,) float64, float
        A ball that holds the object, world.
    up, toward : (3,) float64
        Unit directions in the world: up, and from the object to the eye.
    """

    center: Array
    radius: float
    up: Array
    toward: Array

    def camera(self, width: int, height: int) -> Camera:
        """Return the camera of the first view: it holds the whole ball."""
        eye = self.center + 1.08 * self.radius / np.sin(np.radians(FIELD_OF_VIEW / 2)) * self.toward
        return Camera.look_at(eye, self.center, self.up, FIELD_OF_VIEW, width, height)


def find_start(asset: Asset, places: Array, views: Path | None, notes: PageNotes) -> Start:
    """Choose the first view as the photos stand; without photos, as the texture with most samples faces.

    Parameters
    ----------
    places : (S, 3) float64
        Positions of samples in the world.
    views : Path or None
        ``views.json`` of the run.
    notes : PageNotes
        They may say what is up.
    """
    center, radius = ball_around(places)
    cameras = [each.camera for each in read_views(views).train] if views is not None else []
    up = up_in(notes, cameras)
    if cameras:
        return Start(center, radius, up, middle_direction([each.center - center for each in cameras], up))
    largest = max(asset.textures, key=lambda each: len(each.layers.depth)).layers.frame
    toward = largest.center - center if isinstance(largest, Camera) else -largest.f + 0.3 * up
    return Start(center, radius, up, toward / np.linalg.norm(toward))


def up_in(notes: PageNotes, cameras: Sequence[Camera]) -> Array:
    """Return the unit vector (3,) float64 that is up: as the notes say, else as the photos stand, else z."""
    if notes.up is not None:
        up = np.array(notes.up)
    else:
        up = -np.sum([each.R[1] for each in cameras], axis=0) if cameras else np.array([0.0, 0.0, 1.0])
    length = float(np.linalg.norm(up))
    return up / length if length > 0 else np.array([0.0, 0.0, 1.0])


def middle_direction(away: Sequence[Array], up: Array) -> Array:
    """Return the direction to the camera in the middle; round an object, to the one at the middle height.

    Parameters
    ----------
    away : sequence of (3,)
        From the object to each camera.
    """
    lengths = np.linalg.norm(away, axis=1, keepdims=True)
    directions = np.array(away) / np.where(lengths > 0, lengths, 1.0)
    mean = directions.mean(axis=0)
    if np.linalg.norm(mean) > ONE_SIDED:
        return directions[np.argmax(directions @ mean)]
    heights = directions @ up
    return directions[np.argmin(abs(heights - np.median(heights)))]
