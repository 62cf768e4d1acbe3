"""How far apart photos stand: angles against what they were made with, and what is told of them."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from textured_corner import HEIGHT, WIDTH, cameras, write_photos

from ibrpipe.calibration.spacing import ENOUGH, shared_of, words
from ibrpipe.capture.view_spacing import WANTED
from ibrpipe.errors import CaptureError
from ibrpipe.io.cameras.colmap_write import ModelImage, SparseModel
from ibrpipe.io.cameras.lenses import Lens
from ibrpipe.io.photos.images import write_png
from ibrpipe.stages.calibrate import CalibrateConfig, Inputs, run
from ibrpipe.types import Array, Camera


def ring(degrees: list[float], points: Array, seen: list[Array] | None = None) -> SparseModel:
    """Photos at these places of a circle around the points, which all or some of them see."""
    images = []
    for index, place in enumerate(np.radians(degrees)):
        camera = Camera.look_at((50 * np.cos(place), 50 * np.sin(place), 0), (0, 0, 0), (0, 0, 1), 40.0, 64, 48)
        which = np.arange(len(points)) if seen is None else seen[index]
        images.append(ModelImage(f"{index}.png", 0, camera.cam_from_world, np.zeros((len(which), 2)), which))
    lens = Lens("SIMPLE_PINHOLE", (60.0, 32.0, 24.0), 64, 48)
    return SparseModel((lens,), tuple(images), points, np.zeros((len(points), 3), np.uint8), np.zeros(len(points)))


@pytest.fixture
def cloud() -> Array:
    return np.random.default_rng(0).normal(0.0, 0.01, (60, 3))


def test_angles_are_those_of_the_circle(cloud: Array) -> None:
    found = shared_of(ring([0, 10, 20, 45, 80], cloud), [0.2] * 5)
    assert found is not None
    assert found.spacing.nearest == pytest.approx(10.0, abs=0.05)  # 10, 10, 10, 25, 35
    assert found.spacing.second == pytest.approx(20.0, abs=0.05)  # 20, 10, 20, 35, 60
    assert found.widest == ("4.png", "3.png")
    assert found.widest_deg == pytest.approx(35.0, abs=0.1)
    assert found.matched == 0.2


def test_photos_that_share_few_points_are_no_partners(cloud: Array) -> None:
    halves = [np.arange(35), np.arange(30, 60), np.arange(28)]
    found = shared_of(ring([0, 5, 30], cloud, halves), [0.2] * 3)
    assert found is not None
    assert found.spacing.nearest == pytest.approx(30.0, abs=0.05)  # 0 and 1 share 5 points, 1 and 2 none
    assert shared_of(ring([0, 5], cloud, [np.arange(30), np.arange(30, 60)]), [0.2] * 2) is None


@pytest.mark.parametrize(
    ("step", "matched", "wide"), [(12.0, 0.05, True), (11.0, 0.05, False), (40.0, ENOUGH + 0.01, False)]
)
def test_far_apart_is_told_where_little_is_shared(cloud: Array, step: float, matched: float, wide: bool) -> None:
    found = shared_of(ring([0, step, 2 * step], cloud), [matched] * 3)  # the second nearest is two steps away
    assert found is not None
    assert found.too_wide is wide


def test_the_remedy_names_how_many_and_where(cloud: Array) -> None:
    found = shared_of(ring([0, 30, 60, 90, 135], cloud), [0.05] * 5)
    assert found is not None
    text, remedy = words(found, 5)
    assert "30 degrees to the nearest, 45 to the second nearest" in text
    assert "shares 5% of its features" in text
    assert remedy == "take about 7 more photos between those 5, first between 4.png and 3.png (45 degrees apart)"


def document_of(capture: Path, out: Path, **settings: object) -> dict:
    out.mkdir(parents=True)
    made = run(Inputs(capture, 0, out), CalibrateConfig(**settings))
    return json.loads(made.calibration_document.read_text(encoding="utf-8"))


def test_three_photos_far_apart_and_one_whose_mask_is_empty(tmp_path: Path) -> None:
    shots = cameras(8)
    write_photos(tmp_path / "capture", [shots[0], shots[3], shots[7], shots[4]])
    (tmp_path / "capture/masks").mkdir()
    for index in range(4):
        write_png(tmp_path / f"capture/masks/{index:03d}.png", np.full((HEIGHT, WIDTH), float(index != 3)))
    document = document_of(tmp_path / "capture", tmp_path / "out")
    told = {each["file"]: each for each in document["findings"] if each["severity"] == "warning"}
    assert told["003.png"]["text"] == "is left out: its mask keeps no pixel"
    assert told["003.png"]["remedy"] == "correct or remove the mask"
    assert "stand far apart" in told["photos"]["text"]
    assert "001.png" in told["photos"]["remedy"]
    assert document["spacing"]["second_deg"] > WANTED
    assert "warning: photos: stand far apart" in (tmp_path / "out/summary.txt").read_text(encoding="utf-8")


def test_two_photos_that_match_but_fix_no_cameras_are_told_to_be_few(tmp_path: Path) -> None:
    shots = cameras(8)
    write_photos(tmp_path / "capture", shots[3:5])
    with pytest.raises(CaptureError, match=r"share \d+ matches, but two photos alone seldom fix .*; take at least 3"):
        document_of(tmp_path / "capture", tmp_path / "out")
