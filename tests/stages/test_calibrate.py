"""Stage calibrate on photos of a textured corner whose cameras are known exactly."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
from textured_corner import HEIGHT, WIDTH, cameras, texture, write_photos

from ibrpipe.calibration.compare import compare_cameras
from ibrpipe.engine.executor import executor
from ibrpipe.errors import CaptureError, FormatError, IbrError, MissingFileError, ResourceError
from ibrpipe.io.captures import read_capture
from ibrpipe.io.documents.calibration import Calibration
from ibrpipe.io.photos.images import read_image, write_png
from ibrpipe.io.points import read_points
from ibrpipe.io.surfaces.meshes import write_mesh
from ibrpipe.io.views import read_views
from ibrpipe.stages import calibrate, ingest
from ibrpipe.stages.calibrate import CalibrateConfig, Inputs, run
from ibrpipe.synthetic.layout import write_colmap_text
from ibrpipe.types import Camera, Mesh

COUNT = 7
NAMES = [f"{index:03d}.png" for index in range(COUNT)]


def calibrated(capture: Path, out: Path, **settings: object) -> dict:
    """Run the stage; return calibration.json, checked."""
    out.mkdir(parents=True, exist_ok=True)
    outputs = run(Inputs(capture, 0, out), CalibrateConfig(**settings))
    document = json.loads(outputs.calibration_document.read_text(encoding="utf-8"))
    Calibration.model_validate(document)
    return document


@pytest.fixture(scope="module")
def photos(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Capture folder with photos only; and beside it the true cameras."""
    root = tmp_path_factory.mktemp("corner") / "Aufnahme ä 写真"
    shots = cameras(COUNT)
    write_photos(root, shots)
    write_colmap_text(root.parent / "truth", NAMES, shots)
    return root


@pytest.fixture(scope="module")
def found(photos: Path) -> Path:
    """The calibrate folder of the photos."""
    with executor(2):
        calibrated(photos, photos.parent / "run ä" / "calibrate")
    return photos.parent / "run ä" / "calibrate"


def truth(photos: Path) -> Path:
    return photos.parent / "truth"


def test_cameras_are_found_to_a_thousandth_of_the_arc(photos: Path, found: Path) -> None:
    document = json.loads((found / "calibration.json").read_text(encoding="utf-8"))
    assert (document["decision"], document["registered"], document["alignment"]["source"]) == ("found", COUNT, "own")
    assert document["reprojection_error_px"]["mean"] < 0.5
    errors = compare_cameras(found, truth(photos))
    assert errors["photos"] == COUNT
    assert errors["center_mean_over_extent"] < 2e-3
    assert errors["rotation_mean_deg"] < 0.3
    assert errors["focal_over_truth"] == pytest.approx(1.0, abs=0.01)
    assert f"{COUNT} of {COUNT} photos calibrated" in (found / "summary.txt").read_text(encoding="utf-8")


def test_own_world_is_upright_and_a_camera_distance_wide(found: Path) -> None:
    from ibrpipe.io.cameras.colmap import read_model

    poses = np.array([shot.cam_from_world for shot in read_model(found / "sparse/0", found)])
    assert (-poses[:, 1, 2]).min() > 0.5  # up in the photos is up in the world
    centers = -np.einsum("nji,nj->ni", poses[:, :, :3], poses[:, :, 3])
    assert 0.7 < np.median(np.linalg.norm(centers, axis=1)) < 1.4


def test_no_byte_depends_on_threads_or_chance(photos: Path, found: Path, tmp_path: Path) -> None:
    with executor(1):
        calibrated(photos, tmp_path / "calibrate")
    for name in ("cameras.txt", "images.txt", "points3D.txt"):
        assert (tmp_path / "calibrate/sparse/0" / name).read_bytes() == (found / "sparse/0" / name).read_bytes()


def test_ingest_takes_cameras_and_points_and_leaves_a_foreign_mesh(photos: Path, found: Path, tmp_path: Path) -> None:
    capture = Path(shutil.copytree(photos, tmp_path / "capture"))
    write_mesh(Mesh(np.eye(3), np.array([[0, 1, 2]])), capture / "mesh.ply")
    done = ingest.run(ingest.Inputs(capture, tmp_path / "ingest", found), ingest.IngestConfig(hold_out_every=4))
    views = read_views(done.views)
    assert (len(views.train), len(views.test)) == (5, 2)
    points = read_points(tmp_path / "ingest/points.npz")
    assert len(points.xyz) > 100
    assert points.views.max() == 4
    assert done.given is None
    assert any("mesh.ply is left out" in note for note in views.info["notes"])


def test_a_model_is_read_by_colmap_itself(found: Path) -> None:
    import subprocess
    import sys

    code = (
        "from ibrpipe.native_imports import import_pycolmap as p; r = p().Reconstruction(); r.read(r'%s'); "
        "r.update_point_3d_errors(); print(r.num_reg_images(), r.compute_mean_reprojection_error())"
    )
    told = subprocess.run([sys.executable, "-c", code % (found / "sparse/0")], capture_output=True, text=True)
    count, error = told.stdout.split()
    assert int(count) == COUNT
    document = json.loads((found / "calibration.json").read_text(encoding="utf-8"))
    assert float(error) == pytest.approx(document["reprojection_error_px"]["mean"], rel=0.2)


def test_given_cameras_are_left_alone(tiny_ball: Path, tmp_path: Path) -> None:
    assert calibrated(tiny_ball, tmp_path / "out")["decision"] == "given"
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["calibration.json"]


def test_photos_that_do_not_fit_are_told(photos: Path, found: Path, tmp_path: Path) -> None:
    capture = Path(shutil.copytree(photos, tmp_path / "capture"))
    write_png(capture / "images/100.png", texture(9)[:HEIGHT, :WIDTH])
    write_png(capture / "images/101.png", np.full((HEIGHT, WIDTH), 0.4))
    shutil.copytree(found.parent / ".calibrate.work", tmp_path / ".calibrate.work")
    document = calibrated(capture, tmp_path / "calibrate")
    assert document["registered"] == COUNT
    told = {each["file"]: each for each in document["findings"]}
    assert "left out" in told["100.png"]["text"]
    assert "only 0 features" in told["101.png"]["text"]
    assert "take it again" in told["101.png"]["remedy"]
    summary = (tmp_path / "calibrate/summary.txt").read_text(encoding="utf-8")
    assert "warning: 101.png: is left out" in summary
    with pytest.raises(CaptureError, match=r"only 7 of 9 photos could be calibrated, expected at least 90%.*100.png"):
        calibrated(capture, tmp_path / "calibrate", min_registered=0.9)


def test_photos_of_two_sizes_have_a_lens_each(photos: Path, tmp_path: Path) -> None:
    capture = Path(shutil.copytree(photos, tmp_path / "capture"))
    for name in (NAMES[2], NAMES[4]):
        picture = cv2.imread(str(tmp_path / "capture/images" / name))
        assert picture is not None
        small = cv2.resize(picture, (256, 192), interpolation=cv2.INTER_AREA)
        cv2.imwrite(str(capture / "images" / name), small)
    document = calibrated(capture, tmp_path / "calibrate")
    assert document["registered"] == COUNT
    assert sorted((lens["width"], lens["photos"]) for lens in document["lenses"]) == [(256, 2), (320, 5)]
    errors = compare_cameras(tmp_path / "calibrate", truth(photos))
    assert errors["center_mean_over_extent"] < 5e-3
    assert errors["rays_mean_deg"] < 0.3  # places are shares of the photo, so that sizes may differ


def test_two_sets_of_photos_come_as_two_models(tmp_path: Path) -> None:
    write_photos(tmp_path / "one", cameras(5))
    write_photos(tmp_path / "two", cameras(4), [texture(axis + 20) for axis in range(3)])
    for path in sorted((tmp_path / "two/images").iterdir()):
        path.rename(tmp_path / "one/images" / f"b{path.name}")
    document = calibrated(tmp_path / "one", tmp_path / "calibrate", mapper="incremental")
    assert document["registered"] == 5
    assert document["other_models"] == [[f"b{index:03d}.png" for index in range(4)]]
    (warning,) = [each for each in document["findings"] if each["severity"] == "warning"]
    assert "4 photos form a model of their own and are left out" in warning["text"]
    assert "take photos between" in warning["remedy"]


def corrupt_jpeg(capture: Path) -> None:
    cv2.imwrite(str(capture / "images/zzz.jpg"), (255 * texture(3)).astype(np.uint8))
    data = (capture / "images/zzz.jpg").read_bytes()
    (capture / "images/zzz.jpg").write_bytes(data[: len(data) // 2])


def only(capture: Path, count: int) -> None:
    for path in sorted((capture / "images").iterdir())[count:]:
        path.unlink()


def blank(capture: Path) -> None:
    for path in (capture / "images").iterdir():
        write_png(path, np.full((HEIGHT, WIDTH), 0.3))


def unrelated(capture: Path) -> None:
    only(capture, 1)
    write_png(capture / "images/x.png", texture(9)[:HEIGHT, :WIDTH])


def masked(capture: Path, value: float) -> None:
    (capture / "masks").mkdir()
    mask = np.zeros((HEIGHT, WIDTH))
    mask[:2, :2] = value
    for path in (capture / "images").iterdir():
        write_png(capture / "masks" / path.name, mask)


BROKEN = {
    "no folder": (lambda c: shutil.rmtree(c), "is no folder; give a capture folder"),
    "no photos": (lambda c: shutil.rmtree(c / "images"), "no photos found; expected JPEG.* in its images/"),
    "one photo": (lambda c: only(c, 1), "holds 1 photo; cameras need at least 2"),
    "unrelated photos": (unrelated, "no cameras could be found from the 2 photos: .*overlap by two thirds"),
    "blank photos": (blank, r"show no features \(at most 0 in one photo"),
    "masks of nothing": (lambda c: masked(c, 0.0), "000.png: the masks keep no pixel of any photo"),
    "masks of a speck": (lambda c: masked(c, 1.0), "show no features inside their masks"),
    "corrupt JPEG": (corrupt_jpeg, "zzz.jpg: the image is damaged"),
    "text for a photo": (lambda c: (c / "images/a.png").write_text("hello"), "a.png: cannot be read as an image"),
    "mask of another size": (
        lambda c: (masked(c, 1.0), write_png(c / "masks/001.png", np.ones((9, 9)))),
        "001.png: is 9 x 9 pixels but its photo is 320 x 240",
    ),
}


@pytest.mark.parametrize("case", BROKEN)
def test_what_is_broken_is_told_in_one_line(photos: Path, tmp_path: Path, case: str) -> None:
    damage, words = BROKEN[case]
    capture = Path(shutil.copytree(photos, tmp_path / "capture"))
    damage(capture)
    with pytest.raises(IbrError, match=f"(?s){words}") as caught:
        calibrated(capture, tmp_path / "calibrate", features=512)
    assert "\n" not in str(caught.value)
    assert list((tmp_path / "calibrate").iterdir()) == []


_NOWHERE = {"a": [0, 0], "b": [0, 0]}
WRONG: dict[str, tuple[dict[str, object], type[IbrError], str]] = {
    "no cameras to refine": ({"mode": "refine"}, CaptureError, "mode is refine, but the capture states no cameras"),
    "no markers": (
        {"markers": {"size": 0.1}},
        CaptureError,
        "markers of DICT_4X4_50 are not seen well enough: found not any marker, but none",
    ),
    "markers not set": ({"align": "markers"}, CaptureError, "calibrate.markers is not set"),
    "no positions file": ({"positions": "none.csv"}, MissingFileError, "none.csv: does not exist"),
    "no GPS": ({"align": "gps"}, CaptureError, "GPS tags: gives places for 0 of the calibrated photos"),
    "wrong lens": ({"camera_params": [300.0]}, CaptureError, "SIMPLE_RADIAL takes 4 parameters, got 1"),
    "distance nowhere": (
        {
            "distances": [
                {"length": 1, "start": {"000.png": [1, 1], "001.png": [300, 200]}, "end": {"a": [0, 0], "b": [0, 0]}}
            ]
        },
        CaptureError,
        "the ends of calibrate.distances.0 could not be located",
    ),
}


@pytest.mark.parametrize("case", WRONG)
def test_what_settings_name_must_be_there(photos: Path, found: Path, tmp_path: Path, case: str) -> None:
    settings, kind, words = WRONG[case]
    shutil.copytree(found.parent / ".calibrate.work", tmp_path / ".calibrate.work")
    with pytest.raises(kind, match=words):
        calibrated(photos, tmp_path / "calibrate", **settings)


def test_positions_must_be_numbers(photos: Path, found: Path, tmp_path: Path) -> None:
    shutil.copytree(found.parent / ".calibrate.work", tmp_path / ".calibrate.work")
    (tmp_path / "p.csv").write_text("file,x,y\n000.png,1,2\n")
    with pytest.raises(FormatError, match="expected a CSV file with columns file, x, y, z"):
        calibrated(photos, tmp_path / "calibrate", positions=str(tmp_path / "p.csv"))


def test_positions_give_the_world(photos: Path, found: Path, tmp_path: Path) -> None:
    shutil.copytree(found.parent / ".calibrate.work", tmp_path / ".calibrate.work")
    rows = [f"{name},{','.join(map(str, camera.center))}" for name, camera in zip(NAMES, cameras(COUNT))]
    (tmp_path / "p.csv").write_text("\n".join(["file,x,y,z", *rows]) + "\n")
    document = calibrated(photos, tmp_path / "calibrate", positions=str(tmp_path / "p.csv"))
    assert document["alignment"]["source"] == "positions"
    assert document["alignment"]["rms"] < 0.01
    assert compare_cameras(tmp_path / "calibrate", truth(photos))["scale"] == pytest.approx(1.0, abs=1e-6)


def pixels_of(point: tuple[float, float, float]) -> dict[str, list[float]]:
    """Where photos 1, 3 and 5 show a point of the world."""
    shots = cameras(COUNT)
    found = {}
    for index in (1, 3, 5):
        local = shots[index].R @ np.array(point) + shots[index].t
        found[NAMES[index]] = [float(value) for value in (shots[index].K @ local)[:2] / local[2]]
    return found


def test_a_known_distance_gives_the_scale(photos: Path, found: Path, tmp_path: Path) -> None:
    shutil.copytree(found.parent / ".calibrate.work", tmp_path / ".calibrate.work")
    wall = {"length": 1.5, "start": pixels_of((0, 0, 0)), "end": pixels_of((0, 0, 1.5))}
    document = calibrated(photos, tmp_path / "calibrate", distances=[wall])
    assert "known distance" in document["alignment"]["how"]
    assert compare_cameras(tmp_path / "calibrate", truth(photos))["scale"] == pytest.approx(1.0, abs=0.01)


def test_given_cameras_are_refined_in_their_own_world(photos: Path, found: Path, tmp_path: Path) -> None:
    capture = Path(shutil.copytree(photos, tmp_path / "capture"))
    random = np.random.default_rng(0)
    shaken = []
    for camera in cameras(COUNT):
        turn = cv2.Rodrigues(random.normal(size=3) * 0.004)[0]
        pose = np.concatenate([turn @ camera.R, (turn @ camera.t + random.normal(size=3) * 0.01)[:, None]], axis=1)
        shaken.append(Camera(camera.K, pose, WIDTH, HEIGHT))
    write_colmap_text(capture / "sparse/0", NAMES, shaken)
    shutil.copytree(found.parent / ".calibrate.work", tmp_path / ".calibrate.work")
    document = calibrated(capture, tmp_path / "calibrate", mode="refine", refine_intrinsics="no")
    assert (document["decision"], document["alignment"]["source"]) == ("refined", "given")
    before, after = (compare_cameras(path, truth(photos)) for path in (capture, tmp_path / "calibrate"))
    assert after["center_mean"] < before["center_mean"] / 3
    assert after["rotation_mean_deg"] < before["rotation_mean_deg"] / 3
    assert after["scale"] == pytest.approx(before["scale"], rel=0.01)
    assert document["alignment"]["mean_center_shift"] == pytest.approx(before["center_mean"], rel=0.5)


def truth_of(capture: Path, photos: Path) -> Path:
    """A copy of the true cameras, to be moved into a capture."""
    shutil.copytree(truth(photos), capture.parent / "copy/0")
    return capture.parent / "copy"


def test_photos_join_the_world_of_a_test_folder_with_cameras(photos: Path, tmp_path: Path) -> None:
    capture = Path(shutil.copytree(photos, tmp_path / "capture"))
    tests = cameras(4, turn=0.03)
    write_photos(capture / "test", tests)
    write_colmap_text(capture / "test/sparse/0", NAMES[:4], tests)
    document = calibrated(capture, tmp_path / "calibrate")
    assert document["alignment"]["source"] == "given"
    assert {photo["name"] for photo in document["photos"]} == {*NAMES, *(f"test/{name}" for name in NAMES[:4])}
    assert not (tmp_path / "calibrate/test").exists()
    errors = compare_cameras(tmp_path / "calibrate", truth(photos))
    assert errors["scale"] == pytest.approx(1.0, abs=5e-3)
    views = read_capture(capture, ingest.CaptureOptions(cameras=tmp_path / "calibrate"))
    assert (len(views.train), len(views.test)) == (COUNT, 4)
    off = [np.linalg.norm(view.camera.center - camera.center) for view, camera in zip(views.train, cameras(COUNT))]
    assert max(off) < 0.05
    shutil.move(truth_of(capture, photos), capture / "sparse")
    shutil.rmtree(capture / "test/sparse")
    document = calibrated(capture, tmp_path / "other")
    assert (document["alignment"]["source"], document["reason"]) == ("given", "part of the capture has no cameras")
    assert sorted(path.name for path in (tmp_path / "other").iterdir()) == ["calibration.json", "summary.txt", "test"]
    shutil.rmtree(capture / "sparse")
    document = calibrated(capture, tmp_path / "calibrate")
    assert (tmp_path / "calibrate/test/sparse/0/images.txt").is_file()
    assert document["registered"] == COUNT + 4


def test_markers_give_scale_origin_and_axes(tmp_path: Path) -> None:
    """A marker of edge 0.6 on the floor around (1, 1, 0), its upper edge towards +y; the photos' walls as ever."""
    walls = [texture(axis) for axis in range(3)]
    floor = walls[2].copy()
    scale = floor.shape[0] / 2.0
    size = round(0.6 * scale)
    marker = cv2.aruco.generateImageMarker(cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50), 7, size)
    patch = np.pad(marker.astype(np.float32) / 255.0, size // 6, constant_values=1.0)
    patch = patch[::-1]  # the texture's rows go along y: seen from above, the upper edge is towards +y
    start = round(scale - len(patch) / 2)
    floor[start : start + len(patch), start : start + len(patch)] = patch
    shots = cameras(COUNT)
    write_photos(tmp_path / "capture", shots, [walls[0], walls[1], floor])
    document = calibrated(tmp_path / "capture", tmp_path / "calibrate", markers={"size": 0.6})
    assert document["alignment"]["source"] == "markers"
    assert "markers 7, with marker 7 as the origin" in document["alignment"]["how"]
    assert document["alignment"]["rms"] < 0.01
    found = read_capture(tmp_path / "capture", ingest.CaptureOptions(0, cameras=tmp_path / "calibrate")).train
    for view, camera in zip(found, shots):
        assert np.allclose(view.camera.center, camera.center - (1.0, 1.0, 0.0), atol=0.12)


@pytest.mark.parametrize(
    ("code", "words"),
    [
        ("import os; os.abort()", "was ended by SIGABRT at: start; its last words are in .*log.txt"),
        ("import time; time.sleep(60)", r"took longer than 0.0[0-9]+ minutes \(it was at: start\)"),
        ("raise SystemExit(5)", "ended with code 5"),
    ],
)
def test_a_child_that_crashes_or_hangs_is_one_line(
    photos: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, code: str, words: str
) -> None:
    (tmp_path / "bad_child.py").write_text(code)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    monkeypatch.setattr(calibrate, "WORKER", "bad_child")
    with pytest.raises(ResourceError, match=words):
        calibrated(photos, tmp_path / "calibrate", time_limit=0.03)


def test_a_stopped_search_goes_on_with_what_it_had(photos: Path, tmp_path: Path) -> None:
    steps = []
    from ibrpipe.progress import listening

    class Stop(Exception):
        pass

    def stop(label: str, done: int, total: int) -> None:
        steps.append((label, done))
        if label == "match photos":
            raise Stop

    with pytest.raises(Stop), listening(stop):
        calibrated(photos, tmp_path / "calibrate")
    kept = {path: path.stat().st_mtime_ns for path in (tmp_path / ".calibrate.work/features").iterdir()}
    assert len(kept) == COUNT
    calibrated(photos, tmp_path / "calibrate")
    assert {path: path.stat().st_mtime_ns for path in kept} == kept


def test_masks_keep_features_inside(photos: Path, tmp_path: Path) -> None:
    from ibrpipe.calibration.features import find_features
    from ibrpipe.calibration.photos import photos_of

    capture = Path(shutil.copytree(photos, tmp_path / "capture"))
    (capture / "masks").mkdir()
    mask = np.zeros((HEIGHT, WIDTH))
    mask[60:200, 100:240] = 1.0
    names = ("000.png.png", "001.png", "002.mask.png")
    for name in names:
        write_png(capture / "masks" / name, mask)
    write_png(capture / "images/003.png", np.repeat(read_image(capture / "images/003.png")[:, :, :1], 3, 2), mask)
    entries = photos_of(capture)
    for entry in entries[:4]:
        spots = find_features(entry, 1000, 3200).keypoints
        assert len(spots) > 50
        assert (spots[:, :2] >= (100, 60)).all(), entry.name
        assert (spots[:, :2] <= (240, 200)).all(), entry.name
    whole = find_features(entries[4], 1000, 3200).keypoints
    small = find_features(entries[4], 1000, 200).keypoints
    assert (whole[:, 0] < 100).any()
    assert small[:, 0].max() > 0.9 * WIDTH  # places count in pixels of the file, whatever size was searched


def test_pairs_of_many_photos_are_those_that_look_alike() -> None:
    from ibrpipe.calibration.matching import matching
    from ibrpipe.calibration.pair_selection import sequential_pairs, similar_pairs

    random = np.random.default_rng(0)
    shared = random.random((30, 128)) ** 4
    chain = [np.concatenate([shared[4 * i : 4 * i + 12], random.random((40, 128)) ** 4]) for i in range(4)]
    described = [np.rint(512 * np.sqrt(each / each.sum(axis=1, keepdims=True))).astype(np.uint8) for each in chain]
    spots = [np.ones((len(each), 4), np.float32) for each in described]
    assert len(matching(described[0].astype(np.float32), described[1].astype(np.float32))) >= 7
    assert similar_pairs(spots, described, 1) == [(0, 1), (1, 2), (2, 3)]
    assert sequential_pairs(5, 2) == [(0, 1), (0, 2), (0, 4), (1, 2), (1, 3), (2, 3), (2, 4), (3, 4)]


def test_matches_are_the_mutual_nearest_ones_that_stand_out() -> None:
    from ibrpipe.calibration.matching import matching

    random = np.random.default_rng(1)
    base = random.random((900, 128)) ** 4
    halves = [base, (base[random.permutation(900)] + random.random((900, 128)) * random.random((900, 1)))[:700]]
    one, other = (np.rint(512 * np.sqrt(h / h.sum(axis=1, keepdims=True))).astype(np.uint8) for h in halves)
    angle = np.arccos(np.minimum(one.astype(np.int64) @ other.T.astype(np.int64) / 512**2, 1.0))
    wanted = []
    for i, row in enumerate(angle):  # plain twin
        j = int(row.argmin())
        second = np.delete(row, j).min()
        if angle[:, j].argmin() == i and row[j] < 0.8 * second and row[j] <= 0.7:
            wanted.append((i, j))
    assert 400 < len(wanted) < 700
    np.testing.assert_array_equal(matching(one.astype(np.float32), other.astype(np.float32)), wanted)
    assert matching(one[:1].astype(np.float32), other.astype(np.float32)).shape == (0, 2)


def test_all_at_once_places_the_same_cameras(photos: Path, found: Path, tmp_path: Path) -> None:
    shutil.copytree(found.parent / ".calibrate.work", tmp_path / ".calibrate.work")
    document = calibrated(photos, tmp_path / "calibrate", mapper="global", pairs="near")
    assert document["registered"] == COUNT
    assert compare_cameras(tmp_path / "calibrate", truth(photos))["center_mean_over_extent"] < 5e-3
