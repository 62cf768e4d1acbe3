"""Which pipeline suits a capture: decided by what its folder holds."""

from __future__ import annotations

from pathlib import Path

from ibrpipe.io.captures import CaptureOptions, has_cameras, read_capture
from ibrpipe.io.videos.read import is_video


def choose_pipeline(folder: Path, allow_outside: bool = False) -> tuple[str, str]:
    """Return the name of the pipeline for a capture folder or a video, and why in a few words.

    For a video, and without cameras, it is ``photos``, with cameras ``calibrated``, with cameras and a mesh ``mesh``.

    Parameters
    ----------
    folder : Path
    allow_outside : bool
        What the capture names may lie outside its folder.

    Raises
    ------
    IbrError
        There is no such folder, or what it states cannot be read.
    """
    if is_video(folder):
        return "photos", "a video"
    if folder.is_dir() and not has_cameras(folder):
        return "photos", "no cameras"
    capture = read_capture(folder, CaptureOptions(allow_outside=allow_outside))
    if capture.mesh is None:
        return "calibrated", "cameras, no mesh"
    return "mesh", f"cameras and {capture.mesh.name}"
