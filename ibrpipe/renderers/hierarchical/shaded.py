"""Slices that have been lit, kept from frame to frame: each (part, resolution, direction, lights) is shaded once."""

from __future__ import annotations

import numpy as np

from ibrpipe.core.hierarchy import shade, table
from ibrpipe.errors import RendererError
from ibrpipe.types import Array
from ibrpipe.types.prerendered import HEIGHT, WIDTH, Prerendered

#: most texels of one frame, 8 GB: kernels count them in 32 bits
MOST_TEXELS = 1 << 31


class ShadedSlices:
    """What is shaded of one library under one set of lights' colours.

    Parameters
    ----------
    library : Prerendered
    materials : (P, 2) float64
        Of the library's parts.
    most : int
        Texels that are kept; where a frame needs more, older ones are dropped and, if need be, more are kept.
    """

    def __init__(self, library: Prerendered, materials: Array, most: int = 1 << 26) -> None:
        self._library, self._materials, self._most = library, materials, most
        self._viewers = np.ascontiguousarray(library.axes[:, 2])
        sizes = np.concatenate([[0], (library.slabs[:, WIDTH] + 2) * (library.slabs[:, HEIGHT] + 2)])
        ends = np.cumsum(sizes)
        self._lengths = ends[library.stacks[1:]] - ends[library.stacks[:-1]]
        self._lighting: Array | None = None
        self._clear()

    def _clear(self) -> None:
        self._used = 0
        self._table = _empty_table(1 << 10)
        self._texels = np.zeros(1 << 16, np.uint32)
        self._firsts, self._peaks = np.zeros(0, np.int64), np.zeros(0, np.float32)

    @property
    def texels(self) -> Array:
        """(N - 1,) uint64: every texel with its right neighbour."""
        pairs = self._texels.view(np.uint64)
        return np.lib.stride_tricks.as_strided(pairs, (len(self._texels) - 1,), (4,))

    @property
    def bytes(self) -> int:
        """Bytes held."""
        return self._texels.nbytes + self._table.nbytes

    def find(self, keys: Array, lighting: Array) -> tuple[Array, Array]:
        """Return first shaded texel (I,) int64 and peak (I,) float32 of stacks, shading those that are new.

        Parameters
        ----------
        keys : (I, 2) int64
            Stack, and bins of the lights.
        lighting : (1 + lights, 3) float64
            Ambient light and the colours of the lights; where they change, all is shaded anew.

        Raises
        ------
        RendererError
            The stacks hold more than 2^31 texels.
        """
        if self._lighting is None or not np.array_equal(self._lighting, lighting):
            self._lighting = lighting.copy()
            self._clear()
        found, fresh = self._enter(keys)
        if self._used > self._most and len(fresh) < len(self._firsts) + len(fresh):
            self._clear()
            found, fresh = self._enter(keys)
        if self._used > MOST_TEXELS:
            raise RendererError(
                f"the view needs {self._used:,} texels of shaded slices; at most {MOST_TEXELS:,}: raise pixel_error"
            )
        self._shade(fresh, lighting)
        return self._firsts[found], self._peaks[found]

    def _enter(self, keys: Array) -> tuple[Array, Array]:
        held = int(self._table[-1, 2])
        size = len(self._table) - 1
        if 2 * (held + len(keys)) > size:
            larger = _empty_table(1 << int(4 * (held + len(keys))).bit_length())
            table.grow(self._table, larger)
            self._table = larger
        found, fresh = np.empty(len(keys), np.int64), np.empty((len(keys), 3), np.int64)
        made, self._used = table.look_up(keys, self._lengths, self._used, self._table, found, fresh)
        return found, fresh[:made]

    def _shade(self, fresh: Array, lighting: Array) -> None:
        if len(fresh) == 0:
            return
        if self._used + 2 > len(self._texels):
            larger = np.zeros((self._used + self._used // 2 + 2) & ~1, np.uint32)
            larger[: len(self._texels)] = self._texels
            self._texels = larger
        peaks = np.empty(len(fresh), np.float32)
        own = self._library
        shade.shade_stacks(
            fresh[:, :2].copy(), fresh[:, 2].copy(), own.stacks, own.slabs, own.texels, self._materials,
            self._viewers, lighting, own.scale, self._texels, peaks,
        )  # fmt: skip
        self._firsts = np.concatenate([self._firsts, fresh[:, 2]])
        self._peaks = np.concatenate([self._peaks, peaks])


def _empty_table(size: int) -> Array:
    fresh = np.full((size + 1, 3), table.EMPTY, np.int64)
    fresh[-1, 2] = 0
    return fresh
