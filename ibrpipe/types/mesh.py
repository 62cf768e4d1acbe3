"""Triangle meshes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ibrpipe.errors import ShapeError, ValueRangeError
from ibrpipe.types.arrays import Array, contiguous


@dataclass(frozen=True, eq=False)
class Mesh:
    """A triangle mesh in world units.

    Attributes
    ----------
    vertices : (V, 3) float64
    faces : (F, 3) int32, counter-clockwise seen from outside
    """

    vertices: Array
    faces: Array

    def __repr__(self) -> str:
        """Return how many vertices and triangles there are."""
        return f"Mesh({len(self.vertices)} vertices, {len(self.faces)} triangles)"

    def __post_init__(self) -> None:
        vertices, faces = (
            contiguous("vertices", self.vertices, np.float64, 2),
            contiguous("faces", self.faces, np.int32, 2),
        )
        if vertices.shape[1:] != (3,) or faces.shape[1:] != (3,):
            raise ShapeError(f"vertices and faces must be (N, 3), got {vertices.shape} and {faces.shape}")
        if len(faces) == 0:
            raise ShapeError("the mesh has no faces; give a surface, not a point cloud")
        if not np.isfinite(vertices).all():
            raise ValueRangeError("the mesh has vertices that are NaN or infinite; repair it")
        if faces.min() < 0 or faces.max() >= len(vertices):
            raise ValueRangeError(f"a face names vertex {faces.max()} of {len(vertices)}; the mesh file is damaged")
        object.__setattr__(self, "vertices", vertices)
        object.__setattr__(self, "faces", faces)
