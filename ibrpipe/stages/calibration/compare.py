"""Two calibrations of the same photos against each other, whatever their worlds."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ibrpipe.core.similarity import centers, fit_cameras, move_poses, turn_degrees
from ibrpipe.errors import CaptureError, MissingFileError
from ibrpipe.io.captures import has_cameras, read_shots
from ibrpipe.io.colmap import find_model, is_model, read_model
from ibrpipe.types import Array


def compare_cameras(path: Path, truth: Path) -> dict[str, Any]:
    """Align the cameras at `path` to those at `truth` by a similarity, and measure what is left.

    Parameters
    ----------
    path, truth : Path
        Each a COLMAP model, or a capture, run or calibrate folder.

    Returns
    -------
    dict
        Photos in common, scale, mean and largest distance of centres in the truth's units (``over_extent``: over the
        largest distance between its centres), mean and largest rotation in degrees, focal lengths over the truth's.

    Raises
    ------
    MissingFileError, FormatError, CaptureError
        Cameras cannot be read, or fewer than two photos are in common.
    """
    found, wanted = _cameras(path), _cameras(truth)
    names = sorted(found.keys() & wanted.keys())
    if len(names) < 2:
        raise CaptureError(
            f"{path} and {truth} have {len(names)} photos in common, at least 2 are needed; photos count by their names"
        )
    old = np.array([found[name][0] for name in names])
    new = np.array([wanted[name][0] for name in names])
    similarity = fit_cameras(old, new)
    moved = move_poses(similarity, old)
    off = np.linalg.norm(centers(moved) - centers(new), axis=1)
    turn = turn_degrees(moved[:, :, :3], new[:, :, :3])
    extent = float(np.linalg.norm(centers(new)[:, None] - centers(new)[None], axis=2).max())
    return {
        "photos": len(names),
        "missing": sorted(wanted.keys() - found.keys()),
        "scale": similarity[0],
        "center_mean": float(off.mean()),
        "center_max": float(off.max()),
        "center_mean_over_extent": float(off.mean()) / extent if extent > 0 else None,
        "rotation_mean_deg": float(turn.mean()),
        "rotation_max_deg": float(turn.max()),
        "focal_over_truth": float(np.mean([found[name][1] / wanted[name][1] for name in names])),
    }


def _cameras(path: Path) -> dict[str, tuple[Array, float]]:
    """Name of each photo to its pose and focal length."""
    if not path.exists():
        raise MissingFileError(f"{path} does not exist; give a COLMAP model, or a capture, run or calibrate folder")
    for folder in (path, path / "calibrate"):
        model = folder if is_model(folder) else find_model(folder)
        if model is not None:
            return {shot.file: (shot.cam_from_world, _focal(shot.lens.K)) for shot in read_model(model, model)}
    if has_cameras(path):
        return {shot.file: (shot.cam_from_world, _focal(shot.lens.K)) for shot in read_shots(path)}
    raise CaptureError(f"{path}: no cameras found; give a COLMAP model, or a capture, run or calibrate folder")


def _focal(K: Array) -> float:
    return float((K[0, 0] + K[1, 1]) / 2.0)
