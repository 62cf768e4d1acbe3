"""Where the world's origin, axes and unit come from: given cameras, positions, markers, or the photos themselves."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ibrpipe.calibration.features import Features
from ibrpipe.calibration.job import Job
from ibrpipe.calibration.markers import Spot, locate, marker_similarity
from ibrpipe.core.similarity import (
    centers,
    fit_cameras,
    fit_points,
    move_points,
    move_poses,
    rotation_angle_deg,
    spread,
)
from ibrpipe.errors import CaptureError, FormatError, MissingFileError
from ibrpipe.io.cameras.colmap_write import SparseModel
from ibrpipe.io.photos.exif import local_metres
from ibrpipe.types import Array

Similarity = tuple[float, Array, Array]


@dataclass(frozen=True, eq=False)
class AlignmentInputs:
    """What an alignment can be found from."""

    job: Job
    features: Sequence[Features]
    model: SparseModel


@dataclass(frozen=True, eq=False)
class Aligned:
    """A model aligned to its world.

    Attributes
    ----------
    model : SparseModel
    source : {"given", "markers", "positions", "gps", "own"}
        Where the world comes from.
    units : str
    words : str
        How it was found.
    measured : dict
        Figures, such as how well it fits.
    """

    model: SparseModel
    source: str
    units: str
    words: str
    measured: dict[str, Any]


def align_model(inputs: AlignmentInputs) -> Aligned:
    """Move a model to its world.

    Raises
    ------
    CaptureError, FormatError, MissingFileError
        What the settings name for it is missing or does not suffice.
    """
    align = inputs.job.config["align"]
    if align == "auto":
        align = _choose(inputs)
    find = {"given": _given, "markers": _markers, "positions": _positions, "gps": _gps, "none": _own}[align]
    similarity, source, units, words, measured = find(inputs)
    return Aligned(inputs.model.moved(similarity), source, units, words, {**measured, "scale": similarity[0]})


_Found = tuple[Similarity, str, str, str, dict[str, Any]]


def _choose(inputs: AlignmentInputs) -> str:
    config = inputs.job.config
    if len(_known_poses(inputs)[0]) >= 2:
        return "given"
    if config["markers"] is not None:
        return "markers"
    return "positions" if config["positions"] is not None else "none"


def _known_poses(inputs: AlignmentInputs) -> tuple[Array, Array]:
    """Poses found and poses given of the photos that have both, (N, 3, 4) each."""
    given = {photo.name: photo.pose for photo in inputs.job.photos if photo.pose is not None}
    both = [image for image in inputs.model.images if image.name in given]
    found = np.array([image.cam_from_world for image in both]).reshape(-1, 3, 4)
    return found, np.array([given[image.name] for image in both]).reshape(-1, 3, 4)


def _given(inputs: AlignmentInputs) -> _Found:
    found, given = _known_poses(inputs)
    if len(found) < 2:
        raise CaptureError(
            f"{_where(inputs)}: {len(found)} of the calibrated photos have given cameras, at least 2 are needed to "
            "align to them; set calibrate.align to something else"
        )
    similarity = fit_cameras(found, given)
    moved = move_poses(similarity, found)
    off = np.linalg.norm(centers(moved) - centers(given), axis=1)
    angle = rotation_angle_deg(moved[:, :, :3], given[:, :, :3])
    measured = {
        "cameras": len(found),
        "mean_center_shift": float(off.mean()),
        "max_center_shift": float(off.max()),
        "mean_rotation_deg": float(angle.mean()),
    }
    words = f"aligned to {len(found)} given cameras"
    return similarity, "given", "those of the given cameras", words, measured


def _markers(inputs: AlignmentInputs) -> _Found:
    markers = inputs.job.config["markers"]
    if markers is None:
        raise CaptureError("calibrate.align is markers but calibrate.markers is not set; state dictionary and size")
    similarity, rms, words = marker_similarity(inputs.job.photos, markers, inputs.model)
    return similarity, "markers", "those of calibrate.markers.size", words, {"rms": rms}


def _positions(inputs: AlignmentInputs) -> _Found:
    name = inputs.job.config["positions"]
    if name is None:
        raise CaptureError("calibrate.align is positions but calibrate.positions is not set; name a CSV file")
    similarity, measured = _by_positions(inputs, read_positions(Path(name)), name)
    return similarity, "positions", f"those of {Path(name).name}", f"aligned to the places of {name}", measured


def _gps(inputs: AlignmentInputs) -> _Found:
    pairs = zip(inputs.job.photos, inputs.features)
    known = {photo.name: each.exif.gps for photo, each in pairs if each.exif.gps is not None}
    metres = local_metres(np.array(list(known.values()), np.float64).reshape(-1, 3)) if known else np.zeros((0, 3))
    positions = dict(zip(known, metres))
    similarity, measured = _by_positions(inputs, positions, "the photos' GPS tags")
    return similarity, "gps", "metres east, north, up", "aligned to the photos' GPS tags", measured


def _by_positions(
    inputs: AlignmentInputs, positions: dict[str, Array], source: str
) -> tuple[Similarity, dict[str, Any]]:
    both = [image for image in inputs.model.images if image.name in positions]
    found = centers(np.array([image.cam_from_world for image in both]).reshape(-1, 3, 4))
    wanted = np.array([positions[image.name] for image in both]).reshape(-1, 3)
    if len(both) < 3 or min(spread(found), spread(wanted)) < 0.02:
        raise CaptureError(
            f"{source}: gives places for {len(both)} of the calibrated photos; expected at least 3 that are not on one "
            "line. Add places, or set calibrate.align: none"
        )
    similarity = fit_points(found, wanted)
    off = np.linalg.norm(move_points(similarity, found) - wanted, axis=1)
    rms = float(np.sqrt((off**2).mean()))
    return similarity, {"cameras": len(both), "rms": rms, "max_center_shift": float(off.max())}


def read_positions(path: Path) -> dict[str, Array]:
    """Read a CSV file with columns ``file``, ``x``, ``y``, ``z``: where the camera stood for each photo, scene units.

    Raises
    ------
    MissingFileError, FormatError
        The file is missing, a column is missing, or a value is no number.
    """
    if not path.is_file():
        raise MissingFileError(
            f"{path}: does not exist; calibrate.positions names a CSV file with columns file, x, y, z"
        )
    try:
        with path.open(encoding="utf-8-sig", newline="") as source:
            rows = list(csv.DictReader(source))
        positions = {row["file"]: np.array([float(row[axis]) for axis in "xyz"]) for row in rows}
    except (KeyError, ValueError, TypeError, UnicodeDecodeError, csv.Error) as error:
        raise FormatError(f"{path}: expected a CSV file with columns file, x, y, z of numbers ({error!r})") from error
    if not all(np.isfinite(each).all() for each in positions.values()):
        raise FormatError(f"{path}: holds NaN or infinity; expected finite numbers")
    return positions


def _own(inputs: AlignmentInputs) -> _Found:
    """The photos' own world: origin amid the points, z up as the photos are, unit = how far the cameras are away."""
    model = inputs.model
    poses = np.array([image.cam_from_world for image in model.images])
    middle = np.median(model.xyz, axis=0)
    R = _upright(poses)
    away = np.concatenate([_distances(image.cam_from_world, model.xyz[image.points]) for image in model.images])
    scale, units, words = 1.0 / float(np.median(away)), "arbitrary: cameras are 1 away from what they see", "own world"
    known = inputs.job.config["distances"]
    if known:
        scale, spread_of = _by_distances(inputs, known)
        words = f"own world, scaled by {len(known)} known distance(s)"
        return (scale, R, -scale * (R @ middle)), "own", "those of the known distances", words, {"spread": spread_of}
    return (scale, R, -scale * (R @ middle)), "own", units, words, {}


def _distances(pose: Array, points: Array) -> Array:
    return np.linalg.norm(points @ pose[:, :3].T + pose[:, 3], axis=1)


def _upright(poses: Array) -> Array:
    """Rotation whose third row is up: the mean upward direction of the photos."""
    ups = -poses[:, 1, :3]
    up = ups.mean(axis=0)
    if np.linalg.norm(up) < 0.3:  # photos in all attitudes: up is what their rows are most level to
        up = np.linalg.svd(poses[:, 0, :3])[2][2]
        up = up if (ups @ up).sum() >= 0 else -up
    up = up / np.linalg.norm(up)
    ahead = poses[0, 2, :3] - (poses[0, 2, :3] @ up) * up
    if np.linalg.norm(ahead) < 1e-6:
        ahead = np.cross(up, poses[0, 0, :3])
    ahead = ahead / np.linalg.norm(ahead)
    return np.array([np.cross(ahead, up), ahead, up])


def _by_distances(inputs: AlignmentInputs, known: Sequence[dict[str, Any]]) -> tuple[float, float]:
    """Scale by known distances, and the largest relative difference between what they say."""
    scales = []
    for index, each in enumerate(known):
        ends = [
            locate(Spot({name: (pixel[0], pixel[1]) for name, pixel in each[end].items()}), inputs.model)
            for end in ("start", "end")
        ]
        length = float(np.linalg.norm(ends[0] - ends[1]))
        if not length > 0:
            raise CaptureError(
                f"{_where(inputs)}: the ends of calibrate.distances.{index} could not be located; each needs its pixel "
                "in two calibrated photos or more, which agree to 3 pixels"
            )
        scales.append(each["length"] / length)
    scale = float(np.median(scales))
    return scale, float(np.ptp(scales) / scale)


def _where(inputs: AlignmentInputs) -> str:
    return str(Path(inputs.job.photos[0].image).parent)
