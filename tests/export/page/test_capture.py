"""Pages of captures and of runs without an asset: what is read, packed, bounded, told and refused."""

from __future__ import annotations

import json
import re
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from ibrpipe.cli.main import cli
from ibrpipe.errors import CaptureError, FormatError, MissingFileError
from ibrpipe.export.page import capture_page, capture_scene, photos
from ibrpipe.export.page.capture_page import make_capture_page, point_colors
from ibrpipe.export.page.capture_scene import read_capture_scene
from ibrpipe.export.page.geometry import STEPS, pack_places
from ibrpipe.export.page.measured import measured_psnr
from ibrpipe.export.page.notes import PageNotes
from ibrpipe.export.page.packing import Packer
from ibrpipe.io.surfaces.meshes import read_mesh, write_mesh
from ibrpipe.io.views import read_views, spread


def meta_of(page: str) -> dict:
    return json.loads(re.search(r'id="meta">(.*?)</script>', page)[1])


@pytest.fixture
def run(tmp_path: Path, measured) -> Path:
    """A run that has come as far as its geometry."""
    folder = tmp_path / "run"
    shutil.copytree(measured("ball").folder, folder / "ingest")
    mesh = read_mesh(folder / "ingest/mesh.ply")
    (folder / "geometry").mkdir()
    sure = np.linspace(0, 1, len(mesh.vertices), dtype=np.float32)
    write_mesh(mesh, folder / "geometry/mesh.ply", {"confidence": sure})
    return folder


def test_a_capture_becomes_a_page(tiny_ball: Path, tmp_path: Path) -> None:
    result = CliRunner().invoke(cli, ["export", str(tiny_ball), str(tmp_path / "a.html")])
    assert result.exit_code == 0, result.output
    assert "17 photos, 96 x 72 pixels at most" in result.output
    meta = meta_of((tmp_path / "a.html").read_text())
    capture = read_capture_scene(tiny_ball)
    assert [each["name"] for each in meta["photos"]] == [view.name for view in (*capture.train, *capture.test)]
    assert [each["heldOut"] for each in meta["photos"]] == [False] * 14 + [True] * 3
    np.testing.assert_array_equal(meta["photos"][0]["K"], capture.train[0].camera.K)
    # a unit ball: quantised to 65535 steps
    assert meta["bounds"]["radius"] == pytest.approx(1, abs=0.02)
    assert meta["floor"] == pytest.approx(-1, abs=0.02)
    assert meta["reach"] == pytest.approx(max(np.linalg.norm(view.camera.center) for view in capture.train), rel=0.1)


def test_a_run_shows_its_mesh_with_confidence(run: Path) -> None:
    scene = read_capture_scene(run)
    assert scene.name == "run"
    assert (scene.confidence[0], scene.confidence[-1]) == (0, 1)
    meta = meta_of(make_capture_page(scene, PageNotes()).text)
    assert meta["mesh"]["confidence"]["length"] == meta["mesh"]["count"] == len(scene.confidence)
    assert meta["mesh"]["color"] is None
    again = read_capture_scene(run / "ingest")
    assert again.confidence is not None
    shutil.rmtree(run / "geometry")
    assert read_capture_scene(run / "ingest/views.json").confidence is None


def test_places_are_kept_within_half_a_step() -> None:
    places = np.random.default_rng(0).uniform(-3, 5, (400, 3)) * (1, 0.2, 0)
    packed = pack_places(places, Packer())
    assert packed["step"] * STEPS == pytest.approx(np.ptp(places[:, 0]))
    codes = np.round((places - packed["low"]) / packed["step"])
    assert abs(packed["low"] + codes * packed["step"] - places).max() <= 0.5001 * packed["step"]
    assert pack_places(places[:1], Packer())["step"] == 1


def test_large_captures_are_thinned_and_told(run: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(capture_scene, "MOST_FACES", 200)
    monkeypatch.setattr(photos, "PIXELS", 17 * 40 * 30)
    scene = read_capture_scene(run)
    assert 150 < len(scene.mesh.mesh.faces) <= 200
    assert len(scene.confidence) == len(scene.mesh.mesh.vertices)
    page = make_capture_page(scene, PageNotes())
    assert re.search(r"17 photos, shrunk to 40 x 30 pixels at most.*; the mesh of \d+ triangles is shown as", page.told)
    assert [(each["width"], each["height"]) for each in meta_of(page.text)["photos"]] == [(40, 30)] * 17


def test_points_have_the_colours_of_photos_and_are_thinned(run: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    views = read_views(run / "ingest/views.json").train
    camera = views[3].camera
    pixels = np.array([[20, 30], [60, 40], [48, 36]])
    xyz = camera.center + 2.0 * camera.pixel_rays(pixels + 0.5)
    behind = camera.center - camera.pixel_rays(pixels[:1])
    np.savez(run / "ingest/points.npz", xyz=np.concatenate([xyz, behind]), error=np.zeros(4, np.float32),
             offsets=np.array([0, 2, 4, 6, 8]), views=np.array([3, 5] * 4, np.int32))  # fmt: skip
    scene = read_capture_scene(run)
    pictures = photos.load_pictures(views)
    found = point_colors(scene, pictures)
    np.testing.assert_array_equal(found[:3], pictures[3].color[pixels[:, 1], pixels[:, 0]])
    np.testing.assert_array_equal(found[3], [capture_page.GREY] * 3)
    monkeypatch.setattr(capture_scene, "MOST_POINTS", 2)
    thinned = read_capture_scene(run)
    assert thinned.told == ("2 of 4 points are shown",)
    np.testing.assert_array_equal(thinned.first_view, [3, 3])


def test_cameras_alone_say_where_to_look(run: Path) -> None:
    shutil.rmtree(run / "geometry")
    scene = read_capture_scene(run)
    bare = capture_scene.CaptureScene("bare", scene.train, (), None, None, None, None, ())
    meta = meta_of(make_capture_page(bare, PageNotes()).text)
    np.testing.assert_allclose(meta["bounds"]["centre"], 0, atol=0.3)  # the rig aims at the ball's middle
    assert meta["bounds"]["radius"] == pytest.approx(0.4 * meta["reach"], rel=0.2)


def test_words_of_captures_are_escaped(run: Path) -> None:
    evil = "</script><img src=x onerror=alert(1)>"
    scene = read_capture_scene(run)
    named = replace(scene, name=evil, train=(replace(scene.train[0], name=evil), *scene.train[1:]))
    page = make_capture_page(named, PageNotes()).text
    assert meta_of(page)["photos"][0]["name"] == evil
    assert "<img src=x" not in page
    assert page.count("</script>") == 3


def test_photos_without_cameras_are_told_what_to_type(tiny_ball: Path, tmp_path: Path) -> None:
    shutil.copytree(tiny_ball / "images", tmp_path / "photos/images")
    result = CliRunner().invoke(cli, ["view", str(tmp_path / "photos"), "--no-browser"])
    assert result.exit_code == 1
    assert f"no cameras are known for its 14 photos; find them with: ibrpipe run {tmp_path / 'photos'}" in result.stderr
    (tmp_path / "empty").mkdir()
    with pytest.raises(CaptureError, match="holds no asset, no run, and no photos"):
        read_capture_scene(tmp_path / "empty")
    with pytest.raises(MissingFileError, match="give an asset, a run, or a capture"):
        read_capture_scene(tmp_path / "nothing")
    (tmp_path / "empty/run.json").write_text("{}")
    with pytest.raises(MissingFileError, match="no checked photos yet; go on with ibrpipe run"):
        read_capture_scene(tmp_path / "empty")


def test_photos_that_are_gone_are_left_out_and_told(run: Path, caplog: pytest.LogCaptureFixture) -> None:
    scene = read_capture_scene(run)
    lost = replace(scene.train[0], image=run / "gone.png")
    page = make_capture_page(replace(scene, train=(lost, *scene.train[1:])), PageNotes())
    assert "1 of 17 photos are left out" in caplog.text
    assert len(meta_of(page.text)["photos"]) == 16
    with pytest.raises(CaptureError, match="none of its 1 photos can be found"):
        make_capture_page(replace(scene, train=(lost,), test=()), PageNotes())


def test_masks_come_as_bits(run: Path) -> None:
    views = read_views(run / "ingest/views.json")
    pictures = photos.load_pictures(spread(views.test, 2))
    packed = photos.pack_photos(pictures, Packer(), {views.test[0].name: 31.5})
    assert [each["psnr"] for each in packed] == [31.5, None]
    masked = [picture.mask is not None for picture in pictures]
    assert [each["mask"] is not None for each in packed] == masked
    if all(masked):
        assert packed[0]["mask"]["length"] == 96 * 72 // 8


def test_the_report_states_errors_of_the_mask_or_of_what_all_cover(tmp_path: Path) -> None:
    assert measured_psnr(tmp_path) == {}
    (tmp_path / "report").mkdir()
    scores = {"ldi": {"psnr": 30.0, "psnr_covered": 32.0, "ssim": 1.0}, "other": {"psnr": 9.0}}
    views = [{"name": "a", "renderers": scores}, {"name": "b", "renderers": {"ldi": {"psnr": None}}}]
    document = {"renderer": "ldi", "views": views, "machine": {}}
    path = tmp_path / "report/metrics.json"
    path.write_text(json.dumps(document))
    assert measured_psnr(tmp_path) == {"a": 30.0}
    path.write_text(json.dumps({**document, "headline": "covered"}))
    assert measured_psnr(tmp_path) == {"a": 32.0}
    path.write_text('{"views": 3}')
    with pytest.raises(FormatError, match="run the evaluate stage again"):
        measured_psnr(tmp_path)


def test_files_outside_a_capture_are_shown_where_that_is_allowed(
    tiny_ball: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shutil.copytree(tiny_ball, tmp_path / "capture")
    shutil.move(tmp_path / "capture/images", tmp_path / "elsewhere")
    (tmp_path / "capture/images").symlink_to(tmp_path / "elsewhere")
    monkeypatch.setattr("ibrpipe.export.page.server.PageServer.serve_forever", lambda self: None)
    refused = CliRunner().invoke(cli, ["view", str(tmp_path / "capture"), "--no-browser"])
    assert refused.exit_code == 1
    assert "--allow-outside of view" in refused.stderr
    shown = CliRunner().invoke(cli, ["view", str(tmp_path / "capture"), "--no-browser", "--allow-outside"])
    assert shown.exit_code == 0
    assert "http://127.0.0.1:" in shown.stdout
