"""Finished frames, and the threads that make them."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import numba

from ibrpipe.errors import RendererError
from ibrpipe.types import Array, Frame


def make_frame(
    outputs: Collection[str], depth: Array | None, color: Array | None, alpha: Array | None, stats: Mapping[str, Any]
) -> Frame:
    """Return a frame of those of the arrays that `outputs` asks for."""
    return Frame(
        color if "color" in outputs else None,
        depth if "depth" in outputs else None,
        alpha if "alpha" in outputs else None,
        dict(stats),
    )


@contextmanager
def limited_threads(threads: int) -> Iterator[None]:
    """Run the kernels of this block on `threads` threads (0 = as many as Numba has)."""
    before, most = numba.get_num_threads(), numba.config.NUMBA_NUM_THREADS
    if threads < 0 or threads > most:
        raise RendererError(f"threads is {threads}; give 0 (all) or 1 to {most}")
    numba.set_num_threads(threads or before)
    try:
        yield
    finally:
        numba.set_num_threads(before)
