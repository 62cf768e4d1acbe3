"""Videos to photos, before the first stage: the frames that serve as photos become a capture folder of their own.

No stage of the pipeline, for most captures hold photos; but run like one, so that it is skipped when nothing changed.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from pydantic import Field

from ibrpipe.capture.video_frames import choose_frames, measure_frames
from ibrpipe.config import StageConfig
from ibrpipe.engine.runner import Job, Report, run_job
from ibrpipe.engine.stage import Stage, StageOutputs, artifact
from ibrpipe.errors import CaptureError, FormatError
from ibrpipe.io.cameras.shots import PHOTO_SUFFIXES, photo_root
from ibrpipe.io.cameras.sources import has_cameras
from ibrpipe.io.manifest import Hasher, files_below
from ibrpipe.io.untrusted.inside import leads_inside
from ibrpipe.io.videos.read import is_video, read_video_header, video_frames, write_frames_as_photos
from ibrpipe.progress import track


class StillsConfig(StageConfig):
    """Settings of the choice of frames."""

    frames: int = Field(120, ge=2, le=5000, description="Photos to take from all videos together, at most")


@dataclass(frozen=True)
class Inputs:
    """A video file or a capture folder that holds videos, and the folder to write to."""

    capture: Path
    out: Path


@dataclass(frozen=True)
class Outputs(StageOutputs):
    """What is written."""

    photos: Path = artifact("", "Folder that holds the capture folder, called as the video or the capture is.")


def videos_of(capture: Path) -> list[Path]:
    """Return the videos that photos are to be taken from: the file itself, or those among a folder's photos.

    A folder with cameras has none: what cameras were found for was taken from the video already. Neither counts a video
    beside a photo of the same name, as phones keep them ("live photos").
    """
    if not capture.is_dir():
        return [capture] if is_video(capture) else []
    if has_cameras(capture):
        return []
    files = list(files_below(photo_root(capture)))
    photos = {file.with_suffix("") for file in files if file.suffix.lower() in PHOTO_SUFFIXES}
    return [file for file in files if is_video(file) and file.with_suffix("") not in photos]


def with_photos(capture: Path, hasher: Hasher, report: Report, out: Path, frames: int) -> Path:
    """Return a capture folder of photos: `capture` itself, or where it holds videos, one made from it below `out`.

    Raises
    ------
    FormatError, CaptureError
        `capture` is a file but no video, a video cannot be read, or it shows nothing.
    """
    if capture.is_file() and not is_video(capture):
        raise FormatError(f"{capture}: is neither a capture folder nor a video; give one of them")
    if not videos_of(capture):
        return capture
    target = out / STAGE.folder
    run_job(Job(STAGE, {"capture": capture}, StillsConfig(frames=frames), target), hasher, report=report)
    return target / _name(capture)


def preparation(out: Path, frames: int) -> partial[Path]:
    """Return `with_photos` for a run folder, as `ibrpipe.engine.runner.Run` takes it."""
    return partial(with_photos, out=out, frames=frames)


def run(inputs: Inputs, config: StillsConfig) -> Outputs:
    """Write the capture folder: chosen frames of all videos, and whatever else the given one holds."""
    target = inputs.out / _name(inputs.capture)
    videos = videos_of(inputs.capture)
    if inputs.capture.is_dir():
        _take_over(inputs.capture, target, inputs.out.parent)
    root = photo_root(inputs.capture)
    told = []
    for number, video in enumerate(videos):
        place = target / "images" if root == video else target / video.parent.relative_to(inputs.capture)
        place.mkdir(parents=True, exist_ok=True)
        wanted = max(2, (config.frames * (number + 1)) // len(videos) - (config.frames * number) // len(videos))
        told.append(_take_frames(video, place, _stem(video, videos), wanted))
    (inputs.out / "summary.txt").write_text("\n".join(told) + "\n", encoding="utf-8")
    return Outputs.below(inputs.out)


def _take_frames(video: Path, folder: Path, name: str, wanted: int) -> str:
    """Write the chosen frames of one video; return what there is to tell."""
    header = read_video_header(video)
    figures = measure_frames(track(video_frames(video), f"frames of {video.name}", header.frames))
    chosen = choose_frames(figures, wanted)
    if not chosen.frames:
        expected = "expected frames that are bright and sharp"
        raise CaptureError(f"{video}: none of its {chosen.total} frames shows anything; {expected}: film it again")
    write_frames_as_photos(video, chosen.frames, folder, name)
    cut = chosen.total < 0.9 * header.frames
    damage = f"; it ends after {chosen.total} of {header.frames} frames, so it may be damaged" if cut else ""
    return f"{video.name}: {chosen.told(wanted)}{damage}"


def _take_over(capture: Path, target: Path, run_folder: Path) -> None:
    """Link (else copy) all files but videos; links that lead out of the capture stay links, for readers to judge."""
    for file in files_below(capture, [run_folder]):
        if is_video(file):
            continue
        place = target / file.relative_to(capture)
        place.parent.mkdir(parents=True, exist_ok=True)
        if not leads_inside(capture, file):
            place.symlink_to(file.resolve())
            continue
        try:
            os.link(file.resolve(), place)
        except OSError:  # another disk, or one that knows no links
            shutil.copy2(file, place)


def _name(capture: Path) -> str:
    return capture.resolve().stem if capture.is_file() else capture.resolve().name or "capture"


def _stem(video: Path, videos: Sequence[Path]) -> str:
    """Return a name for the frames of a video that no other video of its folder has."""
    alike = [each for each in videos if each.with_suffix("") == video.with_suffix("")]
    return video.stem if len(alike) == 1 else video.name.replace(".", "_")


STAGE = Stage(
    name="stills",
    summary="Take the sharpest frame of every step of the camera from videos.",
    inputs=Inputs,
    outputs=Outputs,
    config=StillsConfig,
    run=run,
    example="ibrpipe run clip.mp4 --out out",
)
