"""Fewer triangles where a surface is flat (garland1997), as Open3D does it."""

from __future__ import annotations

import numpy as np

from ibrpipe.native_imports import import_open3d
from ibrpipe.types import Array, Mesh, PaintedMesh

#: how much more it costs to move an edge where the surface ends
BOUNDARY = 1.0
#: charts of fewer triangles stay as they are
FEWEST = 8
#: triangles that are left of a chart at least: one alone is half of a small rectangle
LEAST = 2


def decimate(vertices: Array, faces: Array, tolerance: float, texel: float) -> tuple[Array, Array]:
    """Join triangles as long as the surface moves by about `tolerance` at most.

    Parameters
    ----------
    vertices, faces : (V, 3) float64, (F, 3) int32
    tolerance : float
        Texels; 0 = nothing is joined.
    texel : float
        Width of a texel, scene units.

    Returns
    -------
    vertices, faces : as given
    """
    if tolerance <= 0 or len(faces) < FEWEST:
        return vertices, faces
    o3d = import_open3d()
    shift = vertices.mean(axis=0)
    full = o3d.geometry.TriangleMesh(
        o3d.utility.Vector3dVector((vertices - shift) / texel), o3d.utility.Vector3iVector(faces)
    )
    small = full.simplify_quadric_decimation(LEAST, maximum_error=tolerance**2, boundary_weight=BOUNDARY)
    small.remove_degenerate_triangles()
    small.remove_unreferenced_vertices()
    if not len(small.triangles):
        return vertices, faces
    return np.asarray(small.vertices) * texel + shift, np.asarray(small.triangles, dtype=np.int32)


def at_most(painted: PaintedMesh, most: int, values: Array | None = None) -> tuple[PaintedMesh, Array | None]:
    """Join triangles of a mesh until about `most` are left; one with fewer stays as it is.

    Parameters
    ----------
    painted : PaintedMesh
    most : int
    values : (V,), optional
        More that is known of the vertices.

    Returns
    -------
    painted, values : as given
        Colours and values are those of the nearest vertex that there was.
    """
    from scipy.spatial import cKDTree

    if len(painted.mesh.faces) <= most:
        return painted, values
    o3d, full = import_open3d(), painted.mesh
    shift, scale = full.vertices.mean(axis=0), float(np.ptp(full.vertices, axis=0).max()) or 1.0
    joined = o3d.geometry.TriangleMesh(
        o3d.utility.Vector3dVector((full.vertices - shift) / scale), o3d.utility.Vector3iVector(full.faces)
    ).simplify_quadric_decimation(most)
    joined.remove_degenerate_triangles()
    joined.remove_unreferenced_vertices()
    vertices = np.asarray(joined.vertices) * scale + shift
    nearest = cKDTree(full.vertices).query(vertices, workers=-1)[1]
    mesh = Mesh(vertices, np.asarray(joined.triangles, dtype=np.int32))
    left = PaintedMesh(mesh, painted.color[nearest], painted.specular, painted.shininess)
    return left, None if values is None else values[nearest]
