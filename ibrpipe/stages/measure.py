"""What the plan measures before it decides: sampling density, what is seen, how much colour depends on the view."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ibrpipe.core.color import srgb_encode
from ibrpipe.embree import MeshCaster
from ibrpipe.stages.photos import PhotoSet
from ibrpipe.stages.rectangles import Rectangle, passed
from ibrpipe.types import Array


@dataclass(frozen=True, eq=False)
class SurfaceSample:
    """Points spread evenly over the surface: `points`, `normals` (N, 3), `observers` (N,) photos that see each."""

    points: Array
    normals: Array
    observers: Array


@dataclass(frozen=True)
class Appearance:
    """How well photos are predicted from the others; mean squares in display code (0 to 1) over blocks of 4 x 4 pixels.

    Attributes
    ----------
    blocks : number of blocks
    diffuse : left-out photo minus diffuse colour
    predicted : view-dependent prediction minus diffuse colour
    common : product of the two
    """

    blocks: int
    diffuse: float
    predicted: float
    common: float

    @property
    def share(self) -> float:
        """How much of the predicted view dependence is best added (0 to 1).

        Leaving a photo out doubles the angle to the next one, so the prediction is right in part even where the
        finished residuals, made from all photos, will be right altogether.
        """
        return float(np.clip(self.common / self.predicted, 0, 1)) if self.predicted > 0 else 0.0

    @property
    def remaining(self) -> float:
        """Mean square that is left when that share is added."""
        return max(self.diffuse - 2 * self.share * self.common + self.share**2 * self.predicted, 0.0)

    @property
    def gain(self) -> float:
        """How much better left-out photos are predicted by adding that share, dB; errors below half a code are none."""
        floor = (0.5 / 255) ** 2
        return float(10 * np.log10((self.diffuse + floor) / (self.remaining + floor)))

    def as_json(self) -> dict[str, float]:
        """Figures for plan.json; PSNR in dB on left-out photos."""
        psnr = {
            name: round(float(-10 * np.log10(max(square, 1e-10))), 2)
            for name, square in (("diffuse_psnr", self.diffuse), ("view_dependent_psnr", self.remaining))
            if self.blocks
        }
        return {"blocks": self.blocks, **psnr, "share_added": round(self.share, 3), "gain_db": round(self.gain, 2)}


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

    Pixels are taken in blocks of 4 x 4 and averaged before anything is compared, so that noise and blur of fine texture
    do not pass for view dependence. A block counts for the texture through whose rectangle it is seen, which is the one
    that the renderer asks for residuals. About 600 blocks of each left-out photo are taken.
    """
    rng = np.random.default_rng(seed)
    chosen = np.unique(np.linspace(0, len(photos.cameras) - 1, most_photos).round().astype(int))
    sums = np.zeros((len(rectangles), 4))
    for left_out in chosen if len(photos.cameras) > 1 else ():
        points, normals, truth, block = _photo_surface(int(left_out), caster, photos, rng)
        if len(points) == 0:
            continue
        rest = photos.subset([p for p in range(len(photos.cameras)) if p != left_out])
        toward = photos.centers[left_out] - points
        toward /= np.linalg.norm(toward, axis=1, keepdims=True)
        diffuse, _, _ = rest.diffuse(points, normals)
        blended, count = rest.blend(points, normals, toward)
        owner = passed(rectangles, points, toward)
        base = srgb_encode(diffuse, np.inf)
        missing, predicted = truth - base, srgb_encode(blended, np.inf) - base
        missing, predicted, owner = _block_means(block, count >= 2, missing, predicted, owner)
        products = (missing * missing, predicted * predicted, missing * predicted)
        terms = np.stack([np.ones(len(owner)), *(product.mean(axis=1) for product in products)], axis=1)
        np.add.at(sums, owner, terms)
    return [Appearance(int(row[0]), *(row[1:] / max(row[0], 1)).tolist()) for row in sums]


def _block_means(block: Array, good: Array, missing: Array, predicted: Array, owner: Array) -> tuple[Array, ...]:
    """Average colours over the blocks with at least 8 good pixels; a block's owner is that of its first pixel."""
    block, missing, predicted, owner = block[good], missing[good], predicted[good], owner[good]
    kept, first, number, size = np.unique(block, return_index=True, return_inverse=True, return_counts=True)
    means = []
    for values in (missing, predicted):
        total = np.zeros((len(kept), 3))
        np.add.at(total, number, values)
        means.append((total / size[:, None])[size >= 8])
    return means[0], means[1], owner[first][size >= 8]


def _photo_surface(
    photo: int, caster: MeshCaster, photos: PhotoSet, rng: np.random.Generator, most: int = 600
) -> tuple[Array, Array, Array, Array]:
    """Surface points, normals, true colours and block numbers of blocks of pixels well inside one photo's mask."""
    camera, own = photos.cameras[photo], slice(photos.starts[photo], photos.starts[photo] + photos.sizes[photo].prod())
    hits = caster.cast_camera(camera)
    inside = np.flatnonzero(np.isfinite(hits.t.ravel()) & (photos.mask[own] >= 0.95))
    block = inside // camera.width // 4 * camera.width + inside % camera.width // 4
    numbers = np.unique(block)
    taken = np.isin(block, rng.choice(numbers, min(most, len(numbers)), replace=False))
    pixels, block = inside[taken], block[taken]
    row, column = pixels // camera.width, pixels % camera.width
    directions = np.stack([column + 0.5, row + 0.5, np.ones(len(pixels))], axis=1) @ camera.world_from_pixel.T
    points = camera.center + hits.t.ravel()[pixels, None].astype(np.float64) * directions
    normals = caster.smooth_normals(hits.face.ravel()[pixels], hits.uv.reshape(-1, 2)[pixels])
    return points, normals, photos.code[own][pixels], block
