"""A rendered frame as one picture file."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ibrpipe.errors import FormatError, ShapeError
from ibrpipe.io.photos.images import write_exr, write_png
from ibrpipe.types import Array, Frame


def write_picture(frame: Frame, path: Path | str) -> None:
    """Write a frame as ``.png`` (8-bit sRGB, alpha where there is any) or ``.exr`` (linear light, A and Z too).

    Raises
    ------
    FormatError
        The name ends in something else.
    ShapeError
        The frame holds no colour.
    """
    target = Path(path)
    if frame.color is None:
        raise ShapeError(f"{target}: the frame holds no colour; render it with color among the outputs")
    if target.suffix.lower() == ".png":
        write_png(target, frame.color, frame.alpha)
    elif target.suffix.lower() == ".exr":
        color = frame.color if frame.alpha is None else frame.color * frame.alpha[..., None]
        channels: dict[str, Array] = dict(zip("RGB", np.moveaxis(color, 2, 0)))
        channels |= {"A": frame.alpha} if frame.alpha is not None else {}
        channels |= {"Z": frame.depth} if frame.depth is not None else {}
        write_exr(target, channels)
    else:
        raise FormatError(f"{target}: frames are saved as .png or .exr; give the file one of these endings")
