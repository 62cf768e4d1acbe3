"""Arrays in files have their room on the disk before anything is written to them."""

from __future__ import annotations

import errno
import os
from pathlib import Path

import numpy as np
import pytest

from ibrpipe.engine.memory_map import hand_back, scratch_array
from ibrpipe.errors import ResourceError


@pytest.mark.parametrize("system", ["allocates", "writes zeros"])
def test_a_scratch_array_holds_zeros_then_what_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, system: str
) -> None:
    if system == "writes zeros":
        monkeypatch.delattr(os, "posix_fallocate", raising=False)
    path = tmp_path / "a.partial"
    array = scratch_array(path, 200_000)
    assert path.stat().st_size == 2_400_000
    assert path.stat().st_blocks * 512 >= 2_400_000  # no hole that a full disk could leave
    assert array.dtype == np.float32
    assert not array.any()
    array[100_000:] = 2.5
    hand_back(array)
    assert (array[:100_000] == 0).all()
    assert (array[100_000:] == 2.5).all()


def test_a_full_disk_is_told_before_anything_is_lost(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(file: int, offset: int, size: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "posix_fallocate", full, raising=False)
    path = tmp_path / "a.partial"
    with pytest.raises(ResourceError, match=r"a\.partial: cannot take 12 MB .*No space left.*; make room and run"):
        scratch_array(path, 1_000_000)
    assert not path.exists()
