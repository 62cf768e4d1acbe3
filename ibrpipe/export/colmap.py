"""The cameras of a run as a COLMAP text model."""

from __future__ import annotations

import os
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from ibrpipe.errors import FormatError
from ibrpipe.export.cameras import RunCameras, photo_lens, point_colors, point_pixels, read_run_cameras
from ibrpipe.export.registry import Exporter
from ibrpipe.export.whole_file import check_folder, write_files
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
        The run has no cameras, they are damaged, or a photo's name holds a space.
    ConfigError, ResourceError
        `target` holds something else, or cannot be written.
    """
    check_folder(target, FILES[0], "COLMAP text model")
    run = read_run_cameras(source)
    root = Path(os.path.commonpath([view.image.absolute().parent for view in run.all]))
    names = [_plain(view.image.absolute().relative_to(root).as_posix()) for view in run.all]
    held = names[len(run.views.train) :]
    with TemporaryDirectory() as folder:
        write_model(_model(run, names), Path(folder))
        files = {name: (Path(folder) / name).read_bytes() for name in FILES}
    write_files(target, {**files, HELD_OUT: "".join(f"{name}\n" for name in held).encode("utf-8")})
    points = 0 if run.points is None else len(run.points.xyz)
    return f"{len(names)} photos in {root}, {len(held)} of them held out, {points} points"


def _plain(name: str) -> str:
    """Return the name of a photo, which COLMAP reads up to the first space."""
    if not name.isprintable() or " " in name:
        raise FormatError(
            f"photo {name!r}: COLMAP reads names up to the first space; rename the photo and run again, or export "
            "transforms.json"
        )
    return name


def _model(run: RunCameras, names: list[str]) -> SparseModel:
    lenses = [photo_lens(view) for view in run.all]
    distinct = list(dict.fromkeys(lenses))
    seen: list[tuple[Array, ...]] = [()] * len(names) if run.points is None else _seen(run)
    images = tuple(
        ModelImage(name, distinct.index(lens), view.camera.cam_from_world, *pixels)
        for name, lens, view, pixels in zip(names, lenses, run.all, seen, strict=True)
    )
    if run.points is None:
        return SparseModel(tuple(distinct), images)
    colors = point_colors(run.points, run.views.train)
    return SparseModel(tuple(distinct), images, run.points.xyz, colors, run.points.error)


def _seen(run: RunCameras) -> list[tuple[Array, ...]]:
    """Return pixels (N, 2) and numbers (N,) of the points that every photo sees; held-out ones see none."""
    assert run.points is not None
    point = np.repeat(np.arange(len(run.points.xyz)), np.diff(run.points.offsets))
    found: list[tuple[Array, ...]] = []
    for index, view in enumerate(run.all):
        own = point[run.points.views == index] if index < len(run.views.train) else point[:0]
        pixels = point_pixels(view, run.points.xyz[own])
        there = np.isfinite(pixels).all(axis=1)
        found.append((pixels[there], own[there]))
    return found


EXPORTER = Exporter(
    "colmap", "Cameras and points of a run as a COLMAP text model.", write, takes="run", folders=("colmap",)
)
