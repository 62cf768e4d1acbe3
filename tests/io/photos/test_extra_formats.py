"""HEIC and raw photos: colours, turns, notes of the camera; and what is told where their packages are missing."""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from dng_files import write_dng

from ibrpipe.calibration.photos import photos_of
from ibrpipe.cli.main import cli
from ibrpipe.errors import FormatError, MissingFileError
from ibrpipe.io.photos.exif import read_exif
from ibrpipe.io.photos.extra_formats import without_raw_twins
from ibrpipe.io.photos.image_files import read_header
from ibrpipe.io.photos.images import read_image

PATCHES = np.array([[[0.2, 0.4, 0.1], [0.05, 0.6, 0.5]]])


@pytest.fixture
def raw(tmp_path: Path) -> Path:
    """Two patches of 40 pixels, seen by a sensor that is half as sensitive to red and to blue by 0.7."""
    pytest.importorskip("rawpy")
    path = tmp_path / "a.dng"
    write_dng(path, PATCHES.repeat(48, 0).repeat(40, 1), (0.5, 1.0, 0.7))
    return path


@pytest.fixture
def heic(tmp_path: Path) -> Path:
    """A ramp of grey, 64 x 48, stored lying on its side, with notes."""
    pillow_heif = pytest.importorskip("pillow_heif")
    from PIL import Image

    exif = Image.Exif()
    exif[0x010F], exif[0x0110], exif[0x0112] = "Maker", "Model", 6
    exif.get_ifd(0x8769).update({0x829A: 0.02, 0x829D: 4.0, 0x8827: 200, 0x920A: 5.1, 0xA405: 26})
    exif.get_ifd(0x8825).update({1: "S", 2: (33.0, 51.0, 36.0), 3: "E", 4: (151.0, 12.0, 0.0), 5: b"\0", 6: 12.5})
    ramp = np.broadcast_to(np.arange(48, dtype=np.uint8)[:, None, None] * 5, (48, 64, 3))
    path = tmp_path / "b.HEIC"
    pillow_heif.from_pillow(Image.fromarray(ramp)).save(path, quality=-1, exif=exif.tobytes())
    return path


def test_a_raw_photo_is_developed_to_the_light_that_fell_on_it(raw: Path) -> None:
    light = read_image(raw)
    assert light.shape == (48, 80, 3)
    # inside the patches; LibRaw's own whites and 16 bits are good for a thousandth
    assert light[24, 20] == pytest.approx(PATCHES[0, 0], abs=1e-3)
    assert light[24, 60] == pytest.approx(PATCHES[0, 1], abs=1e-3)


def test_a_raw_photo_stands_upright_and_keeps_its_notes(raw: Path, tmp_path: Path) -> None:
    turned = tmp_path / "turned.dng"
    write_dng(turned, PATCHES.repeat(48, 0).repeat(40, 1), (0.5, 1.0, 0.7), orientation=6)
    header = read_header(turned)
    assert (header.width, header.height, header.orientation) == (48, 80, 1)
    assert read_image(turned).shape == (80, 48, 3)
    assert read_image(turned)[20, 24] == pytest.approx(PATCHES[0, 0], abs=1e-3)  # turned clockwise
    assert dict(header.metadata) == {"ExposureTime": 0.02, "FNumber": 4.0, "Exif:PhotographicSensitivity": 200.0}
    exif = read_exif(raw)
    assert exif.lens == "Maker Model 35 52"
    assert exif.focal == pytest.approx(52 / np.hypot(36, 24) * np.hypot(80, 48))


def test_a_heic_photo_is_read_upright_with_its_notes(heic: Path) -> None:
    header = read_header(heic)
    assert (header.width, header.height, header.orientation) == (48, 64, 1)
    light = read_image(heic)
    code = 255 * np.where(light <= 0.0031308, light * 12.92, 1.055 * light ** (1 / 2.4) - 0.055)
    wanted = np.broadcast_to(5 * np.arange(48)[None, ::-1, None], (64, 48, 3))
    assert np.abs(code - wanted).max() < 2.0  # lossless but for its conversion to YCbCr
    assert dict(header.metadata) == pytest.approx(
        {"ExposureTime": 0.02, "FNumber": 4.0, "Exif:PhotographicSensitivity": 200.0}
    )
    exif = read_exif(heic)
    assert exif.lens == "Maker Model 5.1 26"
    assert exif.gps == pytest.approx((-33.86, 151.2, 12.5))


@pytest.mark.parametrize(("name", "package"), [("a.heic", "heic"), ("a.cr3", "raw")])
def test_without_the_package_one_line_says_what_to_type(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, package: str
) -> None:
    monkeypatch.setitem(sys.modules, {"heic": "pillow_heif", "raw": "rawpy"}[package], None)
    capture = tmp_path / "photos"
    capture.mkdir()
    for number in range(3):
        (capture / f"{number}{name}").write_bytes(b"photo")
    for command in ("run", "inspect", "calibrate"):
        options = [] if command == "inspect" else ["--out", str(tmp_path / "out")]
        result = CliRunner().invoke(cli, [command, str(capture), *options])
        assert result.exit_code == 1
        line = result.stderr.splitlines()[-1]
        assert line.startswith(f"error: {capture / f'0{name}'}: reading .{name[2:]} needs a package; type: pip install")
        assert f"'ibrpipe[{package}]'" in line


@pytest.mark.parametrize("name", ["a.heic", "a.nef"])
def test_a_damaged_or_missing_photo_is_told(tmp_path: Path, name: str) -> None:
    pytest.importorskip("pillow_heif")
    pytest.importorskip("rawpy")
    with pytest.raises(MissingFileError, match="does not exist"):
        read_header(tmp_path / name)
    (tmp_path / name).write_bytes(b"no photo" * 100)
    with pytest.raises(FormatError, match="cannot be read as"):
        read_header(tmp_path / name)


def test_a_raw_file_beside_its_photo_counts_once(raw: Path, tiny_ball: Path, tmp_path: Path) -> None:
    photos = tmp_path / "photos"
    photos.mkdir()
    shutil.copy(sorted((tiny_ball / "images").iterdir())[0], photos / "a.png")
    shutil.copy(raw, photos / "a.dng")
    shutil.copy(raw, photos / "b.dng")
    assert [photo.name for photo in photos_of(photos)] == ["a.png", "b.dng"]
    told = CliRunner().invoke(cli, ["inspect", str(photos)]).stdout
    assert "1 raw files beside photos of the same name are left out" in " ".join(told.split())
    assert without_raw_twins([raw]) == [raw]
