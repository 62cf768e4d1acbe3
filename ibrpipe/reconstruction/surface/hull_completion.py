"""Completion by the visual hull: where masks require surface that depth maps do not show, and where no depth is.

The ray through a pixel inside a mask meets the object. Where it misses what depth maps show and passes the outlines'
hull in one short piece, the surface lies on that piece, and the hull is near it. Depth on which maps agree is wrong
behind such a place: the image of a lamp in a coat lies behind the coat, and all photos agree on it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ibrpipe.core.directions import spread_directions
from ibrpipe.embree import MeshCaster
from ibrpipe.progress import Step
from ibrpipe.reconstruction.depth.evidence import evidence
from ibrpipe.reconstruction.depth.fusion import Cloud, joined
from ibrpipe.reconstruction.depth.map_store import MapStore
from ibrpipe.reconstruction.surface.mesh_operations import vertex_normals
from ibrpipe.reconstruction.surface.silhouettes import Outline
from ibrpipe.types import Array, Mesh

MASKS = Step("masks", 0.1)
#: pixels inside an outline from which on a ray must meet the object
INSIDE = 0.75
#: longest path through the hull that still tells where the surface is, pixels
LONGEST = 10.0
#: points on it that are looked at
_SAMPLES = 9
#: voxels around it within which the hull is asked for
_AROUND = 1.2
#: voxels behind the hull from which on a point is wrong, and up to which it is taken for the same surface
BEHIND, DEEPEST = 1.0, 10.0
#: least cosine between the normals of a wrong point and of the hull
_SAME_SIDE = 0.3
#: directions that are tried from every point
RAYS = 32
#: least cosine between a direction and the point's normal
OUTWARD = 0.2
#: points asked at a time
_AT_A_TIME = 50_000


@dataclass(frozen=True, eq=False)
class MaskCompletion:
    """A cloud completed by what the masks require.

    Attributes
    ----------
    cloud : Cloud
    required : (P, 3) float64
        Vertices of the hull that the masks require.
    missed : float
        Share of the masks' pixels whose rays miss what depth maps show.
    behind : int
        Points left out because they lie behind those.
    """

    cloud: Cloud
    required: Array
    missed: float
    behind: int

    @property
    def measured(self) -> dict[str, float]:
        """Figures for ``geometry.json``."""
        return {
            "masks_missed": round(self.missed, 4),
            "points_asked": len(self.required),
            "points_behind": self.behind,
        }


def complete_by_masks(cloud: Cloud, seen: Mesh, hull: Mesh, outlines: Sequence[Outline], step: float) -> MaskCompletion:
    """Add the surface that the masks require, and leave out the points behind it.

    Masks that points contradict require nothing.

    Parameters
    ----------
    cloud : Cloud
    seen : Mesh
        What the maps show, with holes.
    hull : Mesh
        What the outlines leave.
    outlines : sequence of Outline
    step : float
        Size of a voxel, scene units.
    """
    from scipy.spatial import cKDTree

    required, missed = required_by_masks(seen, hull, [each for each in outlines if not each.contradicted], step)
    if not required.any():
        return MaskCompletion(cloud, hull.vertices[:0], missed, 0)
    normals = vertex_normals(hull)
    distance, nearest = cKDTree(hull.vertices).query(cloud.position)
    above = ((cloud.position - hull.vertices[nearest]) * normals[nearest]).sum(axis=1)
    same_side = (cloud.normal * normals[nearest]).sum(axis=1) > _SAME_SIDE
    wrong = required[nearest] & (above < -BEHIND * step) & (distance < DEEPEST * step) & same_side
    rest, points = cloud.chosen(~wrong), hull.vertices[required]
    new = np.ones(len(points), bool)
    if len(rest.position):
        new = ~np.isfinite(cKDTree(rest.position).query(points, distance_upper_bound=1.5 * step)[0])
    count = int(new.sum())
    spacing, none = np.full(count, step, np.float32), np.zeros(count, np.float32)
    added = Cloud(points[new], normals[required][new], none, np.zeros(count, np.int32), spacing)
    return MaskCompletion(joined([rest, added]), points, missed, int(wrong.sum()))


def required_by_masks(seen: Mesh, hull: Mesh, outlines: Sequence[Outline], step: float) -> tuple[Array, float]:
    """Return which vertices of the hull (V,) bool masks require, and the share of their pixels that miss `seen`."""
    from scipy.spatial import cKDTree

    surface, bound = MeshCaster(seen), MeshCaster(hull)
    required, missed, pixels = np.zeros(len(hull.vertices), bool), 0, 0
    for each in MASKS.track(outlines):
        row, column = np.nonzero(each.distance < -INSIDE)
        rays = each.camera.pixel_rays(np.stack([column, row], axis=1) + 0.5)
        open_rays = rays[surface.cast(each.camera.center, rays).face < 0]
        missed, pixels = missed + len(open_rays), pixels + len(rays)
        points = _pieces(bound, each, open_rays)
        if len(points):
            near, _ = cKDTree(points).query(hull.vertices, distance_upper_bound=_AROUND * step)
            required |= np.isfinite(near)
    return required, missed / max(pixels, 1)


def _pieces(bound: MeshCaster, outline: Outline, rays: Array) -> Array:
    """Points (P, 3) along the rays (N, 3) that pass the hull once and shortly."""
    center = outline.camera.center
    ray, hits = bound.cast_all(np.broadcast_to(center, rays.shape), rays)
    count = np.bincount(ray, minlength=len(rays))
    once = np.nonzero(count == 2)[0]
    first = (np.cumsum(count) - count)[once]
    enter, leave = hits.t[first].astype(np.float64), hits.t[first + 1].astype(np.float64)
    short = (leave - enter) * outline.camera.K[0, 0] < LONGEST * enter
    enter, leave, rays = enter[short], leave[short], rays[once[short]]
    along = [center + (enter + share * (leave - enter))[:, None] * rays for share in np.linspace(0, 1, _SAMPLES)]
    return np.concatenate(along)


def complete_by_hull(cloud: Cloud, maps: MapStore, seen: Mesh, hull: Mesh, step: float) -> Cloud:
    """Add the outlines' surface to the points that depth maps show.

    A point of it counts where no point of the cloud is near, no map looks through it, and it does not lie inside of the
    surface that was seen: masks that lose parts of the object make outlines that run through the body.

    Parameters
    ----------
    cloud : Cloud
    maps : MapStore
    seen : Mesh
        What the maps show, with holes.
    hull : Mesh
        What the outlines leave.
    step : float
        Size of a voxel, scene units.
    """
    from scipy.spatial import cKDTree

    found = evidence(hull, maps, 2.0 * step)
    far = ~np.isfinite(cKDTree(cloud.position).query(hull.vertices, distance_upper_bound=6 * step)[0])
    chosen = np.nonzero(far & (found.through == 0) & (found.observations == 0))[0]
    normals = vertex_normals(hull)
    chosen = chosen[~behind(MeshCaster(seen), hull.vertices[chosen], normals[chosen])]
    added = Cloud(
        hull.vertices[chosen],
        normals[chosen],
        np.zeros(len(chosen), np.float32),
        np.zeros(len(chosen), np.int32),
        np.full(len(chosen), step, np.float32),
    )
    return joined([cloud, added])


def behind(seen: MeshCaster, points: Array, normals: Array) -> Array:
    """Say which points (N, 3) lie behind a surface: most rays that leave along the normal meet its back."""
    directions, inside = spread_directions(RAYS), np.zeros(len(points), bool)
    for first in range(0, len(points), _AT_A_TIME):
        part = slice(first, first + _AT_A_TIME)
        outward = normals[part] @ directions.T > OUTWARD
        row, ray = np.nonzero(outward)
        hits = seen.cast(points[part][row], directions[ray])
        met = hits.face >= 0
        back = met & ((hits.normal * directions[ray]).sum(axis=1) > 0)
        count = [np.bincount(row, each, outward.shape[0]) for each in (back, outward[row, ray])]
        inside[part] = 2 * count[0] > count[1]
    return inside
