"""COLMAP models, text or binary, old or with rigs and frames, as lenses and poses."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np

from ibrpipe.errors import CaptureError, FormatError
from ibrpipe.io.lenses import Lens
from ibrpipe.io.pycolmap_import import import_pycolmap
from ibrpipe.io.shots import Shot

#: Where a model may be inside a capture folder, best first
FOLDERS = ("sparse/0", "sparse", "colmap/sparse/0")


def find_model(capture: Path) -> Path | None:
    """Folder of the COLMAP model inside a capture folder, or None."""
    for name in FOLDERS:
        folder = capture / name
        if any((folder / f"images{suffix}").is_file() for suffix in (".bin", ".txt")):
            return folder
    return None


def read_model(folder: Path, images: Path) -> tuple[Shot, ...]:
    """Read all posed images of a COLMAP model.

    Parameters
    ----------
    folder : Path
        Holds cameras, images, points3D (and rigs, frames in newer models) as .bin or .txt.
    images : Path
        Folder that the image names are relative to.

    Returns
    -------
    tuple of Shot
        Sorted by name.

    Raises
    ------
    FormatError, CaptureError
        Files missing or damaged, an unknown camera model, a pose that is none, no posed image.
    """
    suffix = ".bin" if (folder / "images.bin").is_file() else ".txt"
    for stem in ("cameras", "images", "points3D"):
        if not (folder / f"{stem}{suffix}").is_file():
            raise FormatError(
                f"{folder}: {stem}{suffix} is missing; copy the whole COLMAP model (points3D may be empty)"
            )
    if suffix == ".txt":
        _check_cameras_text(folder / "cameras.txt")
        _check_images_text(folder / "images.txt")
    model = _read(folder)
    lenses = {key: _lens(camera, folder) for key, camera in model.cameras.items()}
    shots = [_shot(model.images[key], lenses, images, folder) for key in sorted(model.reg_image_ids())]
    if not shots:
        raise CaptureError(f"{folder}: the COLMAP model has no image with a pose; calibrate the photos first")
    return tuple(sorted(shots, key=lambda shot: shot.file))


def _read(folder: Path) -> Any:
    pycolmap = import_pycolmap()
    try:
        return pycolmap.Reconstruction(str(folder))
    except (ValueError, IndexError, KeyError, RuntimeError, OSError, MemoryError) as error:
        reason = " ".join(str(error).split())[:160]
        raise FormatError(f"{folder}: the COLMAP model is damaged ({reason}); export it again") from error


def _lens(camera: Any, folder: Path) -> Lens:
    try:
        return Lens(camera.model_name, tuple(map(float, camera.params)), int(camera.width), int(camera.height))
    except CaptureError as error:
        raise CaptureError(f"{folder}: camera {camera.camera_id}: {error}") from error


def _shot(image: Any, lenses: dict[int, Lens], images: Path, folder: Path) -> Shot:
    if image.camera_id not in lenses:
        raise FormatError(f"{folder}: image {image.name} names camera {image.camera_id}, which the model does not hold")
    pose = np.asarray(image.cam_from_world().matrix(), np.float64)
    if not np.isfinite(pose).all() or not np.any(pose[:, :3]):
        raise CaptureError(
            f"{folder}: the pose of image {image.name} holds NaN or infinity; remove it or calibrate again"
        )
    return Shot(image.name, images / image.name, lenses[image.camera_id], pose)


def _rows(path: Path) -> list[tuple[int, str]]:
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except UnicodeDecodeError as error:
        raise FormatError(f"{path}: is not UTF-8 text; export the model again") from error
    return [(number, line.strip()) for number, line in enumerate(lines, 1) if not line.startswith("#")]


def _check_cameras_text(path: Path) -> None:
    """Say in which line of cameras.txt what is wrong: pycolmap does not."""
    for number, line in _rows(path):
        words = line.split()
        if not words:
            continue
        try:
            lens = [float(word) for word in words[4:]]
            Lens(words[1], tuple(lens), int(words[2]), int(words[3]))
        except (ValueError, IndexError) as error:
            if isinstance(error, CaptureError):
                raise CaptureError(f"{path}, line {number}: {error}") from error
            raise FormatError(f"{path}, line {number}: expected ID MODEL WIDTH HEIGHT PARAMS, got {line!r}") from error


def _check_images_text(path: Path) -> None:
    """Say in which line of images.txt what is wrong: every other line is an image, the rest are its points."""
    for number, line in _image_rows(path):
        words = line.split(maxsplit=9)
        try:
            values = [float(word) for word in words[1:8]]
            int(words[0]), int(words[8]), words[9]
        except (ValueError, IndexError) as error:
            raise FormatError(
                f"{path}, line {number}: expected ID QW QX QY QZ TX TY TZ CAMERA_ID NAME, got {line[:80]!r}"
            ) from error
        if not all(map(math.isfinite, values)):
            raise CaptureError(f"{path}, line {number}: the pose of {words[9]} holds NaN or infinity; calibrate again")
        if not math.hypot(*values[:4]) > 1e-9:
            raise CaptureError(
                f"{path}, line {number}: the quaternion of {words[9]} is zero; expected a unit quaternion"
            )


def _image_rows(path: Path) -> list[tuple[int, str]]:
    """Lines that describe images: after each follows one line of points, which may be empty."""
    rows, found, index = _rows(path), [], 0
    while index < len(rows):
        if rows[index][1]:
            found.append(rows[index])
            index += 1
        index += 1
    return found
