"""What changes with the view direction: components of textures, of one kind each."""

from __future__ import annotations

import math
import operator
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, Protocol, runtime_checkable

import numpy as np

from ibrpipe.errors import ShapeError, ValueRangeError
from ibrpipe.types.arrays import Array
from ibrpipe.types.camera import ParallelFrame

#: smallest density of a spiral: it has more than a million images
LEAST_K = 1e-3
#: the last parameter of a spiral is at most so many of its least steps: renderers look images up in a table of steps
MOST_STEPS = 1 << 23


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

    def of_samples(self, kept: Array) -> ViewDependence:
        """Return the component of layers of which only the samples `kept`, (S,) bool, are left."""
        return self

    def predicting(self) -> ViewDependence:
        """Return the component as it shows views that it was not given: a photo that is kept does not show itself."""
        return self


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
                "a component must have kind, bytes, shared, of_samples and predicting (ViewDependence), "
                f"got {type(component).__name__}"
            )
    kinds = [component.kind for component in components]
    twice = sorted({kind for kind in kinds if kinds.count(kind) > 1})
    if twice:
        raise ValueRangeError(f"two components of kind {twice[0]!r}; a texture takes one of each kind: join them")
    return tuple(components)


def kinds_of(components: Sequence[ViewDependence]) -> str:
    """Return the kinds of components in words."""
    return ", ".join(component.kind for component in components) or "none"


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

    Raises
    ------
    ShapeError, ValueRangeError
        The arrays do not fit together, or the images are not those of a spiral: renderers find them by arithmetic.
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

    def __repr__(self) -> str:
        """Return how many images and texels there are."""
        return f"SpiralResiduals({len(self.sizes)} images, {len(self.texels)} texels)"

    def __post_init__(self) -> None:
        object.__setattr__(self, "k", float(self.k))
        object.__setattr__(self, "zero", operator.index(self.zero))
        object.__setattr__(self, "closed", bool(self.closed))
        if not LEAST_K <= self.k <= 1:
            raise ValueRangeError(f"k is {self.k}; it must lie in [{LEAST_K}, 1]")
        if not 0 <= self.zero <= 255:
            raise ValueRangeError(f"zero is {self.zero}; it is a code from 0 to 255")
        basis = self.rectangle.world_from_local / np.linalg.norm(self.rectangle.world_from_local, axis=0)
        if np.abs(basis.T @ basis - np.eye(3)).max() > 1e-6:
            raise ValueRangeError("the support rectangle of residuals must have right angles, f normal to it")
        n = len(self.directions)
        sizes = np.asarray(self.sizes)
        if sizes.shape != (n, 2) or (sizes < 0).any():  # 0 = an image that nobody looks up
            raise ShapeError(f"sizes must be ({n}, 2), height and width of every image, each 0 or more")
        _check_alphas(np.asarray(self.alphas), n, self.k, self.closed)
        _check_directions(np.asarray(self.directions))
        areas = np.asarray(self.sizes, np.int64).prod(axis=1) if n else np.zeros(0, np.int64)
        if np.shape(self.starts) != (n + 1,) or (np.diff(self.starts) != areas).any():
            raise ShapeError("starts must step by each image's height * width")
        if self.texels.shape != (int(self.starts[-1]), 3) or self.valid.shape != (int(self.starts[-1]),):
            raise ShapeError(f"texels and valid must hold {int(self.starts[-1])} texels, got {self.texels.shape}")
        if self.texels.dtype not in (np.uint8, np.float32):
            raise ShapeError(f"texels must be uint8 or float32, got {self.texels.dtype}")
        if self.texels.dtype == np.float32 and not (np.isfinite(self.texels).all(axis=1) | ~self.valid).all():
            raise ValueRangeError("valid residuals hold NaN or infinity; declare them not valid")

    @property
    def bytes(self) -> int:
        """Bytes held in memory."""
        return sum(part.nbytes for part in (self.alphas, self.directions, self.sizes, self.starts)) + (
            self.texels.nbytes + self.valid.nbytes
        )


def _check_alphas(alphas: Array, count: int, k: float, closed: bool) -> None:
    """Refuse parameters that no spiral of density k has, or whose steps are too unlike for a table of them."""
    from ibrpipe.core.spiral.directions import closing_count  # here, so that types start without the compiler

    if alphas.shape != (count,) or count < 1:
        raise ShapeError(f"alphas must be ({count},), one an image and at least one, got {alphas.shape}")
    closing = closing_count(k) if closed else 0
    steps = np.diff(alphas)
    if not (np.isfinite(alphas).all() and alphas[0] == 0 and (steps > 0).all()):
        raise ValueRangeError("alphas must ascend from 0; they are the spiral parameters of the images")
    if count <= closing:
        raise ValueRangeError(f"{count} images are too few for a closed spiral of k = {k:g}: {closing} close it")
    end = 0.5 * math.pi / k + 2 * math.pi
    if alphas[-1] > end or (closed and alphas[-1] - alphas[count - closing] >= 2 * math.pi):
        raise ValueRangeError(f"alphas go up to {alphas[-1]:g}, a spiral of k = {k:g} ends before {end:g}")
    if count > 1 and alphas[-1] > MOST_STEPS * steps.min():
        raise ValueRangeError(f"two alphas are {steps.min():g} apart, the last is {alphas[-1]:g}: too close together")


def _check_directions(directions: Array) -> None:
    lengths = np.linalg.norm(directions, axis=1) if directions.ndim == 2 and directions.shape[1] == 3 else None
    if lengths is None:
        raise ShapeError(f"directions must be (n, 3), got {directions.shape}")
    if not (np.abs(lengths - 1) < 1e-3).all() or not (directions[:, 2] > 1e-6).all():
        raise ValueRangeError("directions must be unit vectors that point away from the object (third number above 0)")
