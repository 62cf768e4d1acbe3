"""Unpacking that never yields more than it should."""

from __future__ import annotations

import zlib

from ibrpipe.errors import FormatError


def inflate(data: bytes, size: int) -> bytes:
    """Return the `size` bytes that zlib packed into `data`.

    Raises
    ------
    FormatError
        There are more or fewer, or `data` is damaged.
    """
    unpacker = zlib.decompressobj()
    found = unpacker.decompress(data, size + 1)
    if len(found) != size or not unpacker.eof:
        raise FormatError(f"{len(found)} or more bytes are packed where {size} belong")
    return found
