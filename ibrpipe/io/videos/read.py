"""Frames of video files, decoded by the FFmpeg that comes inside OpenCV's wheels."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ibrpipe.errors import FormatError, MissingFileError
from ibrpipe.io.untrusted.boundary import reader, told
from ibrpipe.types import Array

VIDEO_SUFFIXES = (".mp4", ".mov", ".m4v", ".avi", ".mkv", ".webm", ".mts", ".m2ts", ".3gp", ".mpg", ".mpeg", ".wmv")
_REMEDY = "copy it again, or convert it: ffmpeg -i VIDEO new.mp4"
#: FFmpeg's own words on damage would stand beside the one line that is told
_QUIET = {"OPENCV_FFMPEG_LOGLEVEL": "-8"}


@dataclass(frozen=True)
class VideoHeader:
    """What a video file says of itself.

    Attributes
    ----------
    width, height : int
        Pixels, as the frames come out: turned upright where the file says so.
    frames : int
        As stated; fewer may come out of a damaged file.
    rate : float
        Frames per second; 0 = not stated.
    """

    width: int
    height: int
    frames: int
    rate: float

    @property
    def seconds(self) -> float | None:
        """Length; None where the rate is not stated."""
        return self.frames / self.rate if self.rate > 0 else None


def is_video(path: Path) -> bool:
    """Say whether a file is called as videos are."""
    return path.suffix.lower() in VIDEO_SUFFIXES


@reader(_REMEDY)
def read_video_header(path: Path) -> VideoHeader:
    """Read size, length and rate of a video.

    Raises
    ------
    MissingFileError, FormatError
        The file does not exist, or is no video that can be read.
    """
    with _opened(path) as source:
        return _header(source)


def video_frames(path: Path) -> Iterator[Array]:
    """Yield the frames of a video, (H, W, 3) uint8, channels B, G, R, until the end or damage.

    Raises
    ------
    MissingFileError, FormatError
        As `read_video_header`.
    """
    with told(path, _REMEDY), _opened(path) as source:
        while True:
            there, frame = source.read()
            if not there:
                return
            yield frame


@contextmanager
def _opened(path: Path) -> Iterator[Any]:
    if not path.is_file():
        raise MissingFileError(f"{path}: the video does not exist")
    for name, value in _QUIET.items():
        os.environ.setdefault(name, value)
    import cv2

    level = cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    try:
        source = cv2.VideoCapture(str(path), cv2.CAP_FFMPEG)
    finally:
        cv2.utils.logging.setLogLevel(level)
    try:
        if not source.isOpened() or not source.get(cv2.CAP_PROP_FRAME_WIDTH) > 0:
            why = "is empty" if path.stat().st_size == 0 else "cannot be read as a video"
            raise FormatError(f"{path}: {why}; {_REMEDY}")
        yield source
    finally:
        source.release()


def _header(source: Any) -> VideoHeader:
    import cv2

    width, height = (int(source.get(each)) for each in (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT))
    frames, rate = source.get(cv2.CAP_PROP_FRAME_COUNT), source.get(cv2.CAP_PROP_FPS)
    return VideoHeader(width, height, max(int(frames), 0), max(float(rate), 0.0))


def write_frames_as_photos(path: Path, chosen: Iterable[int], folder: Path, name: str) -> None:
    """Write frames of a video into a folder as ``NAME_000012.jpg``, numbered as in the video from 0.

    JPEG of quality 95 with colours in full resolution: what is lost is well below what the video has lost already.
    """
    import cv2

    wanted = set(chosen)
    settings = [cv2.IMWRITE_JPEG_QUALITY, 95, cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444]
    for number, frame in enumerate(video_frames(path)):
        if number in wanted:
            _, content = cv2.imencode(".jpg", frame, settings)
            (folder / f"{name}_{number:06d}.jpg").write_bytes(content.tobytes())
