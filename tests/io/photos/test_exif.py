"""What cameras write into photos about lens and position."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest

from ibrpipe.io.photos.exif import Exif, local_metres, read_exif


def photo(path: Path, **tags: object) -> Path:
    spec = oiio.ImageSpec(60, 40, 3, "uint8")
    for name, value in tags.items():
        spec.attribute(name.replace("__", ":"), value)
    target = oiio.ImageOutput.create(str(path))
    assert target.open(str(path), spec)
    assert target.write_image(np.zeros((40, 60, 3), np.uint8))
    target.close()
    return path


def test_focal_length_from_its_35_mm_equivalent(tmp_path: Path) -> None:
    found = read_exif(photo(tmp_path / "a.jpg", Make="Maker", Model="M 1", Exif__FocalLengthIn35mmFilm=50))
    assert found.focal == pytest.approx(50 / math.hypot(36, 24) * math.hypot(60, 40), rel=1e-6)
    assert found.lens.startswith("Maker M 1")
    assert found.gps is None


def test_focal_length_from_the_density_of_the_sensor(tmp_path: Path) -> None:
    tags = {"Exif__FocalLength": 25.0, "Exif__FocalPlaneXResolution": 100.0, "Exif__FocalPlaneResolutionUnit": 3}
    assert read_exif(photo(tmp_path / "a.jpg", **tags)).focal == pytest.approx(250.0, rel=1e-3)


def test_nothing_stated_nothing_told(tmp_path: Path) -> None:
    assert read_exif(photo(tmp_path / "a.png")) == Exif()
    (tmp_path / "b.jpg").write_bytes(b"no photo")
    assert read_exif(tmp_path / "b.jpg") == Exif()


def test_positions_become_metres_east_north_up() -> None:
    positions = np.array([[50.0, 8.0, 100.0], [50.0, 8.001, 100.0], [50.001, 8.0, 100.0], [50.0, 8.0, 103.0]])
    metres = local_metres(positions)
    assert np.allclose(metres[0], 0)
    assert metres[1] == pytest.approx((71.7, 0.0, 0.0), abs=0.1)
    assert metres[2] == pytest.approx((0.0, 111.2, 0.0), abs=0.1)
    assert metres[3] == pytest.approx((0.0, 0.0, 3.0), abs=1e-6)
