"""Pictures to an MP4 video: H.264 by PyAV where it is installed, else what OpenCV's wheels encode, VP9 or MPEG-4."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from fractions import Fraction
from pathlib import Path

import numpy as np

from ibrpipe.errors import ResourceError, ShapeError
from ibrpipe.types import Array

#: four-character codes of OpenCV, best first; browsers play the first, most players the second
_CODECS = {"vp09": "VP9", "mp4v": "MPEG-4"}
#: x264's measure of quality: no difference is seen side by side
_QUALITY = {"crf": "17", "preset": "medium"}
#: ITU-T H.273: primaries, curve and matrix of BT.709
_BT709 = 1


def write_video(path: Path, pictures: Sequence[Path], fps: float) -> str:
    """Write PNG files of one size as an MP4 video; transparent pixels become black.

    H.264 is written as phones and browsers play it: 4:2:0 in BT.709, index first; a column or row is repeated where
    the size is odd.

    Returns
    -------
    str
        Empty, or where phones may not play the video, what it is and what to type.

    Raises
    ------
    ResourceError
        OpenCV on this machine has no encoder, or a picture cannot be read back.
    ShapeError
        The pictures differ in size.
    """
    partial = path.with_name(f".{path.stem}.partial{path.suffix}")
    try:
        _write_h264(partial, pictures, fps)
        told = ""
    except ImportError:
        codec = _write_by_opencv(partial, pictures, fps, path)
        told = f"{path.name} is {codec}, which not every phone plays; for H.264 type: pip install 'ibrpipe[av]'"
    partial.replace(path)
    return told


def _write_h264(path: Path, files: Sequence[Path], fps: float) -> None:
    import av

    with av.open(str(path), "w", format="mp4", options={"movflags": "faststart"}) as container:
        stream = container.add_stream("libx264", rate=Fraction(fps).limit_denominator(1001), options=_QUALITY)
        stream.pix_fmt, coder = "yuv420p", stream.codec_context
        coder.colorspace = coder.color_primaries = coder.color_trc = _BT709
        height, width = _picture(files[0]).shape[:2]
        stream.height, stream.width = height + height % 2, width + width % 2
        for picture in _pictures(files):
            even = np.pad(picture, ((0, height % 2), (0, width % 2), (0, 0)), "edge")
            frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(even), format="bgr24")
            container.mux(stream.encode(frame.reformat(format="yuv420p", dst_colorspace="ITU709")))
        container.mux(stream.encode(None))


def _write_by_opencv(partial: Path, files: Sequence[Path], fps: float, path: Path) -> str:
    """Write with the first encoder that there is; return what it is called."""
    import cv2

    height, width = _picture(files[0]).shape[:2]
    for codec in _CODECS:
        fourcc = cv2.VideoWriter.fourcc(*codec)
        writer = cv2.VideoWriter(str(partial), cv2.CAP_FFMPEG, fourcc, fps, (width, height))
        if writer.isOpened():
            break
    else:
        raise ResourceError(
            f"{path}: OpenCV on this machine can encode neither VP9 nor MPEG-4; type: pip install 'ibrpipe[av]', or "
            "set render.video=false and join the PNG frames with another tool"
        )
    for picture in _pictures(files):
        writer.write(picture)
    writer.release()
    return _CODECS[codec]


def _pictures(files: Sequence[Path]) -> Iterator[Array]:
    """Yield the pictures one by one, all of the first one's size."""
    first = None
    for file in files:
        picture = _picture(file)
        first = first or picture.shape
        if picture.shape != first:
            raise ShapeError(
                f"{file}: is {picture.shape[1]} x {picture.shape[0]} but the video is {first[1]} x {first[0]}"
            )
        yield picture


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
