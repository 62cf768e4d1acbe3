"""Unit vectors as points of a square: the octahedral map, whole numbers on either axis."""

from __future__ import annotations

import numpy as np

from ibrpipe.types import Array


def octahedral(normals: Array, bits: int) -> Array:
    """Return coordinates (N, 2) int64 of vectors (N, 3), each below 2^bits in size; unknown ones (NaN) become 0."""
    known = np.nan_to_num(normals.astype(np.float64))
    size = np.abs(known).sum(axis=1, keepdims=True)
    flat = known / np.where(size > 0, size, 1.0)
    outer = (1.0 - np.abs(flat[:, 1::-1])) * np.where(flat[:, :2] < 0, -1.0, 1.0)
    square = np.where(flat[:, 2:] < 0, outer, flat[:, :2])
    return np.round(square * _half(bits)).astype(np.int64)


def from_octahedral(square: Array, bits: int) -> Array:
    """Return the unit vectors (N, 3) float32 of coordinates (N, 2)."""
    flat = np.clip(square / _half(bits), -1.0, 1.0)
    last = 1.0 - np.abs(flat).sum(axis=1)
    outer = (1.0 - np.abs(flat[:, ::-1])) * np.where(flat < 0, -1.0, 1.0)
    found = np.column_stack([np.where(last[:, None] < 0, outer, flat), last])
    return (found / np.linalg.norm(found, axis=1, keepdims=True)).astype(np.float32)


def _half(bits: int) -> int:
    return int(2 ** (bits - 1) - 1)
