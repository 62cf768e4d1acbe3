"""What the plan measures before it decides: sampling density, what is seen, how much colour depends on the view."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ibrpipe.capture.photo_set import PhotoSet
from ibrpipe.core.appearance.depth_edges import beside_edge
from ibrpipe.core.appearance.shift_range import range_around
from ibrpipe.core.color import srgb_encode
from ibrpipe.core.normals import face_normals
from ibrpipe.embree import MeshCaster
from ibrpipe.modelling.rectangles import Rectangle, passed
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
    beyond_shift : what is left of `diffuse` when every pixel of the photo may be taken from nearby; None = not measured
    """

    blocks: int
    diffuse: float
    predicted: float
    common: float
    beyond_shift: float | None = None

    @property
    def codes(self) -> float:
        """Error of diffuse colour on left-out photos, in 8-bit codes."""
        return 255 * self.diffuse**0.5

    @property
    def beyond_codes(self) -> float:
        """The part of that error which misplaced geometry does not explain, in 8-bit codes."""
        return 255 * (self.diffuse if self.beyond_shift is None else self.beyond_shift) ** 0.5

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
        codes = {"diffuse_codes": round(self.codes, 2), "beyond_shift_codes": round(self.beyond_codes, 2)}
        shares = {"share_added": round(self.share, 3), "gain_db": round(self.gain, 2)}
        return {"blocks": self.blocks, **psnr, **(codes if self.blocks else {}), **shares}


def sample_surface(caster: MeshCaster, photos: PhotoSet, count: int, seed: int) -> SurfaceSample:
    """Draw points by area and count the photos that see them."""
    rng = np.random.default_rng(seed)
    mesh = caster.mesh
    corners = mesh.vertices[mesh.faces]
    areas = np.linalg.norm(face_normals(mesh.vertices, mesh.faces), axis=1)
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


def edge_share(photos: PhotoSet) -> float:
    """Share of the photos' pixels that lie on the mesh, inside the mask, and beside another surface, or beside none."""
    edges, count = 0, 0
    for p, camera in enumerate(photos.cameras):
        own, shape = photos.pixels_of(p), (camera.height, camera.width)
        mask, depth = photos.mask[own].reshape(shape), photos.depth[own].reshape(shape)
        inside = (mask >= 0.5) & np.isfinite(depth)
        edges += int((beside_edge(depth, mask) & inside).sum())
        count += int(inside.sum())
    return edges / max(count, 1)


def appearance(
    rectangles: Sequence[Rectangle], caster: MeshCaster, photos: PhotoSet, seed: int, shift: float, most_photos: int = 8
) -> list[Appearance]:
    """Leave photos out one by one and predict them from the others, diffuse and view-dependent; one result a texture.

    Pixels are taken in blocks of 4 x 4 and averaged before anything is compared, so that noise and blur of fine texture
    do not pass for view dependence. A block counts for the texture through whose rectangle it is seen, which is the one
    that the renderer asks for residuals. About 600 blocks of each left-out photo are taken.

    Parameters
    ----------
    shift : pixels (0 to 1) by which colours may be misplaced, see `beyond_shift`
    """
    rng = np.random.default_rng(seed)
    chosen = np.unique(np.linspace(0, len(photos.cameras) - 1, most_photos).round().astype(int))
    sums = np.zeros((len(rectangles), 5))
    for left_out in chosen if len(photos.cameras) > 1 else ():
        seen = _photo_surface(int(left_out), caster, photos, rng)
        if len(seen.pixels) == 0:
            continue
        rest = photos.subset([p for p in range(len(photos.cameras)) if p != left_out])
        toward = photos.centers[left_out] - seen.points
        toward /= np.linalg.norm(toward, axis=1, keepdims=True)
        diffuse, _, _ = rest.diffuse(seen.points, seen.normals)
        blended, count = rest.blend(seen.points, seen.normals, toward)
        base = srgb_encode(diffuse, np.inf)
        missing, predicted = seen.picture.reshape(-1, 3)[seen.pixels] - base, srgb_encode(blended, np.inf) - base
        beyond = beyond_shift(base, seen.picture, seen.pixels, shift)
        owner = passed(rectangles, seen.points, toward)
        (missing, predicted, beyond), owner = _block_means(seen.block, count >= 2, (missing, predicted, beyond), owner)
        products = (missing * missing, predicted * predicted, missing * predicted, beyond * beyond)
        terms = np.stack([np.ones(len(owner)), *(product.mean(axis=1) for product in products)], axis=1)
        np.add.at(sums, owner, terms)
    return [Appearance(int(row[0]), *(row[1:] / max(row[0], 1)).tolist()) for row in sums]


def beyond_shift(base: Array, picture: Array, pixels: Array, shift: float) -> Array:
    """Differences of pixels from expected colours that no misplacement by up to `shift` pixels explains.

    Where the surface or a camera is slightly off, a photo shows the right colours a little beside the place where they
    are expected. Only what lies outside the range of the photo's colours around the place surely depends on the view.

    Parameters
    ----------
    base : (N, 3) float32
        Expected colours, display code.
    picture : (H, W, 3) float32
        The photo, display code; NaN = not to be used.
    pixels : (N,) int64
        Row-major numbers of the pixels.

    Returns
    -------
    (N, 3) float32
        Display code; 0 where the expected colour lies in the range. With `shift` 0 the whole difference.
    """
    low, high = np.empty((len(pixels), 3), np.float32), np.empty((len(pixels), 3), np.float32)
    rows, columns = np.divmod(pixels.astype(np.int64), picture.shape[1])
    range_around(picture, rows, columns, float(shift), low, high)
    return np.asarray(np.clip(base, low, high) - base)


def _block_means(block: Array, good: Array, fields: Sequence[Array], owner: Array) -> tuple[list[Array], Array]:
    """Average colours over the blocks with at least 8 good pixels; a block's owner is that of its first pixel."""
    kept, first, number, size = np.unique(block[good], return_index=True, return_inverse=True, return_counts=True)
    means = []
    for values in fields:
        total = np.zeros((len(kept), 3))
        np.add.at(total, number, values[good])
        means.append((total / size[:, None])[size >= 8])
    return means, owner[good][first][size >= 8]


@dataclass(frozen=True, eq=False)
class _Seen:
    """What one photo shows of the surface.

    Attributes
    ----------
    picture : (H, W, 3) float32, display code; NaN outside the mask and where the mesh is not hit
    pixels, block : (N,) row-major numbers of the pixels that are compared, and of the blocks that they belong to
    points, normals : (N, 3) world
    """

    picture: Array
    pixels: Array
    block: Array
    points: Array
    normals: Array


def _photo_surface(
    photo: int, caster: MeshCaster, photos: PhotoSet, rng: np.random.Generator, most: int = 600
) -> _Seen:
    """Choose blocks of pixels well inside one photo's mask and find the surface that they show."""
    camera, own = photos.cameras[photo], photos.pixels_of(photo)
    hits = caster.cast_camera(camera)
    shown = np.isfinite(hits.t.ravel()) & (photos.mask[own] >= 0.95)
    inside = np.flatnonzero(shown)
    block = inside // camera.width // 4 * camera.width + inside % camera.width // 4
    numbers = np.unique(block)
    taken = np.isin(block, rng.choice(numbers, min(most, len(numbers)), replace=False))
    pixels, block = inside[taken], block[taken]
    row, column = pixels // camera.width, pixels % camera.width
    directions = camera.pixel_rays(np.stack([column, row], axis=1) + 0.5)
    points = camera.center + hits.t.ravel()[pixels, None].astype(np.float64) * directions
    normals = caster.smooth_normals(hits.face.ravel()[pixels], hits.uv.reshape(-1, 2)[pixels])
    picture = np.where(shown[:, None], photos.code[own], np.float32(np.nan))
    return _Seen(picture.reshape(camera.height, camera.width, 3), pixels, block, points, normals)
