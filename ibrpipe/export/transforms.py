"""The cameras of a run as nerfstudio's ``transforms.json``."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import numpy as np

from ibrpipe.errors import FormatError
from ibrpipe.export.cameras import photo_lens, point_colors, read_run_cameras
from ibrpipe.export.ply import ply_bytes
from ibrpipe.export.registry import Exporter
from ibrpipe.export.whole_file import check_file, write_files
from ibrpipe.io.cameras.lenses import Lens
from ibrpipe.io.cameras.transforms import opengl_pose
from ibrpipe.io.views import View
from ibrpipe.types import Array

#: nerfstudio's names of COLMAP's parameters, by COLMAP's model; "f" is both focal lengths
_KEYS = {
    "SIMPLE_PINHOLE": ("f", "cx", "cy"),
    "PINHOLE": ("fl_x", "fl_y", "cx", "cy"),
    "SIMPLE_RADIAL": ("f", "cx", "cy", "k1"),
    "RADIAL": ("f", "cx", "cy", "k1", "k2"),
    "OPENCV": ("fl_x", "fl_y", "cx", "cy", "k1", "k2", "p1", "p2"),
    "FULL_OPENCV": ("fl_x", "fl_y", "cx", "cy", "k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"),
    "SIMPLE_RADIAL_FISHEYE": ("f", "cx", "cy", "k1"),
    "RADIAL_FISHEYE": ("f", "cx", "cy", "k1", "k2"),
    "OPENCV_FISHEYE": ("fl_x", "fl_y", "cx", "cy", "k1", "k2", "k3", "k4"),
}


def write(source: Path, target: Path) -> str:
    """Write the cameras of the run in folder `source` as `target`, sparse points beside it; return what was written.

    Photos are named relative to the file; the world's axes stay as they are.

    Raises
    ------
    MissingFileError, FormatError
        The run has no cameras, they are damaged, or a camera model has no name in this format.
    ConfigError, ResourceError
        The files cannot be written.
    """
    check_file(target)
    run = read_run_cameras(source)
    frames = [_frame(view, target.parent) for view in run.all]
    train = len(run.views.train)
    document: dict[str, Any] = {"frames": frames}
    if run.views.test:
        paths = [frame["file_path"] for frame in frames]
        document |= {"train_filenames": paths[:train], "test_filenames": paths[train:]}
    files = {}
    if run.points is not None:
        name = f"{target.stem}_points.ply"
        document["ply_file_path"] = name
        files[name] = _points(run.points.xyz, point_colors(run.points, run.views.train))
    files[target.name] = (json.dumps(document, indent=1) + "\n").encode("utf-8")
    write_files(target.parent, files)
    points = "" if run.points is None else f", {len(run.points.xyz)} points in {next(iter(files))}"
    return f"{len(frames)} photos, {len(frames) - train} of them held out{points}"


def _frame(view: View, folder: Path) -> dict[str, Any]:
    frame = {"file_path": _relative(view.image, folder), **_lens_keys(photo_lens(view), view.name)}
    if view.mask is not None:
        frame["mask_path"] = _relative(view.mask, folder)
    return {**frame, "transform_matrix": opengl_pose(view.camera)}


def _lens_keys(lens: Lens, name: str) -> dict[str, Any]:
    """Return what a frame says of its camera."""
    keys = _KEYS.get(lens.model)
    if keys is None:
        raise FormatError(f"photo {name}: transforms.json has no camera model {lens.model}; export it as colmap")
    values = dict(zip(keys, lens.params, strict=True))
    if any(values.pop(key, 0.0) for key in ("k4", "k5", "k6") if lens.model == "FULL_OPENCV"):
        raise FormatError(f"photo {name}: transforms.json has no rational distortion; export it as colmap")
    focal = values.pop("f", None)
    if focal is not None:
        values = {"fl_x": focal, "fl_y": focal, **values}
    model = "OPENCV_FISHEYE" if "FISHEYE" in lens.model else "PINHOLE" if "k1" not in values else "OPENCV"
    return {"camera_model": model, "w": lens.width, "h": lens.height, **values}


def _relative(path: Path, folder: Path) -> str:
    try:
        return Path(os.path.relpath(path.absolute(), folder.absolute())).as_posix()
    except ValueError:  # another drive of Windows
        return path.absolute().as_posix()


def _points(xyz: Array, colors: Array) -> bytes:
    table = np.empty(len(xyz), [(axis, "<f8") for axis in "xyz"] + [(name, "u1") for name in ("red", "green", "blue")])
    for index, axis in enumerate("xyz"):
        table[axis] = xyz[:, index]
    for index, name in enumerate(("red", "green", "blue")):
        table[name] = colors[:, index]
    return ply_bytes(table, None)


EXPORTER = Exporter("transforms", "Cameras of a run as nerfstudio's transforms.json.", write, (".json",), takes="run")
