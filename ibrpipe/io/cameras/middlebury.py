"""Rectified pairs as the Middlebury stereo sets have them: ``calib.txt``, ``im0.png``, ``im1.png`` and true disparity.

Disparity d of a pixel of the left picture: it is at (x - d, y) in the right one; depth is
``focal * baseline / (d + doffs)``, in the baseline's unit (mm). In ``calib.txt`` pixel centres are at whole numbers.
Format: scharstein2014.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ibrpipe.errors import FormatError, MissingFileError
from ibrpipe.io.cameras.lenses import Lens
from ibrpipe.io.cameras.shots import Shot
from ibrpipe.io.untrusted.arrays import load_npz
from ibrpipe.io.untrusted.boundary import reader, utf8_text
from ibrpipe.types import Array

CALIBRATION = "calib.txt"
PHOTOS = ("im0.png", "im1.png")
#: names of the left picture's true disparity, best first
DISPARITIES = ("disp0.pfm", "disp0GT.pfm", "disp_left.npz")
_CAMERA = re.compile(r"\[([^;]*);([^;]*);[^\]]*\]")


@dataclass(frozen=True)
class StereoCalibration:
    """A rectified pair.

    Attributes
    ----------
    focal : float
        Pixels.
    left, right : tuple of float
        Principal points, pixels, pixel (0, 0)'s centre at (0, 0).
    offset : float
        ``doffs``: the right principal point's x minus the left one's.
    baseline : float
    width, height : int
    """

    focal: float
    left: tuple[float, float]
    right: tuple[float, float]
    offset: float
    baseline: float
    width: int
    height: int

    def disparity(self, depth: Array) -> Array:
        """Disparity of depths along z, NaN where the depth is not above 0."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.where(depth > 0, self.focal * self.baseline / depth - self.offset, np.nan)


def is_stereo(root: Path) -> bool:
    """Whether a folder holds the calibration and photos of a pair."""
    return all((root / name).is_file() for name in (CALIBRATION, *PHOTOS))


@reader("copy the set again")
def read_calibration(path: Path) -> StereoCalibration:
    """Read ``calib.txt``.

    Raises
    ------
    MissingFileError, FormatError
        It does not exist, lacks an entry, or holds something else than numbers.
    """
    if not path.is_file():
        raise MissingFileError(f"{path}: does not exist; a Middlebury stereo folder holds it")
    entries = dict(line.split("=", 1) for line in utf8_text(path, "copy the set again").splitlines() if "=" in line)
    try:
        first, second = (_camera(entries[name]) for name in ("cam0", "cam1"))
        numbers = [float(entries[name]) for name in ("baseline", "width", "height")]
        offset = float(entries.get("doffs", second[1] - first[1]))
        size = int(numbers[1]), int(numbers[2])
    except (KeyError, ValueError, OverflowError) as error:
        raise FormatError(
            f"{path}: {error} is missing or no number; expected the lines cam0, cam1, baseline, width and height of a "
            "Middlebury 2014 set"
        ) from error
    return StereoCalibration(first[0], (first[1], first[2]), (second[1], second[2]), offset, numbers[0], *size)


def read_stereo(root: Path) -> tuple[Shot, ...]:
    """Read a pair as two photos, the left one at the origin; raises as `read_calibration`."""
    calibration = read_calibration(root / CALIBRATION)
    shots = []
    for n, (name, (cx, cy)) in enumerate(zip(PHOTOS, (calibration.left, calibration.right), strict=True)):
        params = (calibration.focal, calibration.focal, cx + 0.5, cy + 0.5)
        lens = Lens("PINHOLE", params, calibration.width, calibration.height)
        pose = np.column_stack([np.eye(3), [-n * calibration.baseline, 0, 0]])
        shots.append(Shot(name, root / name, lens, pose))
    return tuple(shots)


def read_disparity(root: Path) -> Array:
    """Read the true disparity of the left picture, (H, W) float32, NaN = unknown.

    Raises
    ------
    MissingFileError, FormatError
    """
    for name in DISPARITIES:
        path = root / name
        if path.is_file():
            found = read_pfm(path) if path.suffix == ".pfm" else _numpy(path)
            return np.where(np.isfinite(found), found, np.float32(np.nan)).astype(np.float32)
    raise MissingFileError(f"{root}: holds no true disparity; expected one of {', '.join(DISPARITIES)}")


@reader("copy the set again")
def read_pfm(path: Path) -> Array:
    """Read a grey portable float map, (H, W) float32, the upper row first.

    Raises
    ------
    FormatError
        Another format, or cut off.
    """
    content = path.read_bytes()
    head = re.match(rb"Pf\s+(\d+)\s+(\d+)\s+(-?[\d.eE+-]+)\s", content)
    if head is None:
        raise FormatError(f"{path}: is no grey portable float map; it begins with Pf, width, height and scale")
    width, height, little = int(head[1]), int(head[2]), float(head[3]) < 0
    if len(content) - head.end() < 4 * width * height or not width * height:
        raise FormatError(f"{path}: is cut off; {width} x {height} numbers are promised")
    pixels = np.frombuffer(content, "<f4" if little else ">f4", width * height, head.end())
    return np.ascontiguousarray(pixels.reshape(height, width)[::-1], dtype=np.float32)


def _numpy(path: Path) -> Array:
    held = load_npz(path)
    if not held:
        raise FormatError(f"{path}: holds no array; disparity is (H, W)")
    found = held["disp"] if "disp" in held else next(iter(held.values()))
    if found.ndim != 2:
        raise FormatError(f"{path}: holds an array of shape {found.shape}; disparity is (H, W)")
    return np.asarray(found, np.float32)


def _camera(text: str) -> tuple[float, float, float]:
    """Focal length and principal point of ``[f 0 cx; 0 f cy; 0 0 1]``."""
    rows = _CAMERA.search(text)
    if rows is None:
        raise ValueError(text)
    (focal, _, cx), (_, _, cy) = (tuple(float(number) for number in row.split()) for row in rows.groups())
    return focal, cx, cy
