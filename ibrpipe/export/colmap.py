"""The cameras of a run as a COLMAP text model."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from ibrpipe.errors import ConfigError, ResourceError
from ibrpipe.export.cameras import RunCameras, photo_lens, point_colors, point_pixels, read_run_cameras
from ibrpipe.export.registry import Exporter
from ibrpipe.io.cameras.colmap_write import ModelImage, SparseModel, write_model
from ibrpipe.types import Array

FILES = ("cameras.txt", "images.txt", "points3D.txt")
#: names of held-out photos, a line each
HELD_OUT = "test.txt"


def write(source: Path, target: Path) -> str:
    """Write the cameras of the run in folder `source` as the model in the folder `target`; return where photos are.

    Photos are called as below the folder that holds all of them; those that are held out stand in ``test.txt``, too.
    Points are placed in photos where their cameras see them.

    Raises
    ------
    MissingFileError, FormatError
        The run has no cameras, or they are damaged.
    ConfigError, ResourceError
        `target` holds something else, or cannot be written.
    """
    if target.exists() and not (target / FILES[0]).is_file() and (target.is_file() or any(target.iterdir())):
        raise ConfigError(f"{target} holds something that is no COLMAP text model; name another folder")
    run = read_run_cameras(source)
    root = Path(os.path.commonpath([view.image.absolute().parent for view in run.all]))
    names = [view.image.absolute().relative_to(root).as_posix() for view in run.all]
    draft = target.with_name(f".{target.name}.partial")
    try:
        write_model(_model(run, names), draft)
        held = names[len(run.views.train) :]
        (draft / HELD_OUT).write_text("".join(f"{name}\n" for name in held), encoding="utf-8")
        target.mkdir(parents=True, exist_ok=True)
        for file in sorted(draft.iterdir()):
            file.replace(target / file.name)
        draft.rmdir()
    except OSError as error:
        raise ResourceError(f"{target}: cannot write: {error.strerror or error}") from error
    points = 0 if run.points is None else len(run.points.xyz)
    return f"{len(names)} photos in {root}, {len(held)} of them held out, {points} points"


def _model(run: RunCameras, names: list[str]) -> SparseModel:
    lenses = [photo_lens(view) for view in run.all]
    distinct = list(dict.fromkeys(lenses))
    none = np.zeros((0, 2)), np.zeros(0, np.int64)
    seen = [none] * len(names) if run.points is None else _seen(run)
    images = tuple(
        ModelImage(name, distinct.index(lens), view.camera.cam_from_world, *pixels)
        for name, lens, view, pixels in zip(names, lenses, run.all, seen, strict=True)
    )
    if run.points is None:
        return SparseModel(tuple(distinct), images, np.zeros((0, 3)), np.zeros((0, 3), np.uint8), np.zeros(0))
    colors = point_colors(run.points, run.views.train)
    return SparseModel(tuple(distinct), images, run.points.xyz, colors, run.points.error)


def _seen(run: RunCameras) -> list[tuple[Array, Array]]:
    """Return pixels (N, 2) and numbers (N,) of the points that every photo sees; held-out ones see none."""
    assert run.points is not None
    point = np.repeat(np.arange(len(run.points.xyz)), np.diff(run.points.offsets))
    found = []
    for index, view in enumerate(run.all):
        own = point[run.points.views == index] if index < len(run.views.train) else point[:0]
        pixels = point_pixels(view, run.points.xyz[own])
        there = np.isfinite(pixels).all(axis=1)
        found.append((pixels[there], own[there]))
    return found


EXPORTER = Exporter(
    "colmap", "Cameras and points of a run as a COLMAP text model.", write, takes="run", folders=("colmap",)
)
