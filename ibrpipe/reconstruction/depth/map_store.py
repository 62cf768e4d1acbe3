"""Depth maps in memory: their cameras, normals in the world, and several of them packed for the kernels."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ibrpipe.errors import CaptureError
from ibrpipe.io.dense import DepthMap, read_map
from ibrpipe.io.views import load_view
from ibrpipe.types import Array, Camera

#: confidence of depth that comes without any
GIVEN = 0.8


@dataclass(frozen=True, eq=False)
class LoadedMap:
    """One depth map.

    Attributes
    ----------
    name : str
        Of the view.
    camera : Camera
        At the map's size.
    depth : (H, W) float32
        Along camera z, scene units; 0 = unknown.
    normal : (H, W, 3) float32
        World, unit, facing the camera; 0 0 0 = unknown.
    confidence : (H, W) float32
        0..1.
    mask : (H, W) float32
        Coverage of the photo's mask.
    """

    name: str
    camera: Camera
    depth: Array
    normal: Array
    confidence: Array
    mask: Array

    @property
    def bytes(self) -> int:
        """Memory that it takes."""
        return self.depth.nbytes + self.normal.nbytes + self.confidence.nbytes + self.mask.nbytes


@dataclass(frozen=True, eq=False)
class Packed:
    """Several maps, row after row, one behind the other; see `ibrpipe.core.reconstruction.fusion`."""

    depth: Array
    normal: Array
    confidence: Array
    starts: Array
    sizes: Array
    projection: Array
    rays: Array
    centers: Array

    @property
    def cameras(self) -> tuple[Array, ...]:
        """What the kernels of fusion and signed distances take as `cameras`."""
        return self.starts, self.sizes, self.projection, self.rays, self.centers


def load_map(given: DepthMap) -> LoadedMap:
    """Read one map; what is missing is made: normals from the depth's slope, an even confidence.

    Raises
    ------
    CaptureError
        Maps of one view have different sizes.
    """
    depth = np.ascontiguousarray(read_map(given.depth), np.float32)
    if depth.ndim != 2:
        raise CaptureError(f"{given.depth}: holds {depth.shape[2]} channels; a depth map has one")
    camera = given.view.camera.resized(depth.shape[1], depth.shape[0])
    mask = _fitted(load_view(given.view)[1], depth.shape)
    depth = np.where(np.isfinite(depth) & (depth > 0) & (mask >= 0.5), depth, np.float32(0))
    local = slope_normals(camera, depth) if given.normal is None else read_map(given.normal)
    confidence = np.full(depth.shape, GIVEN, np.float32) if given.confidence is None else read_map(given.confidence)
    for name, array in (("normal", local), ("confidence", confidence)):
        if array.shape[:2] != depth.shape:
            raise CaptureError(
                f"{given.depth}: the {name} map is {array.shape[1]} x {array.shape[0]} but the depth map is "
                f"{depth.shape[1]} x {depth.shape[0]}; write both at one size"
            )
    normal = np.ascontiguousarray(local @ camera.R, dtype=np.float32)
    known = (depth > 0) & (np.abs(normal).sum(axis=2) > 0)
    return LoadedMap(
        given.view.name, camera, np.where(known, depth, np.float32(0)), normal, np.clip(confidence, 0, 1) * known, mask
    )


def slope_normals(camera: Camera, depth: Array) -> Array:
    """Return (H, W, 3) float32 normals in the camera's frame from differences of depth; 0 0 0 where unknown.

    The smaller of both one-sided differences counts, so that steps do not bend the normals beside them.
    """
    rays = camera.pixel_rays(frame="camera")
    points = np.where(depth > 0, depth, np.nan)[..., None] * rays
    across, down = _step(points, 1), _step(points, 0)
    normal = np.cross(down, across)
    length = np.linalg.norm(normal, axis=2, keepdims=True)
    with np.errstate(invalid="ignore", divide="ignore"):
        normal = normal / length
    normal = np.where((normal * rays).sum(axis=2, keepdims=True) > 0, -normal, normal)
    return np.nan_to_num(normal).astype(np.float32)


def _step(points: Array, axis: int) -> Array:
    """Difference to the neighbour along an axis whose depth is nearer."""
    difference = np.full_like(points, np.nan)
    ahead, behind = [slice(None)] * 3, [slice(None)] * 3
    ahead[axis], behind[axis] = slice(1, None), slice(None, -1)
    step = points[tuple(ahead)] - points[tuple(behind)]
    forward, backward = difference.copy(), difference
    forward[tuple(behind)], backward[tuple(ahead)] = step, step
    size_f, size_b = np.abs(forward[..., 2:]), np.abs(backward[..., 2:])
    return np.where(np.isnan(size_b) | (size_f <= size_b), forward, backward)


def pack(maps: Sequence[LoadedMap]) -> Packed:
    """Lay maps out for the kernels."""
    sizes = np.array([each.depth.shape for each in maps], np.int64).reshape(-1, 2)
    starts = np.concatenate([[0], np.cumsum(sizes.prod(axis=1))]).astype(np.int64)
    cameras = [each.camera for each in maps]
    return Packed(
        np.concatenate([each.depth.ravel() for each in maps]),
        np.concatenate([each.normal.reshape(-1, 3) for each in maps]),
        np.concatenate([each.confidence.ravel() for each in maps]),
        starts,
        sizes,
        *packed_cameras(cameras),
    )


def packed_cameras(cameras: Sequence[Camera]) -> tuple[Array, Array, Array]:
    """Return projections (M, 3, 4), world directions of pixels (M, 3, 3) and centres (M, 3), float64."""
    projection = np.stack([camera.pixel_from_world for camera in cameras])
    return projection, np.stack([camera.world_from_pixel for camera in cameras]), np.stack([c.center for c in cameras])


class MapCache:
    """Loads maps when they are asked for and forgets the longest unused ones beyond a number of bytes."""

    def __init__(self, maps: Sequence[DepthMap], limit: int) -> None:
        self._given = {each.view.name: each for each in maps}
        self._limit = limit
        self._held: OrderedDict[str, LoadedMap] = OrderedDict()

    def get(self, name: str) -> LoadedMap:
        """Return the map of a view."""
        if name not in self._held:
            self._held[name] = load_map(self._given[name])
            while len(self._held) > 1 and sum(each.bytes for each in self._held.values()) > self._limit:
                self._held.popitem(last=False)
        self._held.move_to_end(name)
        return self._held[name]


class MapStore:
    """Confirmed maps on disk, 9 bytes a pixel, read back one at a time."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        folder.mkdir(parents=True, exist_ok=True)
        self._kept: list[tuple[str, Camera]] = []

    def put(self, each: LoadedMap) -> None:
        """Add a map."""
        np.savez(
            self._folder / f"{len(self._kept):05d}.npz",
            depth=each.depth.astype(np.float32),
            normal=np.rint(each.normal * 127).astype(np.int8),
            confidence=np.rint(each.confidence * 255).astype(np.uint8),
            mask=np.rint(each.mask * 255).astype(np.uint8),
        )
        self._kept.append((each.name, each.camera))

    def __len__(self) -> int:
        """Return how many maps there are."""
        return len(self._kept)

    def __iter__(self) -> Iterator[LoadedMap]:
        """Read the maps one by one."""
        for index, (name, camera) in enumerate(self._kept):
            with np.load(self._folder / f"{index:05d}.npz") as held:
                normal = held["normal"].astype(np.float32)
                normal /= np.maximum(np.linalg.norm(normal, axis=2, keepdims=True), 1e-6)
                confidence, mask = held["confidence"].astype(np.float32) / 255, held["mask"].astype(np.float32) / 255
                yield LoadedMap(name, camera, held["depth"], normal, confidence, mask)


def _fitted(mask: Array, shape: tuple[int, ...]) -> Array:
    if mask.shape == shape:
        return mask
    import cv2

    return cv2.resize(mask, (shape[1], shape[0]), interpolation=cv2.INTER_AREA)
