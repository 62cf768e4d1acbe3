"""Lenses of ``transforms.json``: keys of the file and of its frames as camera models."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ibrpipe.errors import CaptureError, FormatError
from ibrpipe.io.cameras.lenses import Lens
from ibrpipe.io.photos.image_files import read_header

_RADIAL = ("k1", "k2", "k3", "k4")
#: Keys that say one thing together: a frame that states one of them makes all those of the file void
_TOGETHER = (("fl_x", "fl_y", "camera_angle_x", "camera_angle_y"), ("cx", "cy"), (*_RADIAL, "p1", "p2"))


def frame_keys(frame: Mapping[str, Any], document: Mapping[str, Any]) -> dict[str, Any]:
    """Join what a frame states with what the file states for all frames; the frame's own comes first.

    Raises
    ------
    CaptureError
        The frame has a size of its own, but focal length and principal point are those of another size.
    """
    keys = {**document, **frame}
    for group in _TOGETHER:
        if any(name in frame for name in group):
            for name in group:
                if name not in frame:
                    keys.pop(name, None)
    size, others = _stated_size(frame), _stated_size(document)
    if size is not None and others is not None and size != others:
        pixels = [name for name in ("fl_x", "fl_y", "cx", "cy") if name in document and name in keys]
        stated = [name for name in pixels if name not in frame]
        if stated:
            raise CaptureError(
                f"states its own size {size[0]} x {size[1]} but not its own {', '.join(stated)}; those of the file are "
                f"for {others[0]} x {others[1]}: write them into the frame"
            )
    return keys


def _stated_size(keys: Mapping[str, Any]) -> tuple[int, int] | None:
    return (int(keys["w"]), int(keys["h"])) if "w" in keys and "h" in keys else None


def frame_lens(keys: Mapping[str, Any], image: Path) -> Lens:
    """Return the lens that keys describe; a size that is not stated is the photo's.

    Raises
    ------
    CaptureError, FormatError
        An unknown camera model, coefficients that it does not have, no focal length.
    """
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
