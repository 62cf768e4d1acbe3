"""nerfstudio (and Blender/instant-ngp style) ``transforms.json`` as lenses and poses."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ibrpipe.errors import CaptureError, FormatError
from ibrpipe.io.cameras.lenses import Lens
from ibrpipe.io.cameras.shots import Shot
from ibrpipe.io.photos.image_files import read_header
from ibrpipe.types import Array

#: OpenCV camera axes (x right, y down, z forward) from OpenGL's (x right, y up, z backward)
OPENCV_FROM_OPENGL = np.diag([1.0, -1.0, -1.0])
_IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg", ".exr", ".tif", ".tiff")
_RADIAL = ("k1", "k2", "k3", "k4")


def read_transforms(path: Path) -> tuple[tuple[Shot, ...], Path | None]:
    """Read a ``transforms.json``.

    Parameters
    ----------
    path : Path

    Returns
    -------
    shots : tuple of Shot
        Sorted by name.
    mesh : Path or None
        What ``ply_file_path`` names (nerfstudio writes point clouds there too: it may hold no faces).

    Raises
    ------
    FormatError, CaptureError
        Not JSON, keys missing, an unknown camera model, a pose that is no rigid motion.

    Notes
    -----
    ``transform_matrix`` is world-from-camera with OpenGL camera axes; the world's own axes are kept as they are.
    """
    document = _document(path)
    frames = document.get("frames")
    if not isinstance(frames, list) or not frames:
        raise FormatError(
            f"{path}: has no list 'frames'; expected a nerfstudio transforms.json with one entry per photo"
        )
    shots = [_shot(frame, document, path, index) for index, frame in enumerate(frames)]
    ply = document.get("ply_file_path")
    mesh = path.parent / ply if isinstance(ply, str) and ply else None
    return tuple(sorted(shots, key=lambda shot: shot.file)), mesh


def pose_from_opengl(world_from_camera: Array) -> Array:
    """Turn a (4, 4) or (3, 4) OpenGL camera-to-world matrix into (3, 4) OpenCV ``cam_from_world``.

    Raises
    ------
    CaptureError
        NaN, or a rotation part off by more than 1e-3 (scaled, sheared, mirrored or singular).
    """
    matrix = np.asarray(world_from_camera, np.float64)
    if matrix.shape not in ((4, 4), (3, 4)):
        raise CaptureError(f"transform_matrix must be 4 x 4, got shape {matrix.shape}")
    if not np.isfinite(matrix).all():
        raise CaptureError("transform_matrix holds NaN or infinity; calibrate this photo again or remove it")
    rotation = matrix[:3, :3]
    off = np.abs(rotation.T @ rotation - np.eye(3)).max()
    if off > 1e-3 or np.linalg.det(rotation) < 0:
        raise CaptureError(
            f"transform_matrix is no rigid motion (determinant {np.linalg.det(rotation):.4g}, expected 1); "
            "remove scale and mirroring from it"
        )
    left, _, right = np.linalg.svd(rotation)
    rotation = OPENCV_FROM_OPENGL @ (left @ right).T
    return np.concatenate([rotation, -(rotation @ matrix[:3, 3])[:, None]], axis=1)


def _document(path: Path) -> Mapping[str, Any]:
    try:
        document = json.loads(path.read_text(encoding="utf-8-sig"))
    except (json.JSONDecodeError, UnicodeDecodeError) as error:
        raise FormatError(f"{path}: is not JSON ({error}); write it again") from error
    if not isinstance(document, dict):
        raise FormatError(f"{path}: expected a JSON object with 'frames', got {type(document).__name__}")
    return document


def _shot(frame: Any, document: Mapping[str, Any], path: Path, index: int) -> Shot:
    if not isinstance(frame, dict) or not isinstance(frame.get("file_path"), str):
        raise FormatError(f"{path}: frame {index} has no 'file_path'; every frame names its photo")
    where = f"{path}: frame {index} ({frame['file_path']})"
    if "transform_matrix" not in frame:
        raise FormatError(f"{where}: has no 'transform_matrix'; every frame states its pose")
    image = _image_path(path.parent, frame["file_path"])
    try:
        pose = pose_from_opengl(np.array(frame["transform_matrix"], np.float64))
        lens = _lens({**document, **frame}, image)
    except CaptureError as error:
        raise CaptureError(f"{where}: {error}") from error
    except (ValueError, TypeError) as error:
        raise FormatError(f"{where}: {error}") from error
    mask = frame.get("mask_path")
    file = Path(frame["file_path"]).with_suffix(image.suffix).as_posix().removeprefix("./").removeprefix("images/")
    return Shot(file, image, lens, pose, path.parent / mask if isinstance(mask, str) and mask else None)


def _image_path(root: Path, name: str) -> Path:
    """The photo's path; Blender-style names leave out the suffix."""
    image = root / name
    if image.suffix.lower() not in _IMAGE_SUFFIXES and not image.is_file():
        for suffix in _IMAGE_SUFFIXES:
            candidate = image.with_name(image.name + suffix)
            if candidate.is_file():
                return candidate
        return image.with_name(image.name + ".png")
    return image


def _lens(keys: Mapping[str, Any], image: Path) -> Lens:
    width, height = _size(keys, image)
    focal_x, focal_y = _focal(keys, width, height)
    cx, cy = float(keys.get("cx", width / 2.0)), float(keys.get("cy", height / 2.0))
    k1, k2, k3, k4 = (float(keys.get(name, 0.0)) for name in _RADIAL)
    p1, p2 = float(keys.get("p1", 0.0)), float(keys.get("p2", 0.0))
    model = str(keys.get("camera_model", "OPENCV_FISHEYE" if keys.get("is_fisheye") else "OPENCV"))
    params: tuple[float, ...]
    if model in ("OPENCV_FISHEYE", "RADIAL_FISHEYE", "SIMPLE_RADIAL_FISHEYE", "SIMPLE_FISHEYE", "FISHEYE"):
        if p1 or p2:
            raise CaptureError(f"camera model {model} with p1 or p2 is not known; expected k1 to k4 only")
        model, params = "OPENCV_FISHEYE", (focal_x, focal_y, cx, cy, k1, k2, k3, k4)
    elif model in ("OPENCV", "FULL_OPENCV", "PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL", "PERSPECTIVE"):
        if k4:
            raise CaptureError(f"camera model {model} with k4 = {k4:g} is not known; expected k1, k2, k3, p1, p2")
        model, params = perspective_lens(focal_x, focal_y, cx, cy, (k1, k2, p1, p2, k3))
    else:
        raise CaptureError(
            f"camera model {model!r} is not known; expected OPENCV, OPENCV_FISHEYE, PINHOLE or SIMPLE_RADIAL"
        )
    return Lens(model, params, width, height)


def perspective_lens(
    fx: float, fy: float, cx: float, cy: float, bend: tuple[float, ...]
) -> tuple[str, tuple[float, ...]]:
    """COLMAP's plainest model for Brown's k1, k2, p1, p2, k3."""
    if not any(bend):
        return "PINHOLE", (fx, fy, cx, cy)
    if not bend[4]:
        return "OPENCV", (fx, fy, cx, cy, *bend[:4])
    return "FULL_OPENCV", (fx, fy, cx, cy, *bend, 0.0, 0.0, 0.0)


def _size(keys: Mapping[str, Any], image: Path) -> tuple[int, int]:
    if "w" in keys and "h" in keys:
        return int(keys["w"]), int(keys["h"])
    header = read_header(image)
    return header.width, header.height


def _focal(keys: Mapping[str, Any], width: int, height: int) -> tuple[float, float]:
    if "fl_x" in keys:
        return float(keys["fl_x"]), float(keys.get("fl_y", keys["fl_x"]))
    if "camera_angle_x" in keys:
        focal = width / (2.0 * math.tan(float(keys["camera_angle_x"]) / 2.0))
        if "camera_angle_y" in keys:
            return focal, height / (2.0 * math.tan(float(keys["camera_angle_y"]) / 2.0))
        return focal, focal
    raise FormatError("has neither 'fl_x' nor 'camera_angle_x'; expected a focal length")
