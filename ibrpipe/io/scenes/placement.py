"""Affine matrices of copies as scene files state them."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from ibrpipe.errors import FormatError, MissingFileError
from ibrpipe.io.documents.scene import Placement, Rotation
from ibrpipe.io.untrusted.arrays import load_npy
from ibrpipe.types import Array


def placement_matrix(placement: Placement) -> Array:
    """(4, 4) float64: the matrix as given, or scale, then turns, then move."""
    matrix = np.eye(4)
    if placement.matrix is not None:
        matrix[: len(placement.matrix)] = placement.matrix
        return matrix
    matrix[:3, :3] = np.diag(np.broadcast_to(1.0 if placement.scale is None else np.asarray(placement.scale), 3))
    turns = [placement.rotate] if isinstance(placement.rotate, Rotation) else placement.rotate or []
    for turn in turns:
        matrix[:3, :3] = _rotation(turn) @ matrix[:3, :3]
    matrix[:3, 3] = 0.0 if placement.translate is None else placement.translate
    return matrix


def _rotation(turn: Rotation) -> Array:
    """Rodrigues' formula; quarter turns are exact."""
    x, y, z = np.asarray(turn.axis, np.float64) / np.linalg.norm(turn.axis)
    quarters = turn.degrees / 90.0
    if quarters == round(quarters):
        cosine, sine = ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0))[round(quarters) % 4]
    else:
        cosine, sine = math.cos(math.radians(turn.degrees)), math.sin(math.radians(turn.degrees))
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + sine * cross + (1.0 - cosine) * cross @ cross


def read_matrices(file: Path) -> Array:
    """Read (N, 4, 4) float64 matrices of a ``.npy`` file of (N, 4, 4) or (N, 3, 4) numbers.

    Raises
    ------
    MissingFileError, FormatError
        There is no such file, or it holds something else.
    """
    if not file.is_file():
        raise MissingFileError(f"{file}: the matrices do not exist; write them with numpy.save")
    found = load_npy(file)
    if found.dtype.kind not in "fiu" or found.ndim != 3 or found.shape[1:] not in ((4, 4), (3, 4)):
        told = f"{found.dtype} {found.shape}"
        raise FormatError(f"{file}: matrices must be (N, 4, 4) or (N, 3, 4) numbers, got {told}")
    matrices = np.tile(np.eye(4), (len(found), 1, 1))
    matrices[:, : found.shape[1]] = found
    return matrices


def singular(matrices: Array) -> Array:
    """Which (N, 4, 4) matrices flatten what they place: (N,) bool; a rounding error is no thickness."""
    values = np.linalg.svd(matrices[:, :3, :3], compute_uv=False)
    return values[:, 2] <= 1e-12 * values[:, 0]


def from_trs(translation: Array, rotation: Array, scale: Array) -> Array:
    """(N, 4, 4) of translations (N, 3), unit quaternions (N, 4) x y z w and scales (N, 3), as glTF has them."""
    x, y, z, w = np.moveaxis(rotation, -1, 0)
    turn = np.stack(
        [
            np.stack([1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)], axis=-1),
            np.stack([2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)], axis=-1),
            np.stack([2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)], axis=-1),
        ],
        axis=-2,
    )
    matrices = np.tile(np.eye(4), (len(translation), 1, 1))
    with np.errstate(invalid="ignore"):  # infinity times zero is told by the caller
        matrices[:, :3, :3] = turn * scale[:, None, :]
    matrices[:, :3, 3] = translation
    return matrices
