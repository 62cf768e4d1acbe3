"""Whole numbers of all samples as few bytes: foretold along the pictures, bytes of one rank together, zlib or LZMA."""

from __future__ import annotations

import zlib
from collections.abc import Sequence

import numpy as np

from ibrpipe.core.coding import prediction
from ibrpipe.errors import FormatError
from ibrpipe.io.layer_pictures.bounded import inflate, squeeze, unsqueeze
from ibrpipe.io.layer_pictures.planes import Plane
from ibrpipe.types import Array

#: the first two bytes say how samples are foretold and how many bytes each takes
_HEAD = 2
#: added to the first where they are packed by LZMA
_SQUEEZED = 2


def pack_numbers(values: Array, planes: Sequence[Plane]) -> bytes:
    """Pack one whole number per sample (S,) int64, below 2^40 in size."""
    return min((_packed(values, planes, predictor) for predictor in (prediction.PLANE, prediction.MEDIAN)), key=len)


def _packed(values: Array, planes: Sequence[Plane], predictor: int) -> bytes:
    folded = np.zeros(len(values), np.uint64)
    start = 0
    for plane in planes:
        picture = np.zeros(plane.there.shape, np.int64)
        picture[plane.there] = values[plane.samples]
        prediction.take_differences(picture, plane.there, predictor, folded[start : start + len(plane.samples)])
        start += len(plane.samples)
    ranks = max(1, -(-int(folded.max(initial=0)).bit_length() // 8))
    split = folded.astype("<u8").view(np.uint8).reshape(-1, 8)[:, :ranks]
    data = np.ascontiguousarray(split.T).tobytes()
    deflated, squeezed = zlib.compress(data, 9), squeeze(data)
    if len(squeezed) < len(deflated):
        return bytes([predictor + _SQUEEZED, ranks]) + squeezed
    return bytes([predictor, ranks]) + deflated


def unpack_numbers(data: bytes, planes: Sequence[Plane]) -> Array:
    """Return the numbers (S,) int64 that `pack_numbers` packed.

    Raises
    ------
    FormatError
        There are not as many as the planes have samples.
    """
    count = sum(len(plane.samples) for plane in planes)
    first, ranks = (data[0], data[1]) if len(data) > _HEAD else (255, 0)
    predictor, unpack = (first, inflate) if first < _SQUEEZED else (first - _SQUEEZED, unsqueeze)
    if predictor not in (prediction.PLANE, prediction.MEDIAN) or not 1 <= ranks <= 6:
        raise FormatError(f"numbers are packed with predictor {first} and {ranks} bytes each, which is unknown")
    split = np.zeros((count, 8), np.uint8)
    split[:, :ranks] = np.frombuffer(unpack(data[_HEAD:], count * ranks), np.uint8).reshape(ranks, count).T
    folded = split.view("<u8").ravel().astype(np.uint64)
    values = np.zeros(count, np.int64)
    start = 0
    for plane in planes:
        picture = np.zeros(plane.there.shape, np.int64)
        end = start + len(plane.samples)
        prediction.add_differences(folded[start:end], plane.there, predictor, picture)
        values[plane.samples] = picture[plane.there]
        start = end
    return values
