"""NumPy's files, whose headers may claim anything: what they claim is compared with what is there before it is made."""

from __future__ import annotations

import math
import zipfile
from pathlib import Path
from typing import IO, Any

import numpy as np

from ibrpipe.errors import FormatError, MissingFileError
from ibrpipe.io.untrusted.boundary import check_regular, told
from ibrpipe.types import Array

#: bytes that an archive may unpack to
MOST_BYTES = 1 << 30
_HEADERS: dict[tuple[int, int], Any] = {
    (1, 0): np.lib.format.read_array_header_1_0,
    (2, 0): np.lib.format.read_array_header_2_0,
}


def load_npy(path: Path) -> Array:
    """Read an array file.

    Raises
    ------
    MissingFileError, FormatError
        There is no such file, or it is damaged, holds objects, or claims more than it holds.
    """
    with told(path, "write it with numpy.save", "not a NumPy array file"):
        status = _status(path)
        with path.open("rb") as source:
            return read_npy(source, status)


def load_npz(
    path: Path, remedy: str = "write it with numpy.savez", wrong: str = "not a NumPy archive"
) -> dict[str, Array]:
    """Read all arrays of an archive, which unpack to at most `MOST_BYTES`; raises as `load_npy`, with these words."""
    with told(path, remedy, wrong):
        _status(path)
        with zipfile.ZipFile(path) as archive:
            members = archive.infolist()
            whole = sum(member.file_size for member in members)
            if whole > MOST_BYTES:
                raise FormatError(f"{path}: unpacks to {whole >> 20} MiB; at most {MOST_BYTES >> 20} are read")
            found = {}
            for member in members:
                with archive.open(member) as source:
                    found[member.filename.removesuffix(".npy")] = read_npy(source, member.file_size)
            return found


def read_npy(source: IO[bytes], size: int) -> Array:
    """Read an array from the beginning of `source`, which holds `size` bytes.

    Raises
    ------
    ValueError
        It is no array, holds objects, or claims more than that.
    """
    version = np.lib.format.read_magic(source)
    if version not in _HEADERS:
        raise ValueError(f"version {version[0]}.{version[1]} of the format is not read")
    shape, fortran, dtype = _HEADERS[version](source)
    if dtype.hasobject:
        raise ValueError("it holds Python objects")
    stated = math.prod(shape) * dtype.itemsize
    if stated > size or min(shape, default=0) < 0:
        raise ValueError(f"its header claims {stated} bytes of numbers, the file has {size}")
    data = source.read(stated)
    if len(data) < stated:
        raise ValueError(f"it is cut off: {len(data)} of {stated} bytes are there")
    flat = np.frombuffer(bytearray(data), dtype, math.prod(shape))
    return flat.reshape(shape[::-1]).T if fortran else flat.reshape(shape)


def _status(path: Path) -> int:
    """Return the size of a file."""
    try:
        status = path.stat()
    except FileNotFoundError as error:
        raise MissingFileError(f"{path}: the file does not exist") from error
    check_regular(path, status)
    return status.st_size
