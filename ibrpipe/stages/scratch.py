"""Arrays in files, for what would fill the memory: read and written run by run, and handed back after each run."""

from __future__ import annotations

import mmap
from pathlib import Path

import numpy as np

from ibrpipe.errors import ResourceError
from ibrpipe.types import Array


def scratch_array(path: Path, rows: int) -> Array:
    """Make a file of (rows, 3) float32 zeros and map it; whoever makes it removes it.

    Raises
    ------
    ResourceError
        The file cannot be made.
    """
    try:
        return np.memmap(path, np.float32, "w+", shape=(rows, 3))
    except OSError as error:
        raise ResourceError(f"{path}: cannot write {12 * rows} bytes of scratch: {error.strerror or error}") from error


def hand_back(array: Array) -> None:
    """Take the pages of a mapped array out of memory; what was written goes to its file. Others are left alone."""
    mapping = getattr(array, "_mmap", None)
    if mapping is not None and hasattr(mmap, "MADV_DONTNEED"):
        mapping.madvise(mmap.MADV_DONTNEED)
