"""Relief-mapped triangle meshes: what the renderer `relief` takes beside height fields (policarpo2005)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from ibrpipe.errors import ShapeError, ValueRangeError
from ibrpipe.types.arrays import Array, check_color, contiguous
from ibrpipe.types.mesh import Mesh

EDGES = ("wrap", "cut")


@dataclass(frozen=True, eq=False)
class ReliefMesh:
    """A triangle mesh whose polygons carry a relief below them.

    Attributes
    ----------
    mesh : Mesh
        Counter-clockwise faces are seen from outside.
    uv : (F, 3, 2) float64
        Texture coordinates of every face corner: u along the texture's columns, v along its rows (downward), (0, 0) its
        outer corner, (1, 1) the opposite one; the texture goes on beyond them as `edges` says.
    height : (H, W) float32
        0 = deepest, 1 = on the polygon; bilinear between texel centres.
    thickness : float
        From height 0 to height 1, scene units, along the normal.
    back : (H, W) float32 or None
        Heights of the object's back: only what lies between it and `height` is solid (dual depth, sec. 4). Where it is
        greater than `height` there is nothing.
    color : (H, W, 3) float32, linear, or None = white. Its size may be another one.
    normal : (H, W, 3) float32, or None = from the heights
        Unit normals along u, along v and out of the polygon. Its size may be another one.
    edges : {"wrap", "cut"}
        The texture is tiled, or there is nothing outside it.
    normals : (F, 3, 3) float32 or None
        Unit normal of every face corner; None = averaged over the faces that bend less than 40 degrees.
    tangents : (F, 3, 3) float32 or None
        Direction of u at every face corner; None = from `uv`.

    Raises
    ------
    ShapeError, ValueRangeError
        Shapes do not fit; heights that are NaN or outside 0 to 1; a thickness that is not positive.
    """

    mesh: Mesh
    uv: Array
    height: Array
    thickness: float
    back: Array | None = None
    color: Array | None = None
    normal: Array | None = None
    edges: str = "wrap"
    normals: Array | None = None
    tangents: Array | None = None

    def __repr__(self) -> str:
        """Return the mesh and the size of its relief."""
        return f"ReliefMesh({self.mesh}, relief {self.height.shape[1]} x {self.height.shape[0]})"

    def __post_init__(self) -> None:
        count = len(self.mesh.faces)
        uv = contiguous("uv", self.uv, np.float64, 3)
        if uv.shape != (count, 3, 2):
            raise ShapeError(f"uv must be ({count}, 3, 2), one pair for every face corner, got {uv.shape}")
        if not np.isfinite(uv).all() or np.abs(uv).max() > 1e6:
            raise ValueRangeError("uv holds NaN, infinity or numbers above a million; map the mesh again")
        height = _heights("height", self.height)
        back = None if self.back is None else _heights("back", self.back)
        if back is not None and back.shape != height.shape:
            raise ShapeError(f"back must be as large as height {height.shape}, got {back.shape}")
        if not (np.isfinite(self.thickness) and self.thickness > 0):
            raise ValueRangeError(f"thickness is {self.thickness}; give a positive length in scene units")
        if self.edges not in EDGES:
            raise ValueRangeError(f"edges is {self.edges!r}; choose among: {', '.join(EDGES)}")
        for name, value in (("uv", uv), ("height", height), ("back", back), ("thickness", float(self.thickness))):
            object.__setattr__(self, name, value)
        for name in ("color", "normal"):
            if getattr(self, name) is not None:
                picture = contiguous(name, getattr(self, name), np.float32, 3)
                if picture.shape[2:] != (3,) or picture.size == 0:
                    raise ShapeError(f"{name} must be (H, W, 3), got {picture.shape}")
                object.__setattr__(self, name, picture)
        if self.color is not None:
            check_color(self.color)
        if self.normal is not None and not np.isfinite(self.normal).all():
            raise ValueRangeError("normal holds NaN or infinity; export the normal map again")
        for name in ("normals", "tangents"):
            if getattr(self, name) is not None:
                vectors = contiguous(name, getattr(self, name), np.float32, 3)
                if vectors.shape != (count, 3, 3) or not np.isfinite(vectors).all():
                    raise ShapeError(f"{name} must be ({count}, 3, 3), finite, got {vectors.shape}")
                object.__setattr__(self, name, vectors)

    def with_vertices(self, vertices: ArrayLike) -> ReliefMesh:
        """Return the same relief on a deformed mesh; given normals and tangents are made anew."""
        return replace(self, mesh=Mesh(np.asarray(vertices), self.mesh.faces), normals=None, tangents=None)


def _heights(name: str, value: ArrayLike) -> Array:
    heights = contiguous(name, value, np.float32, 2)
    if heights.size == 0:
        raise ShapeError(f"{name} has no texels, got shape {heights.shape}")
    if not (np.isfinite(heights).all() and heights.min() >= 0.0 and heights.max() <= 1.0):
        bad = heights[~((heights >= 0) & (heights <= 1))].flat[0]
        raise ValueRangeError(
            f"{name} holds {bad}; heights run from 0 (deepest) to 1 (on the polygon): scale them, for files by a range"
        )
    return heights
