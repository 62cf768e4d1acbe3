"""Two calibrations of the same photos against each other, whatever their worlds."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ibrpipe.core.similarity import centers, direction_angle_deg, fit_cameras, move_poses, rotation_angle_deg
from ibrpipe.errors import CaptureError, MissingFileError
from ibrpipe.io.cameras.colmap import find_model, is_model, read_model
from ibrpipe.io.cameras.lenses import Lens, directions_of
from ibrpipe.io.cameras.shots import Shot
from ibrpipe.io.cameras.sources import has_cameras
from ibrpipe.io.captures import read_shots
from ibrpipe.types import Array

#: Rays of so many points along each side of a photo are compared
GRID = 16


def compare_cameras(path: Path, truth: Path) -> dict[str, Any]:
    """Align the cameras at `path` to those at `truth` by a similarity, and measure what is left.

    Parameters
    ----------
    path, truth : Path
        Each a COLMAP model, or a capture or calibrate folder.

    Returns
    -------
    dict
        Photos in common, scale, mean and largest distance of centres in the truth's units (``over_extent``: over the
        largest distance between its centres), mean and largest rotation in degrees, mean and largest angle in degrees
        between the rays of the same pixels, focal lengths over the truth's.

    Raises
    ------
    MissingFileError, FormatError, CaptureError
        Cameras cannot be read, or fewer than two photos are in common.

    Notes
    -----
    A camera's rotation and the position of its principal point hang together: a principal point that lies aside and a
    camera that is turned back by as much see nearly the same. Rays of pixels count both at once, and the focal length
    and the distortion, too: they are what a renderer uses. They are compared without the distance of the centres.
    """
    found, wanted = _cameras(path), _cameras(truth)
    names = sorted(found.keys() & wanted.keys())
    if len(names) < 2:
        raise CaptureError(
            f"{path} and {truth} have {len(names)} photos in common, at least 2 are needed; photos count by their names"
        )
    old = np.array([found[name].cam_from_world for name in names])
    new = np.array([wanted[name].cam_from_world for name in names])
    similarity = fit_cameras(old, new)
    moved = move_poses(similarity, old)
    off = np.linalg.norm(centers(moved) - centers(new), axis=1)
    angle = rotation_angle_deg(moved[:, :, :3], new[:, :, :3])
    rays = np.array(
        [
            direction_angle_deg(_rays(found[name].lens, moved[i]), _rays(wanted[name].lens, new[i]))
            for i, name in enumerate(names)
        ]
    )
    extent = float(np.linalg.norm(centers(new)[:, None] - centers(new)[None], axis=2).max())
    return {
        "photos": len(names),
        "missing": sorted(wanted.keys() - found.keys()),
        "scale": similarity[0],
        "center_mean": float(off.mean()),
        "center_max": float(off.max()),
        "center_mean_over_extent": float(off.mean()) / extent if extent > 0 else None,
        "rotation_mean_deg": float(angle.mean()),
        "rotation_max_deg": float(angle.max()),
        "rays_mean_deg": float(np.nanmean(rays)),
        "rays_max_deg": float(np.nanmax(rays)),
        "focal_over_truth": float(np.mean([_focal(found[name].lens) / _focal(wanted[name].lens) for name in names])),
    }


def _rays(lens: Lens, cam_from_world: Array) -> Array:
    """Directions in the world of points spread evenly over a photo, (N, 3); NaN where the lens shows nothing."""
    steps = (np.arange(GRID) + 0.5) / GRID
    columns, rows = np.meshgrid(steps * lens.width, steps * lens.height)
    plane = directions_of(lens, np.stack([columns.ravel(), rows.ravel()], axis=1))
    rays = np.concatenate([plane, np.ones((len(plane), 1))], axis=1)
    turned: Array = rays @ cam_from_world[:, :3] / np.linalg.norm(rays, axis=1, keepdims=True)
    return turned


def _cameras(path: Path) -> dict[str, Shot]:
    """Name of each photo to its camera."""
    if not path.exists():
        raise MissingFileError(f"{path} does not exist; give a COLMAP model, or a capture, run or calibrate folder")
    model = path if is_model(path) else find_model(path)
    if model is not None:
        return {shot.file: shot for shot in read_model(model, model)}
    if has_cameras(path):
        return {shot.file: shot for shot in read_shots(path)}
    raise CaptureError(f"{path}: no cameras found; give a COLMAP model, or a capture, run or calibrate folder")


def _focal(lens: Lens) -> float:
    return float((lens.K[0, 0] + lens.K[1, 1]) / 2.0)
