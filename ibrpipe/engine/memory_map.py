"""Arrays in files, for what would fill the memory: read and written run by run, and handed back after each run."""

from __future__ import annotations

import mmap
import os
from pathlib import Path
from typing import BinaryIO

import numpy as np

from ibrpipe.errors import ResourceError
from ibrpipe.types import Array


def scratch_array(path: Path, rows: int) -> Array:
    """Make a file of (rows, 3) float32 zeros and map it; whoever makes it removes it.

    Its room on the disk is taken at once: a disk that fills up under a mapped file ends the process without a word.

    Raises
    ------
    ResourceError
        The file cannot be made, or there is no room for it.
    """
    size = 12 * rows
    try:
        with path.open("wb") as file:
            _reserve(file, size)
        return np.memmap(path, np.float32, "r+", shape=(rows, 3))
    except OSError as error:
        path.unlink(missing_ok=True)
        raise ResourceError(
            f"{path}: cannot take {size / 1e6:.0f} MB of disk for what does not stay in memory "
            f"({error.strerror or error}); make room and run the same command again"
        ) from error


def _reserve(file: BinaryIO, size: int) -> None:
    """Make a file `size` bytes long, with room on the disk for all of them."""
    if hasattr(os, "posix_fallocate"):
        os.posix_fallocate(file.fileno(), 0, size)
        return
    block = bytes(1 << 20)
    for start in range(0, size, len(block)):
        file.write(block[: size - start])


def hand_back(array: Array) -> None:
    """Take the pages of a mapped array out of memory; what was written goes to its file. Others are left alone."""
    mapping = getattr(array, "_mmap", None)
    if mapping is not None and hasattr(mmap, "MADV_DONTNEED"):
        mapping.madvise(mmap.MADV_DONTNEED)
