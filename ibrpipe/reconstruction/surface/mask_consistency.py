"""Consistency of masks with the surface: where they lost a part of the object they say nothing.

Every point of an object projects inside its mask, hidden or not. Masks by brightness lose what lies in shadow; an
outline there would cut away surface that other photos show.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ibrpipe.reconstruction.depth.fusion import Cloud
from ibrpipe.reconstruction.surface.silhouettes import Outline
from ibrpipe.types import Array

#: depth maps that must make up a point for it to speak against a mask
VOTES = 3
#: pixels outside an outline from which on a point contradicts it
MARGIN = 3.0
#: share of the photos that a point may contradict; one that stands outside of more is itself wrong
WRONG = 0.25
#: radius of the place that a contradicting point takes out of a mask, pixels
SPREAD = 4
#: points that are tried at most
_MOST = 200_000


def contradicting(cloud: Cloud, outlines: Sequence[Outline]) -> Array:
    """Return the points (N, 3) of a cloud that a few masks leave out although they are sure."""
    sure = cloud.position[cloud.votes >= VOTES]
    sure = sure[:: max(1, -(-len(sure) // _MOST))]
    outside, told = np.zeros(len(sure), np.int32), np.zeros(len(sure), np.int32)
    for each in outlines:
        distance = outline_distances(each, sure)
        outside += distance > MARGIN
        told += np.isfinite(distance)
    return sure[(outside > 0) & (outside <= WRONG * told)]


def without_contradicted(outline: Outline, points: Array) -> Outline:
    """Return an outline that says nothing (NaN) around the points (N, 3) that it leaves out."""
    import cv2

    off = outline_distances(outline, points) > MARGIN
    if not off.any():
        return outline
    marked = np.zeros(outline.distance.shape, np.uint8)
    column, row = _pixels(outline, points[off])
    marked[row.astype(int), column.astype(int)] = 1
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * SPREAD + 1, 2 * SPREAD + 1))
    unsure = cv2.dilate(marked, disc) > 0
    distance = np.where(unsure & (outline.distance > 0), np.float32(np.nan), outline.distance)
    return replace(outline, distance=distance, contradicted=True)


def outline_distances(outline: Outline, points: Array) -> Array:
    """Return how many pixels points (N, 3) project outside an outline; NaN off the picture and where it cannot say."""
    column, row = _pixels(outline, points)
    height, width = outline.distance.shape
    shown = (column >= 0) & (row >= 0) & (column < width) & (row < height)
    found = np.full(len(points), np.nan, np.float32)
    found[shown] = outline.distance[row[shown].astype(int), column[shown].astype(int)]
    return found


def _pixels(outline: Outline, points: Array) -> tuple[Array, Array]:
    """Project points (N, 3) to columns and rows; -1 -1 behind the camera."""
    camera = outline.camera
    seen = (camera.K @ (camera.R @ points.T + camera.t.reshape(3, 1))).T
    front = seen[:, 2] > 0
    z = np.where(front, seen[:, 2], 1.0)
    return np.where(front, seen[:, 0] / z, -1.0), np.where(front, seen[:, 1] / z, -1.0)
