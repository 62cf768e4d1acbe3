from pathlib import Path

import numpy as np
import pytest

from ibrpipe.errors import CaptureError, FormatError
from ibrpipe.io.photos.exposure import exif_stops, gains_from_csv, gains_from_exif, read_exposure_csv
from ibrpipe.io.photos.image_files import ImageHeader
from ibrpipe.io.photos.images import write_png
from ibrpipe.io.photos.masks import MaskChoice, find_mask


@pytest.fixture
def capture(tmp_path):
    for folder in ("images/left", "masks/left"):
        (tmp_path / folder).mkdir(parents=True)
    return tmp_path


def choose(capture, named=None, alpha=False):
    return find_mask(capture, "left/a.jpg", capture / "images/left/a.jpg", named, alpha)


CONVENTIONS = {
    "masks/left/a.jpg.png": "nonzero",
    "masks/left/a.png": "coverage",
    "masks/left/a.mask.png": "nonzero",
    "images/left/a.mask.png": "nonzero",
}


@pytest.mark.parametrize("place", CONVENTIONS)
def test_every_convention_is_found(capture, place):
    write_png(capture / place, np.ones((2, 2)))
    assert choose(capture) == MaskChoice(capture / place, rule=CONVENTIONS[place])


def test_files_win_over_alpha_and_the_named_one_over_all(capture):
    assert choose(capture, alpha=True) == MaskChoice(from_alpha=True)
    for place in reversed(CONVENTIONS):
        write_png(capture / place, np.ones((2, 2)))
        assert choose(capture, alpha=True).file == capture / place
    assert choose(capture, named=Path("m.png"), alpha=True) == MaskChoice(Path("m.png"))


def test_without_any_the_whole_photo_counts(capture):
    assert choose(capture) == MaskChoice()


def header(time=0.02, aperture=2.5, iso=800.0):
    return ImageHeader(
        4, 3, ("R",), True, 1, "x", {"ExposureTime": time, "FNumber": aperture, "Exif:PhotographicSensitivity": iso}
    )


def test_exif_stops():
    assert exif_stops(header(time=0.04)) - exif_stops(header()) == pytest.approx(1)
    assert exif_stops(header(iso=400)) - exif_stops(header()) == pytest.approx(-1)
    assert exif_stops(header(aperture=5.0)) - exif_stops(header()) == pytest.approx(-2)
    assert exif_stops(ImageHeader(4, 3, ("R",), True, 1, "x")) is None


def test_exif_gains_bring_all_to_the_median():
    assert gains_from_exif([header(), header(), header(time=0.04)]) == pytest.approx([1, 1, 0.5])
    assert gains_from_exif([header(), ImageHeader(4, 3, ("R",), True, 1, "x")]) is None


def test_exif_is_read_from_a_jpeg(tmp_path):
    import OpenImageIO as oiio

    from ibrpipe.io.photos.image_files import read_header

    spec = oiio.ImageSpec(8, 8, 3, "uint8")
    for name, value in (("ExposureTime", 0.01), ("FNumber", 4.0)):
        spec.attribute(name, value)
    spec.attribute("Exif:PhotographicSensitivity", 200)
    target = oiio.ImageOutput.create(str(tmp_path / "a.jpg"))
    target.open(str(tmp_path / "a.jpg"), spec)
    target.write_image(np.zeros((8, 8, 3), np.uint8))
    target.close()
    assert exif_stops(read_header(tmp_path / "a.jpg")) == pytest.approx(np.log2(0.01 * 200 / 16), abs=1e-3)


def table(tmp_path, text):
    (tmp_path / "exposure.csv").write_text(text, encoding="utf-8")
    return tmp_path / "exposure.csv"


def test_csv_stops_become_gains(tmp_path):
    path = table(tmp_path, "file,iso,relative_exposure_stops\na.jpg,100,1\nsub/b.jpg,100,-0.5\n")
    stops = read_exposure_csv(path)
    assert gains_from_csv(stops, ["x/a.jpg", "sub/b.jpg"], path) == pytest.approx([0.5, 2**0.5])


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "expected a column named 'file'"),
        ("photo,relative_exposure_stops\na.jpg,1\n", r"has columns \['photo'.*expected a column named 'file'"),
        ("file,stops\na.jpg,1\n", "expected a column named 'relative_exposure_stops'"),
        ("file,relative_exposure_stops\na.jpg,bright\n", "line 2: .* is 'bright'; expected a finite number"),
        ("file,relative_exposure_stops\na.jpg,nan\n", "line 2: .* is 'nan'"),
        ("file,relative_exposure_stops\na.jpg\n", "line 2: .* is None"),
        ("file,relative_exposure_stops\na.jpg,1\na.jpg,2\n", "line 3: a.jpg is named twice"),
    ],
)
def test_bad_tables_are_told(tmp_path, text, words):
    with pytest.raises(FormatError, match=words):
        read_exposure_csv(table(tmp_path, text))


def test_photos_without_a_line_are_told(tmp_path):
    with pytest.raises(CaptureError, match=r"1 of 2 photos have no line, the first is b.jpg"):
        gains_from_csv({"a.jpg": 0.0}, ["a.jpg", "b.jpg"], tmp_path / "exposure.csv")
