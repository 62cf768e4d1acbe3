"""Agisoft Metashape's ``cameras.xml`` (File > Export > Export Cameras) as lenses and poses.

A camera's transform is world-from-camera with x right, y down, z forward, in the axes of its chunk; the chunk's own
transform (rotation, translation, scale) leads to the local coordinates in which Metashape exports its models.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from ibrpipe.core.similarity import move_poses
from ibrpipe.errors import CaptureError, FormatError
from ibrpipe.io.cameras.lenses import Lens
from ibrpipe.io.cameras.shots import Shot, photo_by_label
from ibrpipe.io.cameras.transforms import perspective_lens
from ibrpipe.types import Array

METASHAPE = "cameras.xml"
#: Skew over the focal length beyond which leaving it out would show
_SKEW = 1e-4


def read_metashape(path: Path, images: Path) -> tuple[Shot, ...]:
    """Read the aligned cameras of the first chunk.

    Parameters
    ----------
    path : Path
    images : Path
        Folder of the photos; labels count with or without suffix.

    Returns
    -------
    tuple of Shot
        Sorted by name.

    Raises
    ------
    FormatError, CaptureError
        Not such a file, a kind of lens that is not supported, no aligned camera.
    """
    try:
        chunk = ElementTree.parse(path).getroot().find(".//chunk")
    except ElementTree.ParseError as error:
        raise FormatError(f"{path}: is not XML ({error}); export the cameras from Metashape again") from error
    if chunk is None:
        raise FormatError(f"{path}: has no chunk; expected cameras exported from Metashape")
    world = _world(path, chunk)
    lenses = {sensor.get("id"): sensor for sensor in chunk.iter("sensor")}
    shots = []
    for camera in chunk.iter("camera"):
        transform, label = camera.find("transform"), camera.get("label", "")
        if transform is None or camera.get("enabled", "1") in ("0", "false"):
            continue
        matrix = _numbers(path, transform, 16, label).reshape(4, 4)
        image = photo_by_label(images, label, path)
        lens = _lens(path, lenses.get(camera.get("sensor_id")), label)
        shots.append(Shot(image.relative_to(images).as_posix(), image, lens, _pose(path, matrix, label, world)))
    if not shots:
        raise CaptureError(f"{path}: holds no aligned camera; align the photos in Metashape and export again")
    return tuple(sorted(shots, key=lambda shot: shot.file))


def _pose(path: Path, matrix: Array, label: str, world: tuple[float, Array, Array]) -> Array:
    R = matrix[:3, :3].T
    if not np.isfinite(matrix).all() or np.abs(R @ R.T - np.eye(3)).max() > 1e-3 or np.linalg.det(R) < 0:
        raise CaptureError(f"{path}: the transform of {label} is no rigid motion; export the cameras again")
    left, _, right = np.linalg.svd(R)
    R = left @ right
    pose = np.concatenate([R, -(R @ matrix[:3, 3])[:, None]], axis=1)
    moved: Array = move_poses(world, pose[None])[0]
    return moved


def _world(path: Path, chunk: ElementTree.Element) -> tuple[float, Array, Array]:
    """Similarity from the chunk's axes to its local coordinates."""
    transform = chunk.find("transform")
    transform = chunk.find("components/component/transform") if transform is None else transform
    if transform is None:
        return 1.0, np.eye(3), np.zeros(3)
    rotation, shift, scale = (transform.find(name) for name in ("rotation", "translation", "scale"))
    return (
        1.0 if scale is None else float(_numbers(path, scale, 1, "chunk")[0]),
        np.eye(3) if rotation is None else _numbers(path, rotation, 9, "chunk").reshape(3, 3),
        np.zeros(3) if shift is None else _numbers(path, shift, 3, "chunk"),
    )


def _numbers(path: Path, element: ElementTree.Element, count: int, what: str) -> Array:
    try:
        numbers = np.array([float(word) for word in (element.text or "").split()])
    except ValueError as error:
        raise FormatError(f"{path}: {element.tag} of {what}: {error}; export the cameras again") from error
    if len(numbers) != count:
        raise FormatError(f"{path}: {element.tag} of {what} holds {len(numbers)} numbers, expected {count}")
    return numbers


def _lens(path: Path, sensor: ElementTree.Element | None, label: str) -> Lens:
    """Return Brown's model; Metashape's p1 and p2 are COLMAP's the other way round."""
    if sensor is None:
        raise FormatError(f"{path}: camera {label} names a sensor that is not there; export the cameras again")
    calibration, size = sensor.find("calibration"), sensor.find("resolution")
    if calibration is None or size is None:
        raise CaptureError(f"{path}: the sensor of {label} has no calibration; align the photos and export again")
    if sensor.get("type", "frame") != "frame":
        raise CaptureError(
            f"{path}: the sensor of {label} is of type {sensor.get('type')}; expected frame: export undistorted photos"
        )
    width, height = int(size.get("width", "0")), int(size.get("height", "0"))
    values = {child.tag: child.text for child in calibration}
    try:
        f, cx, cy, b1, b2, k1, k2, k3, k4, p1, p2 = _values(values)
    except ValueError as error:
        raise FormatError(f"{path}: calibration of {label}: {error}; export the cameras again") from error
    if k4 or abs(b2) > _SKEW * f:
        raise CaptureError(
            f"{path}: the calibration of {label} has skew (b2 = {b2:g}) or k4 = {k4:g}, which no model here has; "
            "switch them off in Metashape's optimisation, or export undistorted photos"
        )
    model, params = perspective_lens(f + b1, f, width / 2.0 + cx, height / 2.0 + cy, (k1, k2, p2, p1, k3))
    return Lens(model, params, width, height)


def _values(values: dict[str, str | None]) -> Sequence[float]:
    names = ("f", "cx", "cy", "b1", "b2", "k1", "k2", "k3", "k4", "p1", "p2")
    return [float(values.get(name) or 0.0) for name in names]
