"""Writes cameras in the two forms of a capture folder: a COLMAP text model and nerfstudio's transforms.json."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from ibrpipe.types import Array, Camera

_CAMERAS = "# Camera list with one line of data per camera:\n#   CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n"
_IMAGES = (
    "# Image list with two lines of data per image:\n"
    "#   IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME\n"
    "#   POINTS2D[] as (X, Y, POINT3D_ID)\n"
)
_POINTS = (
    "# 3D point list with one line of data per point:\n"
    "#   POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[] as (IMAGE_ID, POINT2D_IDX)\n"
    "# Number of points: 0, mean track length: 0\n"
)


def _numbers(values: Array) -> str:
    return " ".join(repr(float(value)) for value in values)


def write_colmap_text(folder: Path, names: Sequence[str], cameras: Sequence[Camera]) -> None:
    """Write a COLMAP text model without points; every photo has the first camera's intrinsics."""
    folder.mkdir(parents=True)
    shared = cameras[0]
    focal = (shared.K[0, 0], shared.K[1, 1], shared.K[0, 2], shared.K[1, 2])
    line = f"1 PINHOLE {shared.width} {shared.height} {_numbers(np.array(focal))}\n"
    (folder / "cameras.txt").write_text(f"{_CAMERAS}# Number of cameras: 1\n{line}", encoding="utf-8")
    lines = [_IMAGES, f"# Number of images: {len(names)}, mean observations per image: 0\n"]
    for index, (name, camera) in enumerate(zip(names, cameras), start=1):
        quaternion = Rotation.from_matrix(camera.R).as_quat(canonical=True)[[3, 0, 1, 2]]
        lines.append(f"{index} {_numbers(quaternion)} {_numbers(camera.t)} 1 {name}\n\n")
    (folder / "images.txt").write_text("".join(lines), encoding="utf-8")
    (folder / "points3D.txt").write_text(_POINTS, encoding="utf-8")


def _transform(camera: Camera) -> list[list[float]]:
    """World-from-camera matrix (4, 4) in OpenGL axes (y up, z backwards)."""
    matrix = np.eye(4)
    matrix[:3, :3] = camera.R.T @ np.diag([1.0, -1.0, -1.0])
    matrix[:3, 3] = camera.center
    return [[float(value) for value in row] for row in matrix]


def write_transforms(path: Path, names: Sequence[str], cameras: Sequence[Camera], mesh: str | None) -> None:
    """Write nerfstudio's transforms.json for images/NAME and masks/NAME; `mesh` is a path beside it or None."""
    shared = cameras[0]
    content: dict[str, object] = {
        "camera_model": "OPENCV",
        "fl_x": float(shared.K[0, 0]),
        "fl_y": float(shared.K[1, 1]),
        "cx": float(shared.K[0, 2]),
        "cy": float(shared.K[1, 2]),
        "w": shared.width,
        "h": shared.height,
        **dict.fromkeys(("k1", "k2", "p1", "p2"), 0.0),
        **({"ply_file_path": mesh} if mesh else {}),
        "frames": [
            {"file_path": f"images/{name}", "mask_path": f"masks/{name}", "transform_matrix": _transform(camera)}
            for name, camera in zip(names, cameras)
        ],
    }
    path.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
