"""What changes with the view direction: components of textures, of one kind each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, Protocol, runtime_checkable

import numpy as np

from ibrpipe.errors import ShapeError, ValueRangeError
from ibrpipe.types.arrays import Array
from ibrpipe.types.camera import ParallelFrame


class SharedData(Protocol):
    """What the components of one kind hold together, once for all textures of an asset."""

    @property
    def bytes(self) -> int:
        """Bytes held in memory."""


@runtime_checkable
class ViewDependence(Protocol):
    """One way in which the colour of a texture changes with the view: the immutable data of a component.

    How it is stored, drawn and fitted belongs to its kind (:mod:`ibrpipe.io.components`).
    """

    @property
    def kind(self) -> str:
        """Name under which the kind is registered."""

    @property
    def bytes(self) -> int:
        """Bytes held in memory, without what is shared."""

    @property
    def shared(self) -> SharedData | None:
        """The one object that all components of the kind refer to within an asset; None = each stands alone."""
        return None


def check_components(components: Sequence[ViewDependence]) -> tuple[ViewDependence, ...]:
    """Return the components as a tuple.

    Raises
    ------
    ShapeError
        One is no view dependence.
    ValueRangeError
        Two are of one kind.
    """
    if isinstance(components, ViewDependence):
        raise ShapeError(f"components must be a tuple, got one {type(components).__name__}; put it into a tuple")
    for component in components:
        if not isinstance(component, ViewDependence):
            raise ShapeError(
                f"a component must have kind, bytes and shared (ViewDependence), got {type(component).__name__}"
            )
    kinds = [component.kind for component in components]
    twice = sorted({kind for kind in kinds if kinds.count(kind) > 1})
    if twice:
        raise ValueRangeError(f"two components of kind {twice[0]!r}; a texture takes one of each kind: join them")
    return tuple(components)


@dataclass(frozen=True, eq=False)
class SpiralResiduals(ViewDependence):
    """View-dependent half of a spiral texture: one residual image per spiral direction (gong-yang, sec. 4.2).

    Image i samples the support rectangle along ``directions[i]`` with its own size; texel (0, 0)'s outer corner is the
    rectangle's outer corner, whatever the size.

    Attributes
    ----------
    rectangle : ParallelFrame
        Its ``a`` and ``b`` are the *whole* edges of the support rectangle, orthogonal, and ``f`` is normal to both.
    k : float
        Spiral density: adjacent turns are 2 k pi apart.
    alphas : (n,) float64
        Spiral parameter of every image, ascending.
    directions : (n, 3) float64
        Unit vectors in the rectangle's frame (along a, b, -f), pointing away from the object.
    sizes : (n, 2) int32
        Height and width of every image.
    starts : (n + 1,) int64
        Image i owns texels ``starts[i]`` to ``starts[i + 1]``, row-major.
    texels : (T, 3) uint8 or float32
        uint8: sRGB-coded colour minus sRGB-coded diffuse colour plus `zero`. float32: linear colour minus diffuse.
    valid : (T,) bool
        False where the ray hits nothing or no photo sees what it hits.
    zero : int
        Code of a residual of nothing (uint8 texels only).
    closed : bool
        The spiral has its closing turn along the horizon.
    """

    kind: ClassVar[str] = "spiral"

    rectangle: ParallelFrame
    k: float
    alphas: Array
    directions: Array
    sizes: Array
    starts: Array
    texels: Array
    valid: Array
    zero: int = 32
    closed: bool = True

    def __post_init__(self) -> None:
        if not 0 < self.k <= 1:
            raise ValueRangeError(f"k is {self.k}; it must lie in (0, 1]")
        basis = self.rectangle.world_from_local / np.linalg.norm(self.rectangle.world_from_local, axis=0)
        if np.abs(basis.T @ basis - np.eye(3)).max() > 1e-6:
            raise ValueRangeError("the support rectangle of residuals must have right angles, f normal to it")
        n = len(self.directions)
        areas = np.asarray(self.sizes, np.int64).prod(axis=1) if n else np.zeros(0, np.int64)
        if np.shape(self.starts) != (n + 1,) or (np.diff(self.starts) != areas).any():
            raise ShapeError("starts must step by each image's height * width")
        if self.texels.shape != (int(self.starts[-1]), 3) or self.valid.shape != (int(self.starts[-1]),):
            raise ShapeError(f"texels and valid must hold {int(self.starts[-1])} texels, got {self.texels.shape}")
        if self.texels.dtype not in (np.uint8, np.float32):
            raise ShapeError(f"texels must be uint8 or float32, got {self.texels.dtype}")

    @property
    def bytes(self) -> int:
        """Bytes held in memory."""
        return sum(part.nbytes for part in (self.alphas, self.directions, self.sizes, self.starts)) + (
            self.texels.nbytes + self.valid.nbytes
        )
