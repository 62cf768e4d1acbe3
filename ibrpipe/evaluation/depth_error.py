"""How far depth maps are from the depth of a true surface."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ibrpipe.embree import MeshCaster
from ibrpipe.errors import CaptureError, IbrError
from ibrpipe.io.cameras.middlebury import StereoCalibration
from ibrpipe.io.dense import DepthMap, Workspace, read_map
from ibrpipe.io.views import View
from ibrpipe.progress import track
from ibrpipe.types import Array


@dataclass(frozen=True)
class DepthError:
    """Error over all pixels of all maps that have depth where the truth has, too.

    Attributes
    ----------
    maps : int
    known : float
        Share of the true surface's pixels that have depth.
    rmse, median : float
        Scene units, along the camera's axis.
    bad : tuple of float
        Shares of the pixels with depth that err by more than each threshold.
    """

    maps: int
    known: float
    rmse: float
    median: float
    bad: tuple[float, ...]


def maps_of(workspace: Workspace, views: Sequence[View]) -> tuple[DepthMap, ...]:
    """Return the maps of a dense workspace that belong to the views."""
    found = []
    for view in views:
        depth, normal, sure = workspace.depth(view.name), workspace.normal(view.name), workspace.confidence(view.name)
        if depth.is_file():
            found.append(DepthMap(view, depth, _there(normal), _there(sure)))
    return tuple(found)


def _there(path: Path) -> Path | None:
    return path if path.is_file() else None


def depth_error(maps: Sequence[DepthMap], truth: MeshCaster, distances: Sequence[float]) -> DepthError | None:
    """Compare maps with the depth of the true surface in the same cameras; None where nothing can be compared."""
    errors: list[Array] = []
    pixels = count = 0
    for each in track(maps, "depth maps"):
        try:
            depth = read_map(each.depth)
        except IbrError:
            continue  # what cannot be read is no depth
        true = truth.cast_camera(each.view.camera.resized(depth.shape[1], depth.shape[0])).t
        there = np.isfinite(true)
        known = there & (depth > 0)
        errors.append(np.abs(depth[known] - true[known]))
        pixels, count = pixels + int(there.sum()), count + 1
    apart = np.concatenate(errors) if errors else np.zeros(0)
    if not len(apart):
        return None
    return DepthError(
        count,
        len(apart) / pixels,
        float(np.sqrt((apart.astype(np.float64) ** 2).mean())),
        float(np.median(apart)),
        tuple(float((apart > distance).mean()) for distance in distances),
    )


@dataclass(frozen=True)
class DisparityError:
    """Error of a depth map in pixels of disparity.

    Attributes
    ----------
    pixels : int
        That have true disparity.
    known : float
        Share of them that have depth.
    rmse, median : float
        Pixels, where there is depth.
    bad : tuple of float
        Shares of the pixels with depth that err by more than each threshold.
    bad_or_unknown : tuple of float
        Shares of all pixels that do so or have no depth.
    """

    pixels: int
    known: float
    rmse: float
    median: float
    bad: tuple[float, ...]
    bad_or_unknown: tuple[float, ...]


def disparity_error(
    depth: Array, calibration: StereoCalibration, truth: Array, thresholds: Sequence[float]
) -> DisparityError:
    """Compare a depth map of the left picture (H, W; 0 = unknown) with true disparity (H, W; NaN = unknown).

    Raises
    ------
    CaptureError
        Sizes differ, or nothing can be compared.
    """
    size = (calibration.height, calibration.width)
    if depth.shape != size or truth.shape != size:
        raise CaptureError(
            f"the depth map is {depth.shape[1]} x {depth.shape[0]}, the true disparity {truth.shape[1]} x "
            f"{truth.shape[0]}, calib.txt says {size[1]} x {size[0]}; make depth at the photos' size "
            "(geometry.depth.max_size)"
        )
    there = np.isfinite(truth)
    apart = np.abs(calibration.disparity(depth) - truth)
    known = there & np.isfinite(apart)
    if not known.any():
        raise CaptureError("no pixel has both depth and true disparity; is it the depth map of the left picture?")
    errors, pixels = apart[known].astype(np.float64), int(there.sum())
    wrong = [int((errors > threshold).sum()) for threshold in thresholds]
    return DisparityError(
        pixels,
        len(errors) / pixels,
        float(np.sqrt((errors**2).mean())),
        float(np.median(errors)),
        tuple(count / len(errors) for count in wrong),
        tuple((count + pixels - len(errors)) / pixels for count in wrong),
    )
