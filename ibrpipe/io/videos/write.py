"""Pictures to an MP4 video by the encoders that come with OpenCV's wheels: VP9, else MPEG-4."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ibrpipe.errors import ResourceError, ShapeError
from ibrpipe.types import Array

#: four-character codes, best first; browsers play the first, every player the second
_CODECS = ("vp09", "mp4v")


def write_video(path: Path, pictures: Sequence[Path], fps: float) -> None:
    """Write PNG files of one size as an MP4 video; transparent pixels become black.

    Raises
    ------
    ResourceError
        OpenCV on this machine has no encoder, or a picture cannot be read back.
    ShapeError
        The pictures differ in size.
    """
    import cv2

    first = _picture(pictures[0])
    height, width = first.shape[:2]
    partial = path.with_name(f".{path.stem}.partial{path.suffix}")
    for codec in _CODECS:
        fourcc = cv2.VideoWriter.fourcc(*codec)
        writer = cv2.VideoWriter(str(partial), cv2.CAP_FFMPEG, fourcc, fps, (width, height))
        if writer.isOpened():
            break
    else:
        raise ResourceError(
            f"{path}: OpenCV on this machine can encode neither VP9 nor MPEG-4; set render.video=false "
            "and join the PNG frames with another tool"
        )
    for file in pictures:
        picture = _picture(file)
        if picture.shape != first.shape:
            raise ShapeError(f"{file}: is {picture.shape[1]} x {picture.shape[0]} but the video is {width} x {height}")
        writer.write(picture)
    writer.release()
    partial.replace(path)


def _picture(file: Path) -> Array:
    """Read a PNG as (H, W, 3) uint8 in OpenCV's channel order, black where it is transparent."""
    import cv2

    picture = cv2.imdecode(np.fromfile(file, np.uint8), cv2.IMREAD_UNCHANGED)
    if picture is None:
        raise ResourceError(f"{file}: the frame cannot be read back; is the disk full?")
    if picture.ndim == 2:
        picture = np.repeat(picture[:, :, None], 3, axis=2)
    if picture.shape[2] == 4:
        alpha = picture[:, :, 3:].astype(np.uint16)
        return ((picture[:, :, :3] * alpha + 127) // 255).astype(np.uint8)
    return np.ascontiguousarray(picture)
