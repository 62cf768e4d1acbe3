"""A calibrated photo as a camera file states it, before the photo itself is looked at."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ibrpipe.io.lenses import Lens
from ibrpipe.types import Array


@dataclass(frozen=True, eq=False)
class Shot:
    """One calibrated photo before its file is looked at.

    Attributes
    ----------
    file : str
        Name in the model, posix, relative to `image`'s folder of images.
    image : Path
    lens : Lens
    cam_from_world : (3, 4) float64
    mask : Path or None
        Mask that the model itself names.
    """

    file: str
    image: Path
    lens: Lens
    cam_from_world: Array
    mask: Path | None = None
