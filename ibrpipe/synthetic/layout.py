"""Writes cameras in the two forms of a capture folder: a COLMAP text model and nerfstudio's transforms.json."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

from ibrpipe.io.cameras.colmap_write import ModelImage, SparseModel, write_model
from ibrpipe.io.cameras.lenses import pinhole_lens
from ibrpipe.io.cameras.transforms import opengl_pose
from ibrpipe.types import Camera


def write_colmap_text(folder: Path, names: Sequence[str], cameras: Sequence[Camera]) -> None:
    """Write a COLMAP text model without points; every photo has the first camera's intrinsics."""
    images = [ModelImage(name, 0, camera.cam_from_world) for name, camera in zip(names, cameras)]
    write_model(SparseModel((pinhole_lens(cameras[0]),), tuple(images)), folder)


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
            {"file_path": f"images/{name}", "mask_path": f"masks/{name}", "transform_matrix": opengl_pose(camera)}
            for name, camera in zip(names, cameras)
        ],
    }
    path.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
