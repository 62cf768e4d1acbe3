"""Photos of a capture folder: those below images/, or those of a bare folder."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from ibrpipe.calibration.photos import photos_of
from ibrpipe.errors import CaptureError
from ibrpipe.io.photos.images import write_png

PHOTO = np.zeros((6, 8, 3))


def _write(root: Path, *names: str) -> None:
    for name in names:
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        write_png(root / name, PHOTO)


def test_a_bare_folder_of_photos_is_a_capture(tmp_path: Path) -> None:
    _write(tmp_path, "b.png", "a.png", "upper/c.png", "a.mask.png", ".thumb.png")
    _write(tmp_path, "masks/b.png", "depth/a.png", "test/images/t.png", "out/render/b.png")
    (tmp_path / "out/run.json").write_text("{}")  # of a run on this very folder
    found = photos_of(tmp_path)
    assert [entry.name for entry in found] == ["a.png", "b.png", "upper/c.png", "test/t.png"]
    assert [entry.held_out for entry in found] == [False, False, False, True]
    assert [entry.mask is not None for entry in found] == [True, True, False, False]


def test_photos_lie_in_images_where_there_is_one(tmp_path: Path) -> None:
    _write(tmp_path, "preview.png", "images/a.png", "images/test/b.png", "images/masks/c.png")
    assert [entry.name for entry in photos_of(tmp_path)] == ["a.png", "masks/c.png", "test/b.png"]


def test_a_folder_without_photos_is_told_of(tmp_path: Path) -> None:
    _write(tmp_path, "masks/a.png")
    with pytest.raises(CaptureError, match=r"no photos found; expected JPEG.* in its images/"):
        photos_of(tmp_path)
