"""Surface of oriented points by screened Poisson reconstruction (kazhdan2013), as Open3D does it."""

from __future__ import annotations

import numpy as np

from ibrpipe.errors import CaptureError
from ibrpipe.native_imports import import_open3d
from ibrpipe.reconstruction.depth.fusion import Cloud
from ibrpipe.types import Array, Mesh

#: bytes that a point takes while Open3D solves; 2600 were the most met (docs/stages/geometry.md)
POINT_BYTES = 3000


def poisson_surface(cloud: Cloud, step: float, memory: int) -> tuple[Mesh, float]:
    """Reconstruct; the surface is closed, invented where there are no points.

    One thread: only then does the same input give the same bytes.

    Parameters
    ----------
    cloud : Cloud
    step : float
        Points closer than this are averaged, scene units; the octree's cells are about as large.
    memory : int
        Bytes; the step grows until the points fit.

    Returns
    -------
    Mesh, float
        And the step that was used.

    Raises
    ------
    CaptureError
        Too few points.
    """
    if len(cloud.position) < 100:
        raise CaptureError(f"only {len(cloud.position)} points agree between photos; Poisson needs 100 at least")
    o3d, most = import_open3d(), max(memory // POINT_BYTES, 1000)
    shift = cloud.position.mean(axis=0)
    position, normal = thinned(cloud.position - shift, cloud.normal, step)
    while len(position) > most:
        step *= 1.05 * (len(position) / most) ** 0.5
        position, normal = thinned(cloud.position - shift, cloud.normal, step)
    points = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(position))
    points.normals = o3d.utility.Vector3dVector(normal)
    extent = float(np.ptp(cloud.position, axis=0).max()) * 1.1
    depth = int(np.clip(np.ceil(np.log2(extent / step) - 0.3), 5, 11))
    found, _ = o3d.geometry.TriangleMesh.create_from_point_cloud_poisson(points, depth=depth, n_threads=1)
    return Mesh(np.asarray(found.vertices) + shift, np.asarray(found.triangles, dtype=np.int32)), step


def thinned(position: Array, normal: Array, step: float) -> tuple[Array, Array]:
    """Average the points and normals of every voxel of size `step`; points whose normals cancel are left out."""
    cell = np.floor((position - position.min(axis=0)) / step).astype(np.int64)
    size = cell.max(axis=0) + 1
    _, owner, count = np.unique(
        (cell[:, 0] * size[1] + cell[:, 1]) * size[2] + cell[:, 2], return_inverse=True, return_counts=True
    )
    mean = [np.bincount(owner, values, len(count)) / count for values in (*position.T, *normal.T.astype(np.float64))]
    length = np.linalg.norm(np.stack(mean[3:]), axis=0)
    kept = length > 0.3
    return np.stack(mean[:3], axis=1)[kept], (np.stack(mean[3:]) / np.maximum(length, 1e-12)).T[kept]
