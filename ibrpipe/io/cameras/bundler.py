"""Bundler's ``bundle.out`` with its ``list.txt`` as lenses and poses; many programs export it.

Cameras look along -z with y up, ``P = R X + t``; pixels count from the photo's middle with y up; r is
multiplied by ``f (1 + k1 r^2 + k2 r^4)``.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from ibrpipe.errors import CaptureError, FormatError, MissingFileError
from ibrpipe.io.cameras.lenses import Lens
from ibrpipe.io.cameras.shots import CameraSet, PhotoFolder, Shot, name_below, refuse_missing
from ibrpipe.io.cameras.transforms import OPENCV_FROM_OPENGL
from ibrpipe.io.photos.image_files import read_header
from ibrpipe.io.untrusted.boundary import reader, utf8_text
from ibrpipe.types import Array

BUNDLER, LIST = "bundle.out", "list.txt"
_REMEDY = "export the cameras again"
#: Rows of numbers of a camera: f k1 k2, three of the rotation, the translation
_ROWS = 5


@reader(_REMEDY)
def read_bundler(path: Path, images: Path) -> CameraSet:
    """Read all cameras that were placed.

    Parameters
    ----------
    path : Path
        ``list.txt`` beside it names the photos, one a line, in the same order.
    images : Path
        Folder of the photos.

    Returns
    -------
    CameraSet
        Photos that were not placed are left out and counted.

    Raises
    ------
    MissingFileError, FormatError, CaptureError
        The list is missing, the file is damaged, or no camera was placed.
    """
    names = _names(path.with_name(LIST))
    rows = _rows(path, len(names))
    photos = PhotoFolder(images)
    missing: list[str] = []
    shots, left = [], []
    for index, label in enumerate(names):
        camera = rows[index]
        if camera[0, 0] <= 0:
            left.append(label)  # Bundler's way to say that a photo was not placed
            continue
        image = photos.find(label, path)
        if image is None:
            missing.append(label)
            continue
        header = read_header(image)
        focal, k1, k2 = camera[0]
        lens = Lens("RADIAL", (focal, header.width / 2.0, header.height / 2.0, k1, k2), header.width, header.height)
        pose = _pose(path, camera, label)
        shots.append(Shot(name_below(image, images), image, lens, pose))
    refuse_missing(missing, len(names), path, images)
    if not shots:
        raise CaptureError(f"{path}: holds no camera with a focal length; export a finished reconstruction")
    told = f"{path.name}: {len(left)} of {len(names)} photos were not placed and are left out"
    warnings = (f"{told}, the first is {left[0]}",) if left else ()
    return CameraSet(tuple(sorted(shots, key=lambda shot: shot.file)), warnings=warnings)


def _names(path: Path) -> list[str]:
    if not path.is_file():
        raise MissingFileError(f"{path}: does not exist; it names the photos of {BUNDLER}, one a line")
    lines = utf8_text(path, _REMEDY).splitlines()
    return [re.sub(r"\s+0(\s+[-+.\deE]+)?$", "", line.strip()) for line in lines if line.strip()]


def _rows(path: Path, count: int) -> Array:
    """Return the numbers of all cameras, (N, 5, 3) float64."""
    lines = [line for line in utf8_text(path, _REMEDY).splitlines() if not line.startswith("#")]
    try:
        stated = int(lines[0].split()[0])
        rows = np.array([[float(word) for word in line.split()] for line in lines[1 : 1 + _ROWS * stated]])
    except (ValueError, IndexError) as error:
        raise FormatError(f"{path}: is no Bundler file ({error}); export it again") from error
    if rows.shape != (_ROWS * stated, 3) or stated != count:
        raise FormatError(
            f"{path}: states {stated} cameras and holds {len(rows) // _ROWS}, list.txt names {count} photos; expected "
            "the same number of each: export both together"
        )
    return rows.reshape(stated, _ROWS, 3)


def _pose(path: Path, camera: Array, label: str) -> Array:
    R = camera[1:4]
    if not np.isfinite(camera).all() or np.abs(R @ R.T - np.eye(3)).max() > 1e-3 or np.linalg.det(R) < 0:
        raise CaptureError(f"{path}: the rotation of {label} is none; export the cameras again")
    left, _, right = np.linalg.svd(R)
    return np.concatenate([OPENCV_FROM_OPENGL @ (left @ right), (OPENCV_FROM_OPENGL @ camera[4])[:, None]], axis=1)
