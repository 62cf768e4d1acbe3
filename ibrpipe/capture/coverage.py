"""Which photos see which part of a surface, at points spread evenly over it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ibrpipe.core.normals import face_normals
from ibrpipe.embree import MeshCaster
from ibrpipe.errors import CaptureError
from ibrpipe.types import Array, Camera, Mesh

#: A surface seen flatter than this (cosine of 80 degrees off its normal) tells no colour
GRAZING = 0.1736
#: Rays start this far from the surface, as a share of the mesh's diagonal
LIFT = 1e-4
#: Additive recurrence of the plastic number: even in two dimensions for any count (R2 sequence)
_R2 = (0.7548776662466927, 0.5698402909980532)


@dataclass(frozen=True, eq=False)
class SurfacePoints:
    """Points spread over a mesh, every one standing for the same area.

    Attributes
    ----------
    position, normal : (N, 3) float64
        World; normals unit, on the counter-clockwise side.
    diagonal : float
        Of the mesh's bounding box, scene units.
    """

    position: Array
    normal: Array
    diagonal: float


def spread_points(mesh: Mesh, count: int) -> SurfacePoints:
    """Spread `count` points evenly by area; the same mesh gives the same points.

    Raises
    ------
    CaptureError
        All faces are degenerate.
    """
    normal = face_normals(mesh.vertices, mesh.faces)
    doubled = np.linalg.norm(normal, axis=1)
    total = np.cumsum(doubled)
    if not total[-1] > 0:
        raise CaptureError(f"all {len(mesh.faces)} faces of the mesh have no area; export the surface again")
    face = np.searchsorted(total, (np.arange(count) + 0.5) / count * total[-1])
    first, second = ((0.5 + np.arange(1, count + 1) * step) % 1.0 for step in _R2)
    flipped = first + second > 1.0
    first, second = np.where(flipped, 1.0 - first, first), np.where(flipped, 1.0 - second, second)
    corner = mesh.vertices[mesh.faces[face]]
    position = corner[:, 0] + first[:, None] * (corner[:, 1] - corner[:, 0])
    position += second[:, None] * (corner[:, 2] - corner[:, 0])
    diagonal = float(np.linalg.norm(np.ptp(mesh.vertices, axis=0)))
    return SurfacePoints(position, normal[face] / doubled[face][:, None], diagonal)


def seen_points(points: SurfacePoints, camera: Camera, mask: Array, caster: MeshCaster) -> Array:
    """Say which points a photo sees from either side: inside picture and mask, not too flat, nothing in between.

    Parameters
    ----------
    points : SurfacePoints
    camera : Camera
    mask : (H, W) float32
        Coverage of the photo.
    caster : MeshCaster
        Of the mesh that the points lie on.

    Returns
    -------
    (N,) bool
    """
    local = points.position @ camera.R.T + camera.t
    ahead = local[:, 2] > 1e-9 * points.diagonal
    with np.errstate(divide="ignore", invalid="ignore"):
        pixel = (local @ camera.K.T)[:, :2] / local[:, 2:]
    size = np.array([camera.width, camera.height])
    candidate = ahead & (pixel >= 0).all(axis=1) & (pixel < size).all(axis=1)
    column, row = np.where(candidate[:, None], pixel, 0).astype(np.int64).T
    candidate &= mask[row, column] >= 0.5
    towards = camera.center - points.position
    distance = np.linalg.norm(towards, axis=1)
    facing = (towards * points.normal).sum(axis=1)
    candidate &= np.abs(facing) > GRAZING * distance
    index = np.flatnonzero(candidate)
    if len(index):
        side = np.where(facing[index, None] < 0, -1.0, 1.0) * points.normal[index]
        start = points.position[index] + LIFT * points.diagonal * side
        candidate[index] = ~caster.occluded(start, camera.center - start, 0.0, 1.0)
    return candidate


def agreement(camera: Camera, mask: Array, caster: MeshCaster, side: int = 160) -> tuple[float, float, float]:
    """Compare a mesh's outline with a photo's mask on a small picture.

    Returns
    -------
    overlap : float
        Area of intersection over union; NaN where both are empty.
    backs : float
        Share of the mesh's visible pixels that show the back of a face; NaN where none is visible.
    inverse : float
        As `overlap`, for what the mask leaves out.
    """
    scale = min(1.0, side / max(camera.width, camera.height))
    small = camera.resized(max(1, round(camera.width * scale)), max(1, round(camera.height * scale)))
    hits = caster.cast_camera(small)
    met = hits.face >= 0
    rows = ((np.arange(small.height) + 0.5) / small.height * mask.shape[0]).astype(np.int64)
    columns = ((np.arange(small.width) + 0.5) / small.width * mask.shape[1]).astype(np.int64)
    wanted = mask[rows][:, columns] >= 0.5
    overlap, inverse = _overlap(met, wanted), _overlap(met, ~wanted)
    backs = (small.pixel_rays()[met] * hits.normal[met]).sum(axis=-1) > 0
    return overlap, float(backs.mean()) if met.any() else float("nan"), inverse


def _overlap(one: Array, two: Array) -> float:
    union = (one | two).sum()
    return float((one & two).sum() / union) if union else float("nan")
