"""Photos that stand too far apart for depth are told of, with what to shoot; those near enough are not."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from plane_scene import HEIGHT, PLACES, WIDTH, camera_at, take, true_depth

from ibrpipe.capture.view_spacing import Spacing
from ibrpipe.evaluation.report.surface_words import surface_sentences
from ibrpipe.io.dense import DepthMap
from ibrpipe.io.documents.geometry import Geometry
from ibrpipe.io.views import View, ViewSet
from ibrpipe.reconstruction.depth.spacing import angles_between, spacing_of, warning
from ibrpipe.stages import geometry
from ibrpipe.types import Camera


@pytest.mark.parametrize("known", [True, False])
def test_angles_are_those_at_what_the_depth_map_shows(tmp_path: Path, known: bool) -> None:
    views = [take(tmp_path, n, camera_at(place)) for n, place in enumerate(PLACES)]
    depth = true_depth(views[0].camera) * (1 if known else 0)
    found = angles_between(views[0], views[1:], depth.astype(np.float32), 4.0)
    middle = np.array([0, 0, 4.0])
    for view, angle in zip(views[1:], found, strict=True):
        one, two = views[0].camera.center - middle, view.camera.center - middle
        expected = np.degrees(np.arccos(one @ two / np.linalg.norm(one) / np.linalg.norm(two)))
        assert angle == pytest.approx(expected, rel=0.1)


def ring_or_sphere(count: int, row: bool) -> list[DepthMap]:
    """Maps of photos that look at the origin from a ring, or from all over a sphere; eight neighbours each."""
    n = np.arange(count) + 0.5
    height, turn = (n * 0, n / count * 2 * np.pi) if row else (1 - 2 * n / count, n * np.pi * (1 + 5**0.5))
    flat = np.sqrt(1 - height**2)
    place = np.stack([flat * np.cos(turn), flat * np.sin(turn), height], axis=1)
    camera = Camera.look_at([1, 0, 0], [0, 0, 0], up=(0, 0, 1), fov_y_deg=40, width=WIDTH, height=HEIGHT)
    angles = np.sort(np.degrees(np.arccos(np.clip(place @ place.T, -1, 1))), axis=1)[:, 1:9]
    view = View("a", camera, Path("a.png"))
    return [DepthMap(view, Path("a.bin"), angles=tuple(map(float, each))) for each in angles]


@pytest.mark.parametrize(("count", "row"), [(10, True), (14, True), (40, False), (60, False)])
def test_as_many_photos_as_are_advised_stand_near_enough(count: int, row: bool) -> None:
    found = spacing_of(ring_or_sphere(count, row))
    assert found is not None
    assert found.too_wide
    enough = found.photos_for(count)
    after = spacing_of(ring_or_sphere(enough, row))
    assert after is not None
    assert 18 < after.second <= 20.5
    line = warning(found, count, 0.6)
    assert line is not None
    assert f"about {enough - count} more photos between those {count}" in line
    assert f"{found.second:.0f} to the second" in line
    assert "60% of the pixels" in line
    assert warning(found, count, 0.8) is None  # depth agrees all the same: a glossy vase, a gold cape


def test_photos_near_each_other_are_not_warned_about() -> None:
    near = Spacing(8.0, 8.1, 16.0, 38.0)  # a ring of photos of a thing without texture
    assert warning(near, 48, 0.2) is None
    assert near.photos_for(48) == 48
    assert spacing_of([DepthMap(each.view, each.depth) for each in ring_or_sphere(5, True)]) is None  # depth was given
    pair = spacing_of([DepthMap(each.view, each.depth, angles=(25.0,)) for each in ring_or_sphere(2, True)])
    assert pair == Spacing(25.0, 25.0, 25.0, 25.0)
    assert "25 degrees to the nearest neighbour; medians" in (warning(pair, 2, 0.6) or "")


def test_the_warning_is_in_the_document_the_report_and_what_the_stage_tells(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = geometry._spacing(ring_or_sphere(40, False), 40, 0.6)
    document = {"decision": "photos", "reason": "depth agrees", "vertices": 3, "faces": 1, **found}
    made = Geometry.model_validate({"schema": 1, **document})
    assert made.spacing_deg == found["spacing_deg"]
    assert surface_sentences(None, made)[0] == f"Warning: {found['warnings'][0]}."
    monkeypatch.setattr(geometry, "_from_photos", lambda *_: document)
    views = tuple(each.view for each in ring_or_sphere(40, False))
    monkeypatch.setattr(geometry, "read_views", lambda _: ViewSet(views))
    outputs = geometry.run(geometry.Inputs(tmp_path / "views.json", 0, tmp_path), geometry.GeometryConfig())
    assert json.loads(outputs.geometry.read_text(encoding="utf-8"))["warnings"] == found["warnings"]
    assert (tmp_path / "summary.txt").read_text(encoding="utf-8") == f"warning: {found['warnings'][0]}\n"
