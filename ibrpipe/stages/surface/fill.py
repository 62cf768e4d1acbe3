"""What no depth map shows is closed by the outlines: which of their points lie on the outside of what was seen."""

from __future__ import annotations

import numpy as np

from ibrpipe.embree import MeshCaster
from ibrpipe.stages.surface.finish import evidence, vertex_normals
from ibrpipe.stages.surface.fusion import Cloud, joined
from ibrpipe.stages.surface.maps import MapStore
from ibrpipe.types import Array, Mesh

#: directions that are tried from every point
RAYS = 32
#: least cosine between a direction and the point's normal
OUTWARD = 0.2
#: points asked at a time
_AT_A_TIME = 50_000


def with_outlines(cloud: Cloud, maps: MapStore, seen: Mesh, hull: Mesh, step: float) -> Cloud:
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
    directions, inside = _directions(RAYS), np.zeros(len(points), bool)
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


def _directions(count: int) -> Array:
    """Even directions on the sphere, (count, 3) float64, on a spiral by the golden angle."""
    z = 1 - (2 * np.arange(count) + 1) / count
    angle = np.pi * (3 - 5**0.5) * np.arange(count)
    return np.stack([np.sqrt(1 - z**2) * np.cos(angle), np.sqrt(1 - z**2) * np.sin(angle), z], axis=1)
