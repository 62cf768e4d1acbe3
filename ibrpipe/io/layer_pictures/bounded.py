"""Unpacking that never yields more than it should."""

from __future__ import annotations

import lzma
import zlib

from ibrpipe.errors import FormatError

#: no head, memory for a megabyte, and no guess at words of several bytes
_RAW = [{"id": lzma.FILTER_LZMA2, "preset": 9, "dict_size": 1 << 20, "lc": 0, "lp": 0, "pb": 0}]


def squeeze(data: bytes) -> bytes:
    """Pack by LZMA, without a head: fewer bytes than zlib where there are many, more where there are few."""
    return lzma.compress(data, lzma.FORMAT_RAW, filters=_RAW)


def unsqueeze(data: bytes, size: int) -> bytes:
    """Return the `size` bytes that `squeeze` packed into `data`.

    Raises
    ------
    FormatError
        There are more or fewer, or `data` is damaged.
    """
    unpacker = lzma.LZMADecompressor(lzma.FORMAT_RAW, filters=_RAW)
    try:
        found = unpacker.decompress(data, size + 1)
    except lzma.LZMAError as error:
        raise FormatError(f"packed bytes are damaged: {error}") from error
    if len(found) != size or not unpacker.eof:
        raise FormatError(f"{len(found)} or more bytes are packed where {size} belong")
    return found


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
