"""Arrays in few bytes that a browser unpacks without help: foretold, split into bytes, deflated.

The scripts read them in ``scripts/unpack.js``. Values are integers; floats are stored as they are.
"""

from __future__ import annotations

import base64
import zlib
from typing import Any

import numpy as np

from ibrpipe.types import Array


class Packer:
    """Collects arrays; `entries` tells of each what a reader must know, `encoded` is all of them."""

    def __init__(self) -> None:
        self._parts: list[bytes] = []
        self._end = 0

    def add(self, values: Array, predicted: Array | None = None) -> dict[str, Any]:
        """Add an array and return its entry.

        Parameters
        ----------
        values : array of uint8, uint16, int32 or float32, any shape
        predicted : array of the same size, optional
            What a reader will foretell of unsigned `values`; only the difference is stored.
        """
        kind = values.dtype.str[1:]
        if predicted is not None:
            values = _zigzag(values.astype(np.int64) - predicted, values.dtype)
        # bytes of one weight lie together: high bytes are mostly 0
        raw = np.ascontiguousarray(values).ravel().astype(values.dtype.newbyteorder("<"))
        data = raw.view(np.uint8).reshape(-1, raw.itemsize).T.tobytes()
        entry = {"type": kind, "length": raw.size, "offset": self._end, "predicted": predicted is not None}
        self._parts.append(data)
        self._end += len(data)
        return entry

    def add_bytes(self, data: bytes) -> dict[str, Any]:
        """Add a file's bytes as they are."""
        return self.add(np.frombuffer(data, np.uint8))

    def encoded(self) -> str:
        """Return all arrays as base64 of a zlib stream."""
        return base64.b64encode(zlib.compress(b"".join(self._parts), 9)).decode("ascii")


def _zigzag(difference: Array, kind: np.dtype[Any]) -> Array:
    """Wrap differences to the size of `kind` and fold them: 0, -1, 1, -2, ... become 0, 1, 2, 3, ..."""
    bits = 8 * kind.itemsize
    wrapped = (difference + (1 << bits - 1)) % (1 << bits) - (1 << bits - 1)
    return np.where(wrapped < 0, -2 * wrapped - 1, 2 * wrapped).astype(kind)


def neighbours(offsets: Array) -> Array:
    """Samples that foretell each: to the left, above, and above left, (3, S) int64; -1 = none.

    offsets : (H, W + 1), as of a layered image. Of the other texel's samples it is the one of the same rank, or the
    last.
    """
    rows, columns = offsets.shape[0], offsets.shape[1] - 1
    first, counts = offsets[:, :-1], np.diff(offsets, axis=1)
    texel = np.repeat(np.arange(rows * columns), counts.ravel())
    rank = np.arange(len(texel)) - first.ravel()[texel]
    out = np.full((3, len(texel)), -1, np.int64)
    for n, (up, left) in enumerate(((0, 1), (1, 0), (1, 1))):
        y, x = texel // columns - up, texel % columns - left
        inside = (y >= 0) & (x >= 0)
        other = np.maximum(y, 0) * columns + np.maximum(x, 0)
        there = inside & (counts.ravel()[other] > 0)
        found = first.ravel()[other] + np.minimum(rank, counts.ravel()[other] - 1)
        out[n] = np.where(there, found, -1)
    return out


def foretell(values: Array, around: Array) -> Array:
    """Foretell every value (S,) from those of `neighbours`: the median of left, above and their parallelogram.

    With one of the two it is that; with neither, the value before in memory, 0 for the first.
    """
    wide = np.append(values.astype(np.int64), 0)
    left, above, corner = wide[around]
    before = np.append(0, wide[:-2]) if len(values) else wide[:0]
    corner = np.where(around[2] >= 0, corner, np.where(around[0] >= 0, left, above))
    low, high = np.minimum(left, above), np.maximum(left, above)
    median = np.where(corner >= high, low, np.where(corner <= low, high, left + above - corner))
    one = np.where(around[0] >= 0, left, np.where(around[1] >= 0, above, before))
    return np.where((around[0] >= 0) & (around[1] >= 0), median, one)
