"""Held-out views: what the photos show, and the frames that the render stage made for them."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ibrpipe.errors import CaptureError, FormatError, MissingFileError
from ibrpipe.io.image_files import read_header
from ibrpipe.io.images import read_depth, read_image
from ibrpipe.io.views import View, ViewSet, load_depth, load_view
from ibrpipe.stages.scores import MASK_THRESHOLD, Truth, to_srgb8
from ibrpipe.types import Array, Camera, Frame


@dataclass(frozen=True, eq=False)
class Frames:
    """What ``frames.json`` of the render stage lists.

    Attributes
    ----------
    folder : Path
    renderers : tuple of str
        In the order of the file; the first one is what the verdict speaks of.
    entries : dict
        (renderer, view) to the file's entry.
    """

    folder: Path
    renderers: tuple[str, ...]
    entries: dict[tuple[str, str], dict[str, Any]]

    def load(self, renderer: str, view: View) -> Frame | None:
        """Return the frame that was rendered for exactly this view; None where there is none."""
        entry = self.entries.get((renderer, view.name))
        if entry is None or not _same_camera(entry, view.camera):
            return None
        path = self.folder / entry["file"]
        pixels = read_image(path)
        if pixels.shape[2] < 3:
            raise FormatError(f"{path}: holds no colour; let the render stage output color, depth and alpha")
        alpha = np.ascontiguousarray(pixels[:, :, 3]) if pixels.shape[2] > 3 else None
        return Frame(np.ascontiguousarray(pixels[:, :, :3]), _depth(path), alpha, entry.get("stats", {}))


def read_frames(folder: Path) -> Frames:
    """Read ``frames.json``.

    Raises
    ------
    MissingFileError, FormatError
        It does not exist or is not what the render stage writes.
    """
    path = folder / "frames.json"
    if not path.is_file():
        raise MissingFileError(f"{path}: does not exist; run the render stage first")
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
        entries = {(entry["renderer"], entry["view"]): entry for entry in document["frames"]}
        return Frames(folder, tuple(document["renderers"]), entries)
    except (ValueError, KeyError, TypeError) as error:
        raise FormatError(f"{path}: is no list of frames ({error!r}); run the render stage again") from error


def held_out_views(views: ViewSet) -> tuple[View, ...]:
    """Return the views to measure on.

    Raises
    ------
    CaptureError
        None is held out.
    """
    if not views.test:
        raise CaptureError(
            "the capture has no held-out views to measure on; add a test/ folder, or let ingest hold photos out"
        )
    return views.test


def load_truth(view: View) -> Truth:
    """Load what a held-out view shows: 8-bit sRGB, mask, and true depth where the capture has it."""
    color, mask = load_view(view)
    return Truth(to_srgb8(color), mask >= MASK_THRESHOLD, None if view.depth is None else load_depth(view))


def _same_camera(entry: dict[str, Any], camera: Camera) -> bool:
    size = entry.get("width"), entry.get("height")
    if size != (camera.width, camera.height):
        return False
    return np.allclose(entry["K"], camera.K) and np.allclose(entry["cam_from_world"], camera.cam_from_world)


def _depth(path: Path) -> Array | None:
    """Return the Z channel; None where the file has none."""
    return read_depth(path) if "Z" in read_header(path).channels else None
