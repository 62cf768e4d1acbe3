"""Whole numbers as few bytes: what was packed comes back, by zlib or by LZMA, and damage is told."""

from __future__ import annotations

import zlib

import numpy as np
import pytest

from ibrpipe.errors import FormatError
from ibrpipe.io.layer_pictures import numbers
from ibrpipe.io.layer_pictures.bounded import squeeze, unsqueeze
from ibrpipe.io.layer_pictures.numbers import pack_numbers, unpack_numbers
from ibrpipe.io.layer_pictures.planes import planes_of
from ibrpipe.types.layers import offsets_of


@pytest.mark.parametrize("squeezed", [False, True])
def test_numbers_come_back(monkeypatch: pytest.MonkeyPatch, squeezed: bool) -> None:
    rng = np.random.default_rng(0)
    planes = planes_of(offsets_of(rng.integers(0, 3, (120, 150))))
    count = sum(len(plane.samples) for plane in planes)
    values = np.cumsum(rng.integers(-2, 3, count)) - 7
    if not squeezed:  # as it was before LZMA
        monkeypatch.setattr(numbers, "squeeze", lambda data: bytes(len(data)))
    data = pack_numbers(values, planes)
    assert (data[0] >= 2) == squeezed
    np.testing.assert_array_equal(unpack_numbers(data, planes), values)
    for damaged in (data[:-5], data[:2] + b"\xff" * (len(data) - 2)):
        with pytest.raises((FormatError, zlib.error)):
            unpack_numbers(damaged, planes)
    for unknown in (bytes([7]) + data[1:], b""):
        with pytest.raises(FormatError, match="which is unknown"):
            unpack_numbers(unknown, planes)


def test_never_more_than_belongs_there() -> None:
    packed = squeeze(bytes(10_000_000))
    with pytest.raises(FormatError, match="1001 or more bytes are packed where 1000 belong"):
        unsqueeze(packed, 1000)
    with pytest.raises(FormatError, match="packed where 20000000 belong"):
        unsqueeze(packed, 20_000_000)
    with pytest.raises(FormatError, match="damaged"):
        unsqueeze(b"\x7f" * 50, 10)
