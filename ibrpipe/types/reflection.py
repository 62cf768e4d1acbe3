"""Shared reflection: a surface whose gloss is looked up in tables that the whole object shares."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ibrpipe.errors import ShapeError, ValueRangeError
from ibrpipe.types.arrays import Array, contiguous
from ibrpipe.types.view_dependence import ViewDependence

#: most tables, and most cells along an edge of one
MOST_TABLES, MOST_CELLS = 2, 1024


@dataclass(frozen=True, eq=False)
class ReflectedLight:
    """Light that a surface mirrors, by direction, for every kind of mirror that the object has.

    Attributes
    ----------
    tables : (L, n, n, 3) float32
        Linear light from each direction of the world; octahedral, see :mod:`ibrpipe.core.reflection.directions`.
    reflectance : tuple of L floats
        At normal incidence, 0 to 1.
    damping : float
        Share of the diffuse colour that goes at grazing angles, 0 to 1.

    Raises
    ------
    ShapeError, ValueRangeError
        Tables of another shape, negative or infinite light, or figures outside 0 to 1.
    """

    tables: Array
    reflectance: tuple[float, ...]
    damping: float = 0.9

    def __repr__(self) -> str:
        """Return how many tables there are, and their size."""
        return f"ReflectedLight({len(self.tables)} tables of {self.tables.shape[1]} x {self.tables.shape[2]})"

    def __post_init__(self) -> None:
        tables = contiguous("tables", self.tables, np.float32, 4)
        count, size = tables.shape[:2]
        if tables.shape != (count, size, size, 3) or not (1 <= count <= MOST_TABLES and 1 <= size <= MOST_CELLS):
            raise ShapeError(
                f"tables must be (L, n, n, 3) with 1 to {MOST_TABLES} tables of 1 to {MOST_CELLS} cells a side, "
                f"got {tables.shape}"
            )
        if not (np.isfinite(tables).all() and (tables >= 0).all()):
            raise ValueRangeError("tables hold negative, NaN or infinite light; repair them")
        reflectance = tuple(float(value) for value in self.reflectance)
        if len(reflectance) != count or not all(0 <= value <= 1 for value in (*reflectance, self.damping)):
            raise ValueRangeError(
                f"reflectance must be {count} numbers from 0 to 1, and so must damping, got {reflectance} and "
                f"{self.damping}"
            )
        object.__setattr__(self, "tables", tables)
        object.__setattr__(self, "reflectance", reflectance)

    @property
    def bytes(self) -> int:
        """Bytes held in memory."""
        return self.tables.nbytes


@dataclass(frozen=True, eq=False)
class Reflection(ViewDependence):
    """A texture whose layers hold diffuse colour only, and whose gloss comes from shared tables.

    Attributes
    ----------
    light : ReflectedLight
        Shared by all textures of the asset.
    weights : (S, L) float32 or None
        How much of each table the samples of the layers show, 0 and more; None = all of each.
    """

    kind: ClassVar[str] = "reflection"

    light: ReflectedLight
    weights: Array | None = None

    def __repr__(self) -> str:
        """Return the shared light and whether samples have weights of their own."""
        return f"Reflection({self.light}, {'no' if self.weights is None else len(self.weights)} weights)"

    def __post_init__(self) -> None:
        if self.weights is None:
            return
        weights = contiguous("weights", self.weights, np.float32, 2)
        if weights.shape[1] != len(self.light.tables):
            raise ShapeError(f"weights must be (S, {len(self.light.tables)}), got {weights.shape}")
        if not (np.isfinite(weights).all() and (weights >= 0).all()):
            raise ValueRangeError("weights hold negative, NaN or infinite numbers; repair them")
        object.__setattr__(self, "weights", weights)

    def of_samples(self, kept: Array) -> Reflection:
        """Return the reflection of layers of which only the samples `kept`, (S,) bool, are left."""
        return self if self.weights is None else Reflection(self.light, self.weights[kept])

    @property
    def shared(self) -> ReflectedLight:
        """The tables."""
        return self.light

    @property
    def bytes(self) -> int:
        """Bytes held in memory, without the tables."""
        return 0 if self.weights is None else self.weights.nbytes
