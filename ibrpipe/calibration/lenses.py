"""What is assumed of the lenses before the photos have spoken."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from ibrpipe.calibration.features import Features
from ibrpipe.calibration.job import PhotoEntry
from ibrpipe.errors import CaptureError
from ibrpipe.io.cameras.lenses import Lens

#: Focal length over the photo's longer side where nothing is known
GUESS = 1.2
#: Parameters behind focal lengths and principal point start at nought
_FOCALS = {
    "SIMPLE_PINHOLE": 1,
    "PINHOLE": 2,
    "SIMPLE_RADIAL": 1,
    "RADIAL": 1,
    "OPENCV": 2,
    "FULL_OPENCV": 2,
    "SIMPLE_RADIAL_FISHEYE": 1,
    "RADIAL_FISHEYE": 1,
    "OPENCV_FISHEYE": 2,
}
_BENDS = {
    "SIMPLE_PINHOLE": 0,
    "PINHOLE": 0,
    "SIMPLE_RADIAL": 1,
    "RADIAL": 2,
    "OPENCV": 4,
    "FULL_OPENCV": 8,
    "SIMPLE_RADIAL_FISHEYE": 1,
    "RADIAL_FISHEYE": 2,
    "OPENCV_FISHEYE": 4,
}


@dataclass(frozen=True)
class Start:
    """A lens to begin with.

    Attributes
    ----------
    lens : Lens
    source : {"given", "settings", "exif", "guess"}
    """

    lens: Lens
    source: str

    @property
    def trusted(self) -> bool:
        """Whether the focal length is more than a guess."""
        return self.source != "guess"


def choose_lenses(
    photos: Sequence[PhotoEntry], features: Sequence[Features], config: dict[str, Any]
) -> tuple[list[Start], list[int]]:
    """Choose the lenses and which photo has which.

    Parameters
    ----------
    photos, features : sequences, alike
    config : mapping
        Settings ``camera_model``, ``camera_params``, ``share``.

    Returns
    -------
    lenses : list of Start
    owner : list of int
        Lens of each photo.

    Raises
    ------
    CaptureError
        A lens has the wrong number of parameters.
    """
    starts: list[Start] = []
    number_of: dict[object, int] = {}
    owner = []
    for index, (photo, found) in enumerate(zip(photos, features)):
        start = _start(photo, found, config)
        number = number_of.setdefault(_group(index, start, found, config["share"]), len(starts))
        if number == len(starts):
            starts.append(start)
        owner.append(number)
    return starts, owner


def _group(index: int, start: Start, found: Features, share: str) -> object:
    """Photos with the same value share a lens."""
    if share == "photo":
        return index
    if share == "all":
        return found.width, found.height
    return start.lens if start.source == "given" else (found.width, found.height, found.exif.lens)


def _start(photo: PhotoEntry, found: Features, config: dict[str, Any]) -> Start:
    known = photo.known_lens()
    if known is not None:
        if (known.width, known.height) != (found.width, found.height):
            raise CaptureError(
                f"{photo.image}: is {found.width} x {found.height} pixels but its camera states {known.width} x "
                f"{known.height}; use the photos that were calibrated, or set calibrate.intrinsics: unknown"
            )
        return Start(known, "given")
    model, params = config["camera_model"], config["camera_params"]
    if params is not None:
        return Start(Lens(model, tuple(params), found.width, found.height), "settings")
    focal, source = found.exif.focal, "exif"
    longer = max(found.width, found.height)
    if focal is None or not 0.1 < focal / longer < 10.0:
        focal, source = GUESS * longer, "guess"
    center = found.width / 2.0, found.height / 2.0
    values = (*[focal] * _FOCALS[model], *center, *[0.0] * _BENDS[model])
    return Start(Lens(model, values, found.width, found.height), source)


def angle_of_view(lens: Lens) -> float:
    """Horizontal angle of view of a lens without its distortion, degrees."""
    return math.degrees(2.0 * math.atan(lens.width / (2.0 * lens.K[0, 0])))
