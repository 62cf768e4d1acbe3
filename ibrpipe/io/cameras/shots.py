"""A calibrated photo as a camera file states it, before the photo itself is looked at."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ibrpipe.errors import MissingFileError
from ibrpipe.io.cameras.lenses import Lens
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


def photo_by_label(images: Path, label: str, source: Path) -> Path:
    """Return the photo that another program calls `label`: by its path, its file name, or its name without suffix.

    Raises
    ------
    MissingFileError
        There is no such photo; the message names `source`.
    """
    name = Path(label.replace("\\", "/")).name
    for candidate in (images / label, images / name):
        if candidate.is_file() and candidate.is_relative_to(images):
            return candidate
    found = sorted(path for path in images.rglob("*") if path.stem == name and not path.name.endswith(".mask.png"))
    if not found:
        raise MissingFileError(f"{source}: names the photo {label}, which is not in {images}; put it there")
    return found[0]
