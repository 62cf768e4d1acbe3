"""Normals as what they differ by from those that depth gives: two numbers a sample, as a picture.

The sphere is laid flat by Lambert's azimuthal projection round the direction toward the viewer of the frame, where two
neighbouring normals are neighbours, and equal angles are equally far (its inverse: `raise_up`).
"""

from __future__ import annotations

import numpy as np

from ibrpipe.types import Array, Camera, ParallelFrame

#: code of no difference, and codes of a difference of 1 (90 degrees beside the pole)
ZERO, SCALE = 128, 127.0


def differences(normal: Array, derived: Array, frame: ParallelFrame | Camera) -> Array:
    """Return the codes (S, 2) uint8 of unit normals (S, 3) against derived ones (S, 3), world; NaN counts as equal."""
    axes = _axes(frame)
    apart = np.nan_to_num(_lay_flat(normal.astype(np.float64) @ axes.T)) - _lay_flat(derived @ axes.T)
    apart[~np.isfinite(normal).all(axis=1)] = 0.0
    return (ZERO + np.round(SCALE * np.clip(apart, -1.0, 1.0))).astype(np.uint8)


def normals_of(codes: Array, derived: Array, frame: ParallelFrame | Camera) -> Array:
    """Return the unit normals (S, 3) float32, world, of codes (S, 2) against derived ones (S, 3)."""
    axes = _axes(frame)
    flat = _lay_flat(derived @ axes.T) + (codes.astype(np.float64) - ZERO) / SCALE
    return (_raise_up(flat) @ axes).astype(np.float32)


def _axes(frame: ParallelFrame | Camera) -> Array:
    """(3, 3) rows: right, across, toward the viewer; unit, orthogonal, world."""
    along, ahead = (frame.cam_from_world[0, :3], frame.cam_from_world[2, :3]) if isinstance(frame, Camera) else (
        frame.a, frame.f
    )  # fmt: skip
    toward = -ahead / np.linalg.norm(ahead)
    right = along - (along @ toward) * toward
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(toward, right), toward])


def _lay_flat(normal: Array) -> Array:
    """(S, 2) of directions (S, 3) of any length: within the unit circle where they face the viewer."""
    size = np.linalg.norm(normal, axis=1)
    unit = normal / np.where(size > 0, size, 1.0)[:, None]
    return unit[:, :2] / np.sqrt(np.maximum(1.0 + unit[:, 2:], 1e-6))


def _raise_up(flat: Array) -> Array:
    """(S, 3) unit directions of places (S, 2), which may lie a little outside the sphere's map."""
    square = np.minimum((flat**2).sum(axis=1), 2.0)
    up = np.column_stack([flat * np.sqrt(2.0 - square)[:, None], 1.0 - square])
    size = np.linalg.norm(up, axis=1, keepdims=True)
    return np.where(size > 0, up / np.where(size > 0, size, 1.0), (0.0, 0.0, -1.0))
