"""A layered depth image as one picture per layer: which texels have a sample there, and which sample it is."""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ibrpipe.errors import FormatError
from ibrpipe.io.layer_pictures.bounded import inflate
from ibrpipe.types import Array
from ibrpipe.types.layers import offsets_of


@dataclass(frozen=True)
class Plane:
    """One layer.

    Attributes
    ----------
    there : (h, w) bool
        Texels with a sample, within the box.
    box : tuple of slice
        Rows and columns of the texture that hold them all.
    samples : (n,) int64
        The sample of every texel that is there, row by row.
    """

    there: Array
    box: tuple[slice, slice]
    samples: Array


def planes_of(offsets: Array) -> list[Plane]:
    """Return the layers of ``offsets`` (H, W + 1), nearest first."""
    counts = np.diff(offsets, axis=1)
    found = []
    for layer in range(int(counts.max(initial=0))):
        there = counts > layer
        box = box_of(there)
        found.append(Plane(np.ascontiguousarray(there[box]), box, offsets[:, :-1][there] + layer))
    return found


def box_of(there: Array) -> tuple[slice, slice]:
    """Return the rows and columns that hold all that is true in (H, W)."""
    rows, columns = np.flatnonzero(there.any(axis=1)), np.flatnonzero(there.any(axis=0))
    return slice(int(rows[0]), int(rows[-1]) + 1), slice(int(columns[0]), int(columns[-1]) + 1)


def pack_occupancy(offsets: Array, planes: Sequence[Plane]) -> bytes:
    """Return the bits of all layers; of each but the first only those of texels that the one before it has."""
    before = np.ones((offsets.shape[0], offsets.shape[1] - 1), bool)
    parts = []
    for plane in planes:
        there = np.zeros_like(before)
        there[plane.box] = plane.there
        parts.append(np.packbits(there[before]).tobytes())
        before = there
    return zlib.compress(b"".join(parts), 9)


def unpack_occupancy(data: bytes, shape: tuple[int, int], samples: Sequence[int]) -> Array:
    """Return the offsets (H, W + 1) of layers with so many `samples` each.

    Raises
    ------
    FormatError
        The bits are not those of such layers.
    """
    before = np.ones(shape, bool)
    counts = np.zeros(shape, np.int32)
    sizes = [-(-size // 8) for size in (shape[0] * shape[1], *samples[:-1])] if samples else []
    bits = inflate(data, sum(sizes))
    start = 0
    for size, wanted in zip(sizes, samples, strict=True):
        held = int(before.sum())
        own = np.unpackbits(np.frombuffer(bits, np.uint8, size, start), count=held).astype(bool)
        start += size
        if own.sum() != wanted or not wanted:
            raise FormatError(f"a layer has {own.sum()} samples, its header says {wanted}")
        there = np.zeros(shape, bool)
        there[before] = own
        counts += there
        before = there
    return offsets_of(counts)
