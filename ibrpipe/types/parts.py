"""What scenes are built of: painted meshes, and parts that hold copies of other parts (max1999, sec. 2)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ibrpipe.errors import ShapeError, ValueRangeError
from ibrpipe.types.arrays import Array, check_color, contiguous
from ibrpipe.types.mesh import Mesh
from ibrpipe.types.renderable import Captured


@dataclass(frozen=True, eq=False)
class PaintedMesh:
    """A triangle mesh with colours at its vertices; seen and lit from both sides.

    Attributes
    ----------
    mesh : Mesh
        In the coordinates of its part.
    color : (V, 3) float32, linear
        Diffuse albedo at the vertices, interpolated over the faces.
    specular : float
        Strength of the highlight (Blinn-Phong), 0 = matt.
    shininess : float
        Its exponent.
    """

    mesh: Mesh
    color: Array
    specular: float = 0.0
    shininess: float = 32.0

    def __repr__(self) -> str:
        """Return the mesh and its shininess."""
        return f"PaintedMesh({self.mesh}, {'matt' if self.specular == 0 else 'shiny'})"

    def __post_init__(self) -> None:
        color = contiguous("color", self.color, np.float32, 2)
        if color.shape != (len(self.mesh.vertices), 3):
            raise ShapeError(f"color must be ({len(self.mesh.vertices)}, 3), one for every vertex, got {color.shape}")
        check_color(color)
        for name, least, most in (("specular", 0.0, 1e4), ("shininess", 1.0, 1e4)):
            if not least <= getattr(self, name) <= most:
                raise ValueRangeError(f"{name} is {getattr(self, name)}; give a number from {least:g} to {most:g}")
        object.__setattr__(self, "color", color)


@dataclass(frozen=True, eq=False)
class Instances:
    """Copies of one part.

    Attributes
    ----------
    part : str
        Name of the part that is copied.
    matrices : (N, 4, 4) float64
        Affine, from the coordinates of `part` to those of the part that holds the copies; one (4, 4) matrix is taken
        as N = 1. They may mirror, shear, or flatten (singular).

    Raises
    ------
    ShapeError, ValueRangeError
        Another shape, NaN or infinity, or a last row that is not 0 0 0 1.
    """

    part: str
    matrices: Array

    def __repr__(self) -> str:
        """Return how many copies of what there are."""
        return f"Instances({len(self.matrices)} of {self.part!r})"

    def __post_init__(self) -> None:
        given = np.asarray(self.matrices, dtype=np.float64)
        matrices = contiguous("matrices", given[None] if given.ndim == 2 else given, np.float64, 3)
        if matrices.shape[1:] != (4, 4):
            raise ShapeError(f"matrices of {self.part!r} must be (N, 4, 4), got {matrices.shape}")
        bad = ~np.isfinite(matrices).all(axis=(1, 2))
        if bad.any():
            raise ValueRangeError(
                f"matrix {int(bad.argmax())} of {self.part!r} holds NaN or infinity; repair the scene"
            )
        bad = (matrices[:, 3] != (0.0, 0.0, 0.0, 1.0)).any(axis=1)
        if bad.any():
            row = matrices[bad.argmax(), 3].tolist()
            raise ValueRangeError(
                f"matrix {int(bad.argmax())} of {self.part!r} ends in row {row}; copies are placed by affine matrices, "
                "whose last row is 0 0 0 1"
            )
        object.__setattr__(self, "matrices", matrices)

    def __len__(self) -> int:
        return len(self.matrices)


@dataclass(frozen=True, eq=False)
class Part:
    """A thing that is drawn, and the copies of other parts that belong to it.

    Attributes
    ----------
    name : str
    meshes : tuple of PaintedMesh
    sources : tuple
        Captured assets, textures and relief meshes, in the part's coordinates.
    children : tuple of Instances
    """

    name: str
    meshes: tuple[PaintedMesh, ...] = ()
    sources: tuple[Captured, ...] = ()
    children: tuple[Instances, ...] = ()

    def __repr__(self) -> str:
        """Return the name and what belongs to it."""
        return (
            f"Part({self.name!r}, {len(self.meshes)} meshes, {len(self.sources)} captured, "
            f"{sum(map(len, self.children))} copies)"
        )

    def __post_init__(self) -> None:
        if not self.name or self.name != self.name.strip() or "/" in self.name:
            raise ValueRangeError(f"a part is called {self.name!r}; give a name without / and outer blanks")
        for name in ("meshes", "sources", "children"):
            object.__setattr__(self, name, tuple(getattr(self, name)))
