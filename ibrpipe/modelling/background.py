"""What photos show behind all known surface, blended on far planes: a fallback layer for places without masks.

Nothing is known of its depth but that it lies behind the mesh. One plane across the mean direction of view takes it
where all photos look the same way, else the faces of a cube around the photos. The distance is that of a few at which
the photos agree best; what lies nearer than the plane shifts against it when the view moves.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ibrpipe.capture.photo_set import PhotoSet
from ibrpipe.io.views import spread
from ibrpipe.types import Array, Camera, LayeredDepthImage, Mesh

#: distances that are tried, in reaches of what is known
TRIED = (1.2, 1.5, 2.0, 3.0, 5.0, 10.0, 30.0)
#: least cosine between a photo's axis and the mean one for a single plane, and between a ray and a plane's normal
ONE_WAY, GRAZING = 0.5, 0.2
#: least share of the photos' pixels that must show background
LEAST = 1e-3
#: texels along a side at most, and texels of the grid on which distances are compared
MOST_TEXELS, PROBED = 4096, 64
#: photos, evenly spread, that distances are compared with
PROBING = 12
#: least share of the most texels that two photos show at any distance, for a distance to be compared
COMPARED = 0.5
_CUBE = tuple(sign * np.eye(3)[axis] for axis in range(3) for sign in (1.0, -1.0))


@dataclass(frozen=True, eq=False)
class Background:
    """Far layers, and what they were chosen by.

    Attributes
    ----------
    layers : tuple of LayeredDepthImage
        One sample a texel, in the frame of a camera amid the photos.
    distance : float
        Of the planes from the middle of the photos, scene units.
    spread : float or None
        Mean absolute deviation of the photos there, display code 0 to 1; None = no two photos show the same of it.
    """

    layers: tuple[LayeredDepthImage, ...]
    distance: float
    spread: float | None


def make_background(photos: PhotoSet, mesh: Mesh) -> Background | None:
    """Blend the pixels of all photos that show no surface on far planes.

    Parameters
    ----------
    photos : PhotoSet
        With the mesh's depth; masked pixels take no part.
    mesh : Mesh
        What is known.

    Returns
    -------
    Background or None
        None: hardly any pixel shows background, since masks leave it out or the mesh fills the photos.
    """
    beyond = ~np.isfinite(photos.depth) & (photos.mask >= 0.5)
    if beyond.mean() < LEAST:
        return None
    middle = photos.centers.mean(axis=0)
    reach = float(np.linalg.norm(mesh.vertices[np.unique(mesh.faces)] - middle, axis=1).max())
    normals = _normals(photos)
    some = photos.subset(spread(range(len(photos.cameras)), PROBING))
    agreed = [_spread(some, beyond, middle, normals, share * reach) for share in TRIED]
    which = best_distance(agreed)
    distance = TRIED[which] * reach
    return Background(tuple(_coloured(photos, beyond, middle, normals, distance)), distance, agreed[which][0])


def best_distance(agreed: Sequence[tuple[float | None, int]]) -> int:
    """Choose the distance at which photos agree best, the farthest of equals; the farthest where none can be compared.

    Parameters
    ----------
    agreed : of each distance, ascending, how far photos differ, and in how many texels that two of them show
    """
    enough = COMPARED * max(count for _, count in agreed)
    known = [(n, spread) for n, (spread, count) in enumerate(agreed) if spread is not None and count >= enough]
    if not known:
        return len(agreed) - 1
    return min(known, key=lambda each: (round(each[1], 6), -each[0]))[0]


def _normals(photos: PhotoSet) -> list[Array]:
    """Return the unit directions in which planes lie: the mean axis where no photo turns far from it, else six."""
    axes = np.array([camera.R[2] for camera in photos.cameras])
    mean = axes.mean(axis=0)
    length = float(np.linalg.norm(mean))
    if length > 1e-6 and (axes @ mean / length).min() >= ONE_WAY:
        return [mean / length]
    return list(_CUBE)


def _spread(
    photos: PhotoSet, beyond: Array, middle: Array, normals: list[Array], distance: float
) -> tuple[float | None, int]:
    """Return how far photos differ at planes of this distance, display code, and in how many texels two see them."""
    seen: list[Array] = []
    for frame, placed in _frames(photos, beyond, middle, normals, distance, PROBED):
        points, facing = _points(frame, distance)
        _, deviation, count = placed.diffuse(points, facing)
        seen.append(deviation[count >= 2])
    values = np.concatenate(seen) if seen else np.empty(0)
    return (float(values.mean()) if len(values) else None), len(values)


def _coloured(
    photos: PhotoSet, beyond: Array, middle: Array, normals: list[Array], distance: float
) -> Iterator[LayeredDepthImage]:
    """Yield the layers of all planes that some photo sees."""
    for frame, placed in _frames(photos, beyond, middle, normals, distance, MOST_TEXELS):
        points, facing = _points(frame, distance)
        color, _, count = placed.diffuse(points, facing)
        kept = count > 0
        ends = np.concatenate([[0], np.cumsum(kept)])
        table = ends[:-1].reshape(frame.height, frame.width)
        offsets = np.concatenate([table, ends[frame.width :: frame.width][:, None]], axis=1)
        depth = np.full(int(kept.sum()), distance, np.float32)
        if len(depth):
            yield LayeredDepthImage(frame, offsets, depth, color[kept], facing[kept], count[kept])


def _frames(
    photos: PhotoSet, beyond: Array, middle: Array, normals: list[Array], distance: float, most: int
) -> Iterator[tuple[Camera, PhotoSet]]:
    """Yield, for every plane that is seen, a camera in the middle that covers it, and the photos with its depth."""
    focal = float(np.median([camera.K[0, 0] for camera in photos.cameras]))
    limit = 1.0 if len(normals) > 1 else 1.0 / GRAZING
    for normal in normals:
        R = _axes(normal, photos)
        depth, low, high = photos.depth.copy(), np.full(2, np.inf), np.full(2, -np.inf)
        for p, camera in enumerate(photos.cameras):
            inside = np.flatnonzero(beyond[photos.pixels_of(p)])
            own = int(photos.starts[p]) + inside
            row, column = np.divmod(inside, camera.width)
            rays = camera.pixel_rays(np.stack([column, row], axis=1) + 0.5)
            slope = rays @ normal
            along = (distance - float((camera.center - middle) @ normal)) / np.where(slope > 0, slope, np.nan)
            steep = slope >= GRAZING * np.linalg.norm(rays, axis=1)
            at = (camera.center - middle + rays * along[:, None]) @ R[:2].T / distance
            fits = steep & (along > 0) & (np.abs(at) <= limit + 1e-9).all(axis=1)
            depth[own[fits]] = along[fits]
            if fits.any():
                low, high = np.minimum(low, at[fits].min(axis=0)), np.maximum(high, at[fits].max(axis=0))
        if (high > low).all():
            scale = min(focal, most / float((high - low).max()))
            width, height = (max(2, int(np.ceil(side * scale))) for side in high - low)
            K = np.array([[scale, 0.0, -low[0] * scale], [0.0, scale, -low[1] * scale], [0.0, 0.0, 1.0]])
            pose = np.concatenate([R, -(R @ middle)[:, None]], axis=1)
            yield Camera(K, pose, width, height), replace(photos, depth=depth)


def _axes(normal: Array, photos: PhotoSet) -> Array:
    """Return the rotation (3, 3) of a camera that looks along `normal`, held as the photos were where that tells."""
    down = np.mean([camera.R[1] for camera in photos.cameras], axis=0)
    down = down - (down @ normal) * normal
    if np.linalg.norm(down) < 0.1:
        down = np.eye(3)[int(np.abs(normal).argmin())]
        down = down - (down @ normal) * normal
    down /= np.linalg.norm(down)
    return np.stack([np.cross(down, normal), down, normal])


def _points(frame: Camera, distance: float) -> tuple[Array, Array]:
    """Return the points (N, 3) of a plane's texels, and its normals toward the photos."""
    points = frame.center + distance * frame.pixel_rays().reshape(-1, 3)
    return points, np.broadcast_to(-frame.R[2].astype(np.float32), points.shape).copy()
