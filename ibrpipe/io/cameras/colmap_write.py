"""COLMAP text models with points and the pixels of the photos that see them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from ibrpipe.core.similarity import move_points, move_poses
from ibrpipe.io.cameras.lenses import Lens
from ibrpipe.types import Array


@dataclass(frozen=True, eq=False)
class ModelImage:
    """A photo of a model.

    Attributes
    ----------
    name : str
        Relative to the folder of the photos.
    lens : int
        Index into the model's lenses.
    cam_from_world : (3, 4) float64
    pixels : (N, 2) float64
        Where points of the model lie in the photo; none unless given.
    points : (N,) int64
        Which points of the model they are.
    """

    name: str
    lens: int
    cam_from_world: Array
    pixels: Array = field(default_factory=lambda: np.zeros((0, 2)))
    points: Array = field(default_factory=lambda: np.zeros(0, np.int64))


@dataclass(frozen=True, eq=False)
class SparseModel:
    """Lenses, photos and points that explain each other.

    Attributes
    ----------
    lenses : tuple of Lens
    images : tuple of ModelImage
    xyz : (P, 3) float64
        World, scene units; no points unless given.
    rgb : (P, 3) uint8
    error : (P,) float64
        Mean reprojection error, pixels.
    """

    lenses: tuple[Lens, ...]
    images: tuple[ModelImage, ...]
    xyz: Array = field(default_factory=lambda: np.zeros((0, 3)))
    rgb: Array = field(default_factory=lambda: np.zeros((0, 3), np.uint8))
    error: Array = field(default_factory=lambda: np.zeros(0))

    def only(self, names: Iterable[str]) -> SparseModel:
        """Return the model of some of the photos, with the points that at least two of them see."""
        wanted = set(names)
        images = [image for image in self.images if image.name in wanted]
        seen = np.zeros(len(self.xyz), np.int64)
        for image in images:
            seen[np.unique(image.points)] += 1
        kept = np.flatnonzero(seen >= 2)
        new = np.full(len(self.xyz), -1, np.int64)
        new[kept] = np.arange(len(kept))
        lenses = sorted({image.lens for image in images})
        renamed = tuple(_with_points(image, lenses.index(image.lens), new) for image in images)
        chosen = tuple(self.lenses[lens] for lens in lenses)
        return SparseModel(chosen, renamed, self.xyz[kept], self.rgb[kept], self.error[kept])

    def renamed(self, rename: Callable[[str], str]) -> SparseModel:
        """Return the model with other names of its photos."""
        images = tuple(replace(image, name=rename(image.name)) for image in self.images)
        return replace(self, images=images)

    def moved(self, similarity: tuple[float, Array, Array]) -> SparseModel:
        """Return the model in another world: x becomes ``scale * R @ x + t``."""
        poses = move_poses(similarity, np.array([image.cam_from_world for image in self.images]))
        images = tuple(replace(image, cam_from_world=pose) for image, pose in zip(self.images, poses))
        return replace(self, images=images, xyz=move_points(similarity, self.xyz))


def _with_points(image: ModelImage, lens: int, new: Array) -> ModelImage:
    points = new[image.points]
    there = points >= 0
    return ModelImage(image.name, lens, image.cam_from_world, image.pixels[there], points[there])


def write_model(model: SparseModel, folder: Path) -> None:
    """Write cameras.txt, images.txt and points3D.txt; numbers count from 1, the same model gives the same bytes."""
    folder.mkdir(parents=True, exist_ok=True)
    lines = ["# CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]"]
    for key, lens in enumerate(model.lenses, 1):
        lines.append(f"{key} {lens.model} {lens.width} {lens.height} {_numbers(lens.params)}")
    _write(folder / "cameras.txt", lines)
    _write(folder / "images.txt", _image_lines(model.images))
    _write(folder / "points3D.txt", _point_lines(model))


def _image_lines(images: Sequence[ModelImage]) -> list[str]:
    lines = ["# IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME", "# POINTS2D[] as (X, Y, POINT3D_ID)"]
    for key, image in enumerate(images, 1):
        quaternion = Rotation.from_matrix(image.cam_from_world[:, :3]).as_quat(canonical=True)[[3, 0, 1, 2]]
        pose = f"{_numbers(quaternion)} {_numbers(image.cam_from_world[:, 3])}"
        lines.append(f"{key} {pose} {image.lens + 1} {image.name}")
        seen = zip(image.pixels.tolist(), (image.points + 1).tolist())
        lines.append(" ".join(f"{x:.7g} {y:.7g} {point}" for (x, y), point in seen))
    return lines


def _point_lines(model: SparseModel) -> list[str]:
    tracks: list[list[str]] = [[] for _ in model.xyz]
    for key, image in enumerate(model.images, 1):
        for index, point in enumerate(image.points.tolist()):
            tracks[point].append(f"{key} {index}")
    lines = ["# POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[] as (IMAGE_ID, POINT2D_IDX)"]
    rows = zip(model.xyz.tolist(), model.rgb.tolist(), model.error.tolist(), tracks)
    for key, (xyz, rgb, error, track) in enumerate(rows, 1):
        lines.append(f"{key} {_numbers(xyz)} {' '.join(map(str, rgb))} {error:.6g} {' '.join(track)}")
    return lines


def _numbers(values: Iterable[float]) -> str:
    return " ".join(repr(float(value)) for value in values)


def _write(path: Path, lines: Sequence[str]) -> None:
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
