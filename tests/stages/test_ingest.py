import json
import shutil
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from ibrpipe.capture import audit
from ibrpipe.engine.artifacts import needs
from ibrpipe.errors import CaptureError
from ibrpipe.io.captures import read_capture
from ibrpipe.io.photos.images import read_image, write_png
from ibrpipe.io.surfaces.meshes import read_mesh
from ibrpipe.io.views import load_view, read_views
from ibrpipe.stages.ingest import STAGE, IngestConfig, Inputs, run
from ibrpipe.stages.registry import load_stages


@pytest.fixture
def capture(tiny_ball, tmp_path):
    return shutil.copytree(tiny_ball, tmp_path / "capture")


def ingest(capture, tmp_path, **settings):
    out = tmp_path / "out"
    out.mkdir(exist_ok=True)
    return run(Inputs(capture, out), IngestConfig(**settings))


def findings(outputs, kind):
    document = json.loads(outputs.audit.read_text(encoding="utf-8"))
    return [finding for finding in document["findings"] if finding["kind"] == kind]


def test_everything_is_written(capture, tmp_path):
    outputs = ingest(capture, tmp_path)
    views = read_views(outputs.views)
    assert (len(views.train), len(views.test)) == (14, 3)
    assert views.mesh == outputs.given
    assert (read_mesh(outputs.given).vertices == read_mesh(capture / "mesh.ply").vertices).all()
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == [
        "audit.json",
        "audit.txt",
        "mesh.ply",
        "summary.txt",
        "views.json",
    ]
    assert "14 photos, 3 held out" in outputs.audit_text.read_text(encoding="utf-8")


def test_same_capture_same_bytes(capture, tmp_path):
    first = {path.name: path.read_bytes() for path in vars(ingest(capture, tmp_path)).values() if path}
    again = {path.name: path.read_bytes() for path in vars(ingest(capture, tmp_path)).values() if path}
    assert first == again


def test_without_a_mesh_the_photos_are_audited_all_the_same(capture, tmp_path):
    (capture / "mesh.ply").unlink()
    (capture / "transforms.json").unlink()
    write_png(capture / "images/002.png", read_image(capture / "images/002.png") * 1e-4)
    outputs = ingest(capture, tmp_path)
    assert outputs.given is None
    assert read_views(outputs.views).mesh is None
    document = json.loads(outputs.audit.read_text(encoding="utf-8"))
    assert document["surface"] is None
    assert {(photo["seen"], photo["overlap"], photo["masked"]) for photo in document["photos"]} == {(None, None, True)}
    assert [finding["file"] for finding in findings(outputs, "black")] == ["002"]
    assert not (tmp_path / "out/mesh.ply").exists()


def test_a_calibration_replaces_the_cameras(capture, tmp_path):
    calibration = tmp_path / "calibrate"
    shutil.move(capture / "sparse", calibration / "sparse")
    shutil.move(capture / "test/sparse", calibration / "test/sparse")
    for place in (capture, capture / "test"):
        (place / "transforms.json").unlink()
    out = tmp_path / "out"
    out.mkdir()
    with pytest.raises(CaptureError, match=r"no cameras found.*ibrpipe calibrate"):
        run(Inputs(capture, out), IngestConfig())
    views = read_views(run(Inputs(capture, out, calibration), IngestConfig()).views)
    assert (len(views.train), len(views.test)) == (14, 3)
    assert all(view.image.parent == capture / "images" for view in views.train)


def test_a_calibration_comes_before_the_cameras_of_the_capture(capture, tmp_path):
    calibration = tmp_path / "calibrate"
    shutil.copytree(capture / "sparse", calibration / "sparse")
    cameras = calibration / "sparse/0/cameras.txt"
    cameras.write_text(cameras.read_text().replace(" 125.5", " 225.5"))
    out = tmp_path / "out"
    out.mkdir()
    views = read_views(run(Inputs(capture, out, calibration), IngestConfig()).views)
    assert int(views.train[0].camera.K[0, 0]) == 225
    assert int(views.test[0].camera.K[0, 0]) == 125


def test_the_mesh_fits_the_masks_of_every_photo(capture, tmp_path):
    document = json.loads(ingest(capture, tmp_path).audit.read_text())
    assert all(photo["overlap"] > 0.97 for photo in document["photos"])
    assert all(0.1 < photo["seen"] < 0.6 for photo in document["photos"])
    assert sum(document["surface"]["share_by_photos"].values()) == pytest.approx(1, abs=1e-5)


def blur(path, sigma):
    import cv2

    write_png(path, cv2.GaussianBlur(read_image(path), (0, 0), sigma))


def test_a_blurred_photo_is_found_and_no_other(capture, tmp_path):
    assert findings(ingest(capture, tmp_path), "blurred") == []
    blur(capture / "images" / "004.png", 2.0)
    assert [finding["file"] for finding in findings(ingest(capture, tmp_path), "blurred")] == ["004"]


def test_clipped_photos_are_found(capture, tmp_path):
    before = {finding["file"] for finding in findings(ingest(capture, tmp_path, clipped_share=0.2), "clipped")}
    assert "002" not in before
    path = capture / "images" / "002.png"
    write_png(path, read_image(path) * 20)
    after = findings(ingest(capture, tmp_path, clipped_share=0.2), "clipped")
    assert {finding["file"] for finding in after} - before == {"002"}
    assert after[0]["severity"] == "warning"


def test_black_photos_are_found(capture, tmp_path):
    path = capture / "images" / "002.png"
    write_png(path, read_image(path) * 1e-4)
    assert [finding["file"] for finding in findings(ingest(capture, tmp_path), "black")] == ["002"]


def test_a_photo_that_looks_away_is_found(capture, tmp_path):
    file = capture / "sparse/0/images.txt"
    lines = file.read_text().splitlines()
    index = next(i for i, line in enumerate(lines) if line.endswith(" 003.png"))
    words = lines[index].split()
    words[7] = str(-float(words[7]))  # the scene is behind the camera now
    lines[index] = " ".join(words)
    file.write_text("\n".join(lines) + "\n")
    outputs = ingest(capture, tmp_path)
    assert [finding["file"] for finding in findings(outputs, "sees nothing")] == ["003"]


def test_a_mask_that_does_not_fit_the_mesh_is_found(capture, tmp_path):
    mask = np.zeros((72, 96))
    mask[:30, :30] = 1
    mask[30:40, 40:60] = 1
    write_png(capture / "masks" / "005.png", mask)
    assert [finding["file"] for finding in findings(ingest(capture, tmp_path), "outline")] == ["005"]


def test_photos_from_the_same_place_are_found(capture, tmp_path):
    file = capture / "sparse/0/images.txt"
    lines = file.read_text().splitlines()
    first = next(line for line in lines if line.endswith(" 000.png"))
    index = next(i for i, line in enumerate(lines) if line.endswith(" 009.png"))
    lines[index] = first.replace("000.png", "009.png").replace("1 ", "10 ", 1)
    file.write_text("\n".join(lines) + "\n")
    found = findings(ingest(capture, tmp_path), "same pose")
    assert [(finding["file"], finding["value"]) for finding in found] == [("009", "has the same pose as 000")]


def test_a_test_view_that_repeats_a_photo_is_found(capture, tmp_path):
    text = (capture / "sparse/0/images.txt").read_text()
    pose = next(line for line in text.splitlines() if line.endswith(" 004.png")).split()[1:8]
    file = capture / "test/sparse/0/images.txt"
    lines = file.read_text().splitlines()
    index = next(i for i, line in enumerate(lines) if line.endswith(" 001.png"))
    words = lines[index].split()
    lines[index] = " ".join([words[0], *pose, *words[8:]])
    file.write_text("\n".join(lines) + "\n")
    (found,) = findings(ingest(capture, tmp_path), "same pose")
    assert "scores are flattered" in found["remedy"]


def test_surface_that_few_photos_see_is_found(capture, tmp_path):
    (found,) = findings(ingest(capture, tmp_path, thin_share=0.0), "thin coverage")
    assert "fewer than 3 photos see" in found["value"]
    assert findings(ingest(capture, tmp_path, thin_share=1.0), "thin coverage") == []


def test_large_photos_are_shrunk(capture, tmp_path):
    views = read_views(ingest(capture, tmp_path, max_pixels=48 * 36).views)
    view = views.train[0]
    assert (view.camera.width, view.camera.height) == (48, 36)
    assert view.full_size == (96, 72)
    colour, mask = load_view(view)
    assert colour.shape == (36, 48, 3)
    assert mask.shape == (36, 48)
    full = load_view(replace(view, camera=view.full_camera, full_size=None))[0]
    assert np.allclose(colour, full.reshape(36, 2, 48, 2, 3).mean(axis=(1, 3)), atol=1e-6)


def test_a_distorted_capture_agrees_with_its_mesh(capture, tmp_path):
    """Photos bent on purpose, then straightened: the mesh's outline fits the masks again, and not without."""
    import cv2

    from ibrpipe.io.cameras.lenses import Lens, _camera

    view = read_capture(capture).train[0]
    focal = view.camera.K[0, 0]
    lens = Lens("SIMPLE_RADIAL", (focal, 48.0, 36.0, 0.6), 96, 72)
    rows, columns = np.mgrid[0:72, 0:96] + 0.5
    rays = np.asarray(_camera(lens).cam_from_img(np.stack([columns.ravel(), rows.ravel()], axis=1)))
    x = (rays[:, 0] * focal + 48 - 0.5).reshape(72, 96).astype(np.float32)
    y = (rays[:, 1] * focal + 36 - 0.5).reshape(72, 96).astype(np.float32)
    for folder in ("images", "masks"):
        for path in (capture / folder).iterdir():
            write_png(path, cv2.remap(read_image(path), x, y, cv2.INTER_LINEAR))

    def overlaps():
        document = json.loads(ingest(capture, tmp_path).audit.read_text())
        return [photo["overlap"] for photo in document["photos"] if not photo["held_out"]]

    assert max(overlaps()) < 0.93
    cameras = capture / "sparse/0/cameras.txt"
    cameras.write_text(f"1 SIMPLE_RADIAL 96 72 {focal} 48 36 0.6\n")
    assert min(overlaps()) > 0.96


def test_the_stage_is_what_the_runner_expects():
    assert STAGE.name == STAGE.folder == "ingest"
    assert needs(STAGE, load_stages()) == ("capture", "calibrate")
    assert set(Inputs.__dataclass_fields__) == {"capture", "calibration", "out"}
    assert all(field.description for field in IngestConfig.model_fields.values())


def test_too_few_photos_are_told_with_what_holds_them_back() -> None:
    view = SimpleNamespace(name="a.png", masked=True)
    for test, remedy in (((), "add photos"), ((view,), "add photos, or hold out fewer (ingest.hold_out_every)")):
        capture = SimpleNamespace(root="capture", train=(view,), test=test)
        (found,) = [each for each in audit._count_findings(capture) if each.severity == "error"]  # type: ignore[arg-type]
        assert (found.value, found.remedy) == ("holds 1 photo(s) to build from", remedy)
