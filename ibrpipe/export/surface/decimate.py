"""Fewer triangles where a surface is flat (garland1997), as Open3D does it."""

from __future__ import annotations

import numpy as np

from ibrpipe.native_imports import import_open3d
from ibrpipe.types import Array

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
