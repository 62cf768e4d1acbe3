"""The photos of a run as other programs want them: lenses, poses and sparse points."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ibrpipe.core.color import srgb_encode, to_bytes
from ibrpipe.errors import CaptureError, FormatError, MissingFileError
from ibrpipe.io.cameras.lenses import Lens, pinhole_lens, project
from ibrpipe.io.photos.images import read_image
from ibrpipe.io.points import SparsePoints, read_points
from ibrpipe.io.views import View, ViewSet, read_views, views_in_run
from ibrpipe.progress import track
from ibrpipe.types import Array

POINTS = "ingest/points.npz"


@dataclass(frozen=True, eq=False)
class RunCameras:
    """Photos and points of a run.

    Attributes
    ----------
    views : ViewSet
    points : SparsePoints or None
        Their `views` count those the asset is made from.
    """

    views: ViewSet
    points: SparsePoints | None

    @property
    def all(self) -> tuple[View, ...]:
        """Photos the asset is made from, then held-out ones."""
        return (*self.views.train, *self.views.test)


def read_run_cameras(run: Path) -> RunCameras:
    """Read cameras and points of a run folder.

    Raises
    ------
    MissingFileError, FormatError
        The folder is no run with ingested photos, or a file in it is damaged.
    """
    views = views_in_run(run)
    if views is None:
        raise MissingFileError(f"{run}: holds no ingest/views.json; give the folder of a run, to export its cameras")
    points = run / POINTS
    return RunCameras(read_views(views), read_points(points) if points.is_file() else None)


def photo_lens(view: View) -> Lens:
    """Return the camera model of a photo's file.

    Raises
    ------
    FormatError
        Its pixels are skewed, which no model says.
    """
    if view.distortion is not None:
        return view.distortion
    camera = view.full_camera
    if abs(camera.K[0, 1]) > 1e-9 * camera.K[0, 0]:
        raise FormatError(f"photo {view.name}: its pixels are skewed by {camera.K[0, 1]:g}, which no camera model says")
    return pinhole_lens(camera)


def point_pixels(view: View, xyz: Array) -> Array:
    """Return where world points (N, 3) lie in a photo's file, (N, 2) float64; NaN behind it."""
    local = xyz @ view.camera.R.T + view.camera.t
    return project(photo_lens(view), local)


def point_colors(points: SparsePoints, views: Sequence[View]) -> Array:
    """Return the colours of points as the first photo that sees each shows it, (P, 3) uint8 sRGB; grey where none does.

    Photos that cannot be read count as not there.
    """
    found = np.full((len(points.xyz), 3), 128, np.uint8)
    seen = np.diff(points.offsets) > 0
    first = np.full(len(points.xyz), -1)
    first[seen] = points.views[points.offsets[:-1][seen]]
    for index, view in enumerate(track(list(views), "colours of points")):
        own = np.flatnonzero(first == index)
        if not len(own) or not view.image.is_file():
            continue
        try:
            picture = read_image(view.image, view.color_space, view.oriented)
        except (FormatError, CaptureError):
            continue
        x, y = point_pixels(view, points.xyz[own]).T
        with np.errstate(invalid="ignore"):
            inside = (x >= 0) & (x < picture.shape[1]) & (y >= 0) & (y < picture.shape[0])
        color = picture[y[inside].astype(int), x[inside].astype(int), :3]
        found[own[inside]] = to_bytes(srgb_encode(np.broadcast_to(color, (len(color), 3))))
    return found
