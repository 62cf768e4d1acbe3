"""Triangle meshes, and their colours: at the corners of faces, times textures."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ibrpipe.errors import ShapeError, ValueRangeError
from ibrpipe.types.arrays import Array, check_color, contiguous


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


@dataclass(frozen=True, eq=False)
class MeshColors:
    """Diffuse colour of every face of a mesh: what its corners say, times its texture.

    Attributes
    ----------
    corner : (F, 3, 3) float32, linear
        Colour of each corner, interpolated over the face; 1 where the texture says all.
    uv : (F, 3, 2) float64 or None
        Texture coordinates of each corner: u along the columns, v along the rows (downward), (1, 1) the outer corner.
    textures : tuple of (H, W, 3) float32, linear
    texture : (F,) int32 or None
        Index of each face's texture; -1 = none. None: the first texture everywhere, or none where there is none.
    wraps : bool
        Textures are repeated beyond their rectangle; otherwise their border goes on.

    Raises
    ------
    ShapeError, ValueRangeError
        Shapes do not fit, or colours and coordinates are no numbers.
    """

    corner: Array
    uv: Array | None = None
    textures: tuple[Array, ...] = ()
    texture: Array | None = None
    wraps: bool = True

    def __repr__(self) -> str:
        """Return how many faces and textures there are."""
        return f"MeshColors({len(self.corner)} faces, {len(self.textures)} textures)"

    def __post_init__(self) -> None:
        corner = contiguous("corner", self.corner, np.float32, 3)
        if corner.shape[1:] != (3, 3):
            raise ShapeError(f"corner must be (F, 3, 3), a colour for every face corner, got {corner.shape}")
        check_color(corner)
        textures = tuple(contiguous("texture", each, np.float32, 3) for each in self.textures)
        for each in textures:
            if each.shape[2:] != (3,) or each.size == 0:
                raise ShapeError(f"a texture must be (H, W, 3), got {each.shape}")
            check_color(each)
        count = len(corner)
        texture = np.full(count, 0 if textures else -1) if self.texture is None else self.texture
        texture = contiguous("texture", texture, np.int32, 1)
        if texture.shape != (count,) or (count and not -1 <= texture.min() <= texture.max() < len(textures)):
            raise ShapeError(f"texture must be ({count},), from -1 to {len(textures) - 1}, got {texture.shape}")
        uv = np.zeros((count, 3, 2)) if self.uv is None and textures else self.uv
        if uv is not None:
            uv = contiguous("uv", uv, np.float64, 3)
            if uv.shape != (count, 3, 2):
                raise ShapeError(f"uv must be ({count}, 3, 2), one pair for every face corner, got {uv.shape}")
            if not np.isfinite(uv).all() or np.abs(uv).max(initial=0.0) > 1e6:
                raise ValueRangeError("uv holds NaN, infinity or numbers above a million; map the mesh again")
        for name, value in (("corner", corner), ("textures", textures), ("texture", texture), ("uv", uv)):
            object.__setattr__(self, name, value)
