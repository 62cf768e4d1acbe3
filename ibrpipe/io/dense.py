"""Depth, normal and confidence maps on disk, in the layout of COLMAP's dense workspace.

A workspace holds ``images/`` (undistorted), ``sparse/`` (a COLMAP text model), ``stereo/depth_maps``,
``stereo/normal_maps`` (named ``IMAGE.geometric.bin``), ``stereo/fusion.cfg`` and, our own addition,
``stereo/confidence/IMAGE.bin``. A map file is ``width&height&channels&`` in ASCII, then float32 little-endian, channel
after channel, each row after row. Depth is along camera z in scene units, 0 = unknown; normals are unit vectors in the
camera's frame (OpenCV axes) that face the camera, 0 0 0 = unknown; confidence is 0..1.

COLMAP's fusion asks the model's points which photos see the same surface; a model without points fuses to nothing. So
points of the depth maps tie the photos together.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ibrpipe.errors import FormatError, MissingFileError, ShapeError
from ibrpipe.io.cameras.colmap_write import ModelImage, SparseModel, write_model
from ibrpipe.io.cameras.lenses import pinhole_lens
from ibrpipe.io.photos.images import write_png
from ibrpipe.io.views import View, load_view
from ibrpipe.types import Array, Camera

#: what COLMAP calls depth that agreed between photos
KIND = "geometric"
#: pixels of each depth map that become points, about
SAMPLES = 150
#: most difference of depth with which a photo sees a point, share
AGREES = 0.01
_LONGEST_HEADER = 64


@dataclass(frozen=True, eq=False)
class DepthMap:
    """What was found out about the depth of one view.

    Attributes
    ----------
    view : View
    depth : Path
        Map file, (H, W); the view's camera resized to this size is the camera of the map.
    normal, confidence : Path or None
        Map files of the same size, (H, W, 3) and (H, W).
    neighbours : tuple of str
        Names of the views that it was matched with.
    seconds : float
        What it took; 0 = given or taken over from an earlier run.
    angles : tuple of float
        To every neighbour, at what both see, median, degrees; empty = not known.
    """

    view: View
    depth: Path
    normal: Path | None = None
    confidence: Path | None = None
    neighbours: tuple[str, ...] = ()
    seconds: float = 0.0
    angles: tuple[float, ...] = ()


@dataclass(frozen=True)
class Workspace:
    """Where things are in a dense workspace.

    Attributes
    ----------
    root : Path
    """

    root: Path

    @property
    def images(self) -> Path:
        """Folder of the undistorted photos."""
        return self.root / "images"

    @property
    def sparse(self) -> Path:
        """Folder of the COLMAP model."""
        return self.root / "sparse"

    @property
    def stereo(self) -> Path:
        """Folder of the maps."""
        return self.root / "stereo"

    @property
    def fusion_list(self) -> Path:
        """Names of the images to fuse, one a line."""
        return self.stereo / "fusion.cfg"

    def image(self, view: str) -> Path:
        """Return the undistorted photo of a view, by the view's name."""
        return self.images / f"{view}.png"

    def depth(self, view: str, kind: str = KIND) -> Path:
        """Return the depth map of a view."""
        return self.stereo / "depth_maps" / f"{view}.png.{kind}.bin"

    def normal(self, view: str, kind: str = KIND) -> Path:
        """Return the normal map of a view."""
        return self.stereo / "normal_maps" / f"{view}.png.{kind}.bin"

    def confidence(self, view: str) -> Path:
        """Return the confidence map of a view."""
        return self.stereo / "confidence" / f"{view}.png.bin"

    def lay_out(self) -> None:
        """Make the folders."""
        for name in ("depth_maps", "normal_maps", "confidence"):
            (self.stereo / name).mkdir(parents=True, exist_ok=True)
        for folder in (self.images, self.sparse):
            folder.mkdir(parents=True, exist_ok=True)


def read_map(path: Path) -> Array:
    """Read a depth, normal or confidence map.

    Returns
    -------
    (H, W) or (H, W, C) float32

    Raises
    ------
    MissingFileError, FormatError
        The file does not exist, has no such header, or is cut off.
    """
    if not path.is_file():
        raise MissingFileError(f"{path}: the map does not exist")
    content = path.read_bytes()
    fields = content[:_LONGEST_HEADER].split(b"&", 3)
    if len(fields) < 4 or not all(field.isdigit() for field in fields[:3]):
        raise FormatError(f"{path}: is no map; expected width&height&channels& at its beginning, as COLMAP writes")
    width, height, channels = (int(field) for field in fields[:3])
    start = sum(len(field) + 1 for field in fields[:3])
    if width * height * channels * 4 != len(content) - start or not width * height * channels:
        raise FormatError(
            f"{path}: holds {len(content) - start} bytes after its header but {width} x {height} x {channels} numbers "
            "are promised; it was cut off: write it again"
        )
    planes = np.frombuffer(content, "<f4", offset=start).reshape(channels, height, width)
    pixels = np.ascontiguousarray(planes.transpose(1, 2, 0), dtype=np.float32)
    return pixels[:, :, 0].copy() if channels == 1 else pixels


def write_map(path: Path, array: Array) -> None:
    """Write a map of (H, W) or (H, W, C) numbers as float32; it appears whole or not at all."""
    pixels = np.asarray(array, np.float32)
    if pixels.ndim not in (2, 3) or pixels.size == 0:
        raise ShapeError(f"a map must be (H, W) or (H, W, C) and not empty, got {pixels.shape}")
    planes = pixels[:, :, None] if pixels.ndim == 2 else pixels
    height, width, channels = planes.shape
    partial = path.with_name(f".{path.name}.partial")
    with partial.open("wb") as target:
        target.write(f"{width}&{height}&{channels}&".encode("ascii"))
        target.write(np.ascontiguousarray(planes.transpose(2, 0, 1)).astype("<f4").tobytes())
    partial.replace(path)


def write_workspace(workspace: Workspace, maps: Sequence[DepthMap]) -> None:
    """Add what others need to use the maps: photos of their size, a model that ties them, the list for fusion."""
    workspace.lay_out()
    cameras = []
    for each in maps:
        height, width = read_map(each.depth).shape[:2]
        cameras.append(each.view.camera.resized(width, height))
        write_png(workspace.image(each.view.name), _resized(load_view(each.view)[0], width, height))
    names = [f"{each.view.name}.png" for each in maps]
    write_model(tied_model(names, cameras, lambda index: read_map(maps[index].depth)), workspace.sparse)
    workspace.fusion_list.write_text("".join(f"{name}\n" for name in names), encoding="utf-8")


def _resized(picture: Array, width: int, height: int) -> Array:
    if picture.shape[:2] == (height, width):
        return picture
    import cv2

    return cv2.resize(picture, (width, height), interpolation=cv2.INTER_AREA)


def samples_of(camera: Camera, depth: Array) -> Array:
    """Return world points (N, 3) at even pixels of a depth map (H, W), 0 = unknown."""
    step = max(1, int((depth.size / SAMPLES) ** 0.5))
    row, column = np.nonzero(depth[step // 2 :: step, step // 2 :: step] > 0)
    row, column = row * step + step // 2, column * step + step // 2
    rays = camera.pixel_rays(np.stack([column, row], axis=1) + 0.5)
    return camera.center + depth[row, column, None].astype(np.float64) * rays


def seen_in(camera: Camera, depth: Array, points: Array) -> tuple[Array, Array]:
    """Return which points (N, 3) a depth map (H, W) shows (M,), and where (M, 2), pixels."""
    x, y, z = camera.K @ (camera.R @ points.T + camera.t.reshape(3, 1))
    ahead = z > 0
    pixel = np.stack([x, y], axis=1) / np.where(ahead, z, 1.0)[:, None]
    inside = ahead & (pixel >= 0).all(axis=1) & (pixel < (depth.shape[1], depth.shape[0])).all(axis=1)
    index = np.flatnonzero(inside)
    found = depth[pixel[index, 1].astype(int), pixel[index, 0].astype(int)]
    index = index[np.abs(found - z[index]) <= AGREES * z[index]]
    return index, pixel[index]


def tied_model(names: Sequence[str], cameras: Sequence[Camera], read: Callable[[int], Array]) -> SparseModel:
    """Return the model of photos and the points of their depth maps that at least two of them show.

    Parameters
    ----------
    names : sequence of str
    cameras : sequence of Camera
        Of the size of the maps.
    read : callable
        Returns the depth map (H, W) of a photo by its number; 0 = unknown. One at a time, twice each.
    """
    points = np.concatenate([samples_of(camera, read(number)) for number, camera in enumerate(cameras)])
    images = []
    for number, (name, camera) in enumerate(zip(names, cameras, strict=True)):
        index, pixel = seen_in(camera, read(number), points)
        images.append(ModelImage(name, number, np.asarray(camera.cam_from_world), pixel, index))
    lenses = tuple(map(pinhole_lens, cameras))
    grey = np.full((len(points), 3), 128, np.uint8)
    return SparseModel(lenses, tuple(images), points, grey, np.zeros(len(points))).only(names)
