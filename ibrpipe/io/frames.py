"""Rendered frames on disk: pictures and their entries in ``frames.json``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ibrpipe.errors import FormatError
from ibrpipe.io.documents import frames as documents
from ibrpipe.io.documents.frames import RenderedFrame
from ibrpipe.io.photos.image_files import read_header
from ibrpipe.io.photos.images import read_depth, read_image, write_exr, write_png
from ibrpipe.io.views import View
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
    samples : int or "adaptive"
        Rays of a pixel.
    """

    folder: Path
    renderers: tuple[str, ...]
    entries: dict[tuple[str, str], RenderedFrame]
    samples: int | str = 1

    def load(self, renderer: str, view: View) -> Frame | None:
        """Return the frame that was rendered for exactly this view; None where there is none."""
        entry = self.entries.get((renderer, view.name))
        if entry is None or not _same_camera(entry, view.camera):
            return None
        path = self.folder / entry.file
        pixels = read_image(path)
        if pixels.shape[2] < 3:
            raise FormatError(f"{path}: holds no colour; let the render stage output color, depth and alpha")
        alpha = np.ascontiguousarray(pixels[:, :, 3]) if pixels.shape[2] > 3 else None
        return Frame(np.ascontiguousarray(pixels[:, :, :3]), _depth(path), alpha, entry.stats)


def read_frames(folder: Path) -> Frames:
    """Read ``frames.json``.

    Raises
    ------
    MissingFileError, FormatError
        It does not exist or is not what the render stage writes.
    """
    path = folder / "frames.json"
    document = documents.Frames.read(path, "is no list of frames", "render")
    entries = {(entry.renderer, entry.view): entry for entry in document.frames}
    return Frames(folder, tuple(document.renderers), entries, document.samples)


def _same_camera(entry: RenderedFrame, camera: Camera) -> bool:
    if (entry.width, entry.height) != (camera.width, camera.height):
        return False
    return np.allclose(entry.K, camera.K) and np.allclose(entry.cam_from_world, camera.cam_from_world)


def _depth(path: Path) -> Array | None:
    """Return the Z channel; None where the file has none."""
    return read_depth(path) if "Z" in read_header(path).channels else None


def frame_entry(
    name: str, renderer: str, camera: Camera, frame: Frame, files: Mapping[str, str], milliseconds: float
) -> RenderedFrame:
    """Return a frame's entry of ``frames.json``."""
    return RenderedFrame(
        view=name,
        renderer=renderer,
        **files,
        ms=round(milliseconds, 4),
        width=camera.width,
        height=camera.height,
        K=camera.K.tolist(),
        cam_from_world=camera.cam_from_world.tolist(),
        stats=dict(frame.stats),
    )


def write_frames(path: Path, document: documents.Frames) -> None:
    """Write ``frames.json``."""
    path.write_text(document.to_json() + "\n", encoding="utf-8")


def write_frame(frame: Frame, stem: Path) -> dict[str, str]:
    """Write STEM.exr and, where there is colour, STEM.png; each appears only when it is complete."""
    folder, parent = stem.parent, stem.parent.name
    exr, png = f"{stem.name}.exr", f"{stem.name}.png"
    write_exr(folder / f".{exr}", frame.channels)
    (folder / f".{exr}").replace(folder / exr)
    if frame.color is None:
        return {"file": f"{parent}/{exr}"}
    write_png(folder / f".{png}", frame.color, frame.alpha)
    (folder / f".{png}").replace(folder / png)
    return {"file": f"{parent}/{exr}", "png": f"{parent}/{png}"}
