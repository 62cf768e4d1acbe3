"""What the plan measures before it decides: sampling density, what is seen, how much colour depends on the view."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ibrpipe.core.color import srgb_encode
from ibrpipe.embree import MeshCaster
from ibrpipe.stages.photos import PhotoSet
from ibrpipe.stages.rectangles import Rectangle
from ibrpipe.types import Array


@dataclass(frozen=True, eq=False)
class SurfaceSample:
    """Points spread evenly over the surface: `points`, `normals` (N, 3), `observers` (N,) photos that see each."""

    points: Array
    normals: Array
    observers: Array


@dataclass(frozen=True)
class Appearance:
    """Errors of predicting left-out photos, mean squared in display code (0 to 1)."""

    pixels: int
    diffuse_mse: float
    blended_mse: float

    @property
    def gain(self) -> float:
        """How much better view-dependent colour predicts, in dB."""
        if self.pixels == 0:
            return 0.0
        floor = (0.5 / 255) ** 2  # an error below half a code is none
        return float(10 * np.log10((self.diffuse_mse + floor) / (self.blended_mse + floor)))

    def as_json(self) -> dict[str, float]:
        """Figures for plan.json; PSNR in dB on left-out photos."""
        psnr = {
            name: round(float(-10 * np.log10(max(mse, 1e-10))), 2)
            for name, mse in (("diffuse_psnr", self.diffuse_mse), ("view_dependent_psnr", self.blended_mse))
            if self.pixels
        }
        return {"pixels": self.pixels, **psnr, "gain_db": round(self.gain, 2)}


def sample_surface(caster: MeshCaster, photos: PhotoSet, count: int, seed: int) -> SurfaceSample:
    """Draw points by area and count the photos that see them."""
    rng = np.random.default_rng(seed)
    mesh = caster.mesh
    corners = mesh.vertices[mesh.faces]
    areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    face = np.sort(rng.choice(len(areas), count, p=areas / areas.sum()))
    root, along = np.sqrt(rng.random(count)), rng.random(count)
    uv = np.stack([root * (1 - along), root * along], axis=1).astype(np.float32)
    weights = np.concatenate([1 - uv.sum(axis=1, keepdims=True), uv], axis=1).astype(np.float64)
    points = np.einsum("nc,ncd->nd", weights, corners[face])
    normals = caster.smooth_normals(face, uv)
    _, _, observers = photos.diffuse(points, normals)
    return SurfaceSample(points, normals, observers)


def sampling_density(surface: SurfaceSample, photos: PhotoSet) -> tuple[float, float]:
    """Photo pixels per scene unit on the seen surface, best photo of each point: (median, 90th percentile)."""
    seen = surface.observers > 0
    points, normals = surface.points[seen], surface.normals[seen]
    best = np.zeros(len(points))
    for camera in photos.cameras:
        local = points @ camera.R.T + camera.t
        toward = camera.center - points
        cosine = (toward * normals).sum(axis=1) / np.linalg.norm(toward, axis=1)
        inside = _in_picture(camera.K, local, camera.width, camera.height) & (cosine > 0)
        with np.errstate(divide="ignore", invalid="ignore"):
            density = np.sqrt(camera.K[0, 0] * camera.K[1, 1] * np.maximum(cosine, 0)) / local[:, 2]
        best = np.where(inside, np.maximum(best, density), best)
    return float(np.median(best)), float(np.percentile(best, 90))


def _in_picture(K: Array, local: Array, width: int, height: int) -> Array:
    with np.errstate(divide="ignore", invalid="ignore"):
        x, y = (local @ K.T)[:, :2].T / local[:, 2]
    return (local[:, 2] > 0) & (x >= 0) & (x < width) & (y >= 0) & (y < height)


def photo_spacing(photos: PhotoSet, center: Array) -> float:
    """Median over photos of the angle to the nearest other photo, seen from `center`, degrees; 180 for one photo."""
    toward = photos.centers - center
    toward = toward / np.linalg.norm(toward, axis=1, keepdims=True)
    cosine = toward @ toward.T
    np.fill_diagonal(cosine, -1.0)
    return float(np.degrees(np.median(np.arccos(np.clip(cosine.max(axis=1), -1, 1)))))


def appearance(
    rectangles: Sequence[Rectangle], caster: MeshCaster, photos: PhotoSet, seed: int, most_photos: int = 8
) -> list[Appearance]:
    """Leave photos out one by one and predict them from the others, diffuse and view-dependent; one result a texture.

    Every pixel counts for the texture that faces its surface best. About 4,000 pixels of each left-out photo are taken.
    """
    rng = np.random.default_rng(seed)
    chosen = np.unique(np.linspace(0, len(photos.cameras) - 1, most_photos).round().astype(int))
    sums = np.zeros((len(rectangles), 3))
    for left_out in chosen if len(photos.cameras) > 1 else ():
        points, normals, truth = _photo_surface(int(left_out), caster, photos, rng)
        if len(points) == 0:
            continue
        rest = photos.subset([p for p in range(len(photos.cameras)) if p != left_out])
        toward = photos.centers[left_out] - points
        toward /= np.linalg.norm(toward, axis=1, keepdims=True)
        diffuse, _, _ = rest.diffuse(points, normals)
        blended, count = rest.blend(points, normals, toward)
        owner = np.stack([r.facing(points, normals) for r in rectangles], axis=1).argmax(axis=1)
        good = count >= 2
        for color, column in ((diffuse, 1), (blended, 2)):
            error = ((srgb_encode(color[good]) - truth[good]) ** 2).mean(axis=1)
            np.add.at(sums[:, column], owner[good], error)
        np.add.at(sums[:, 0], owner[good], 1)
    return [Appearance(int(n), d / max(n, 1), b / max(n, 1)) for n, d, b in sums]


def _photo_surface(
    photo: int, caster: MeshCaster, photos: PhotoSet, rng: np.random.Generator, most: int = 4000
) -> tuple[Array, Array, Array]:
    """Surface points, normals and true colours of pixels well inside one photo's mask."""
    camera, own = photos.cameras[photo], slice(photos.starts[photo], photos.starts[photo + 1])
    hits = caster.cast_camera(camera)
    inside = np.flatnonzero(np.isfinite(hits.t.ravel()) & (photos.mask[own] >= 0.95))
    pixels = np.sort(rng.choice(inside, min(most, len(inside)), replace=False))
    row, column = pixels // camera.width, pixels % camera.width
    directions = np.stack([column + 0.5, row + 0.5, np.ones(len(pixels))], axis=1) @ camera.world_from_pixel.T
    points = camera.center + hits.t.ravel()[pixels, None].astype(np.float64) * directions
    normals = caster.smooth_normals(hits.face.ravel()[pixels], hits.uv.reshape(-1, 2)[pixels])
    return points, normals, photos.code[own][pixels]
