"""Camera files as other programs and people write them: nothing is dropped or replaced without a word."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from camera_files import names, told

from ibrpipe.errors import CaptureError, FormatError
from ibrpipe.io.captures import read_capture

F = 125.5


@pytest.fixture
def nerf(capture: Path, tmp_path: Path) -> Path:
    """The capture with nerfstudio's cameras alone."""
    shutil.rmtree(capture / "sparse")
    (tmp_path / "transforms.json").rename(capture / "transforms.json")
    return capture


def change(root: Path, **keys: object) -> dict:
    path = root / "transforms.json"
    document = {**json.loads(path.read_text()), **keys}
    path.write_text(json.dumps(document))
    return document


# COLMAP


def test_images_of_one_line_each_are_all_read(capture: Path) -> None:
    path = capture / "sparse/0/images.txt"
    before = read_capture(capture)
    rows = [line for line in path.read_text().splitlines() if line.endswith(".png")]
    path.write_text("# written by a script\n" + "\n".join(rows) + "\n")
    after = read_capture(capture)
    assert names(after) == names(before)
    for one, two in zip(after.train, before.train, strict=True):
        assert (one.camera.cam_from_world == two.camera.cam_from_world).all()


def test_a_line_that_is_neither_image_nor_points_is_named(capture: Path) -> None:
    path = capture / "sparse/0/images.txt"
    rows = [line for line in path.read_text().splitlines() if line.endswith(".png")]
    rows[1] = rows[1].removesuffix(" 001.png")
    path.write_text("\n".join(rows) + "\n")
    with pytest.raises(FormatError, match=r"images.txt, line 2: expected ID QW"):
        read_capture(capture)


def test_points_after_an_image_are_not_images(capture: Path) -> None:
    path = capture / "sparse/0/images.txt"
    rows = [line for line in path.read_text().splitlines() if line.endswith(".png")]
    path.write_text("\n".join(f"{row}\n10.5 20.5 -1 30 40 7 50.25 60 8 1 2 9" for row in rows) + "\n")
    assert len(names(read_capture(capture))) == len(rows)


def test_of_several_models_the_largest_is_taken_and_the_rest_named(capture: Path, tmp_path: Path) -> None:
    shutil.copytree(capture / "sparse/0", capture / "sparse/1")
    path = capture / "sparse/0/images.txt"
    rows = [line for line in path.read_text().splitlines() if line.endswith(".png")]
    path.write_text("\n\n".join(rows[:5]) + "\n")
    text = told(capture, tmp_path)
    assert read_capture(capture).model == capture / "sparse/1"
    assert f"sparse/1 ({len(rows)} photos) is used, the largest; sparse/0 (5 photos) not" in text


def test_photos_without_poses_are_counted(capture: Path, tmp_path: Path) -> None:
    path = capture / "sparse/0/images.txt"
    rows = [line for line in path.read_text().splitlines() if line.endswith(".png")]
    path.write_text("\n\n".join(rows[3:]) + "\n")
    assert "3 of 14 photos" in told(capture, tmp_path)
    assert "the first is 000.png" in told(capture, tmp_path)


def test_names_of_a_model_may_differ_in_case_and_slashes(capture: Path) -> None:
    (capture / "images/left").mkdir()
    (capture / "images/000.png").rename(capture / "images/left/000.PNG")
    (capture / "masks/000.png").unlink()
    path = capture / "sparse/0/images.txt"
    path.write_text(path.read_text().replace(" 000.png", r" Left\000.png"))
    assert "left__000" in names(read_capture(capture))


# nerfstudio


def test_stated_test_photos_are_held_out(nerf: Path, tmp_path: Path) -> None:
    files = [f"images/{n:03d}.png" for n in range(14)]
    change(nerf, train_filenames=files[3:13], test_filenames=[f".\\{file}".replace("/", "\\") for file in files[1:3]])
    found = read_capture(nerf)
    assert [view.name for view in found.test] == ["001", "002"]
    assert [view.name for view in found.train] == [f"{n:03d}" for n in range(3, 13)]
    text = told(nerf, tmp_path)
    assert "2 photos are held out for measuring, as test_filenames" in text
    assert "2 of 14 photos are neither in train_filenames nor in test_filenames and are left out" in text


def test_val_stands_in_for_test(nerf: Path) -> None:
    change(nerf, val_filenames=["images/004.png"])
    found = read_capture(nerf)
    assert ([view.name for view in found.test], len(found.train)) == (["004"], 13)


def test_a_point_cloud_is_no_mesh(nerf: Path, tmp_path: Path) -> None:
    (nerf / "mesh.ply").unlink()
    cloud = (
        "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\nend_header\n"
    )
    (nerf / "sparse_pc.ply").write_text(cloud + "0 0 0\n")
    change(nerf, ply_file_path="sparse_pc.ply")
    assert read_capture(nerf).mesh is None
    assert "sparse_pc.ply, which transforms.json names, is a point cloud and no mesh" in told(nerf, tmp_path)


def test_names_with_dots_and_without_suffix(nerf: Path) -> None:
    document = change(nerf)
    for number, frame in enumerate(document["frames"]):
        for folder in ("images", "masks"):
            (nerf / folder / f"{number:03d}.png").rename(nerf / folder / f"shot.{number:04d}.png")
        frame["file_path"] = f"./images/shot.{number:04d}"
        frame.pop("mask_path", None)
    change(nerf, frames=document["frames"])
    found = read_capture(nerf)
    assert names(found) == [f"shot.{n:04d}" for n in range(14)]
    assert all(view.mask is not None for view in found.train)


@pytest.mark.parametrize(
    "pattern", ["images\\{}", "Images/{}", "C:\\scans\\ball\\images\\{}", "/home/me/ball/images/{}"]
)
def test_paths_of_other_machines_are_found(nerf: Path, pattern: str) -> None:
    document = change(nerf)
    for frame in document["frames"]:
        frame["file_path"] = pattern.format(Path(frame["file_path"]).name)
    change(nerf, frames=document["frames"])
    assert len(names(read_capture(nerf))) == 14


def test_a_frames_focal_length_comes_before_the_angle_or_length_of_the_file(nerf: Path) -> None:
    document = change(nerf)
    document["frames"][1]["camera_angle_x"] = 2 * np.arctan(48 / 200)
    document["frames"][2]["fl_x"] = 150.0
    change(nerf, fl_x=F, fl_y=F, frames=document["frames"])
    views = {view.name: view.camera.K for view in read_capture(nerf).train}
    assert views["001"][0, 0] == pytest.approx(200)
    assert (views["002"][0, 0], views["002"][1, 1]) == (150, 150)
    assert views["003"][0, 0] == F


def test_a_frame_of_its_own_size_needs_its_own_focal_length(nerf: Path) -> None:
    document = change(nerf)
    document["frames"][1] |= {"w": 48, "h": 36}
    change(nerf, frames=document["frames"], w=96, h=72, fl_x=F, cx=48.0, cy=36.0)
    with pytest.raises(CaptureError, match=r"states its own size 48 x 36 but not its own fl_x"):
        read_capture(nerf)


def test_blenders_three_files(nerf: Path, tmp_path: Path) -> None:
    document = change(nerf)
    angle = 2 * np.arctan(48 / document["fl_x"])
    for name, chosen in (("train", range(11)), ("test", range(11, 13)), ("val", range(13, 14))):
        (nerf / name).mkdir()
        frames = []
        for number, index in enumerate(chosen):
            (nerf / f"images/{index:03d}.png").rename(nerf / name / f"r_{number}.png")
            matrix = document["frames"][index]["transform_matrix"]
            frames.append({"file_path": f"./{name}/r_{number}", "rotation": 0.01, "transform_matrix": matrix})
        (nerf / f"transforms_{name}.json").write_text(json.dumps({"camera_angle_x": angle, "frames": frames}))
    (nerf / "transforms.json").unlink()
    shutil.rmtree(nerf / "images")
    found = read_capture(nerf)
    assert (len(found.train), [view.name for view in found.test]) == (11, ["test__r_0", "test__r_1"])
    assert all(view.held_out for view in found.test)
    assert "the photos of transforms_val.json are not used" in told(nerf, tmp_path)
    from ibrpipe.stages.calibrate import CalibrateConfig
    from ibrpipe.stages.calibrate import Inputs as CalibrateInputs
    from ibrpipe.stages.calibrate import run as calibrate

    done = calibrate(CalibrateInputs(nerf, 0, tmp_path / "calibrate"), CalibrateConfig()).calibration_document
    assert json.loads(done.read_text())["decision"] == "given"


def test_both_colmap_and_transforms(capture: Path, tmp_path: Path) -> None:
    """COLMAP's cameras are taken; masks and split of the other are kept, and what differs is told."""
    (tmp_path / "transforms.json").rename(capture / "transforms.json")
    (capture / "masks").rename(capture / "seg")
    document = change(capture)
    for frame in document["frames"]:
        frame["mask_path"] = f"seg/{Path(frame['file_path']).name}"
    change(capture, frames=document["frames"], test_filenames=["images/005.png"])
    agreeing = read_capture(capture)
    assert agreeing.warnings == ()
    assert [view.name for view in agreeing.test] == ["005"]
    assert agreeing.train[0].mask == capture / "seg/000.png"
    for frame in document["frames"]:
        matrix = np.array(frame["transform_matrix"])
        matrix[:3, 3] *= 2
        frame["transform_matrix"] = matrix.tolist()
    change(capture, frames=document["frames"])
    text = told(capture, tmp_path)
    assert "cameras are those of sparse/0, transforms.json gives masks of 14 photos" in text
    assert "the two place photos in different worlds" in text


def test_unplaced_photos_of_bundler_are_counted(capture: Path, tmp_path: Path) -> None:
    read = read_capture(capture)
    shutil.rmtree(capture / "sparse")
    flip, views = np.diag([1.0, -1.0, -1.0]), read.train + read.test
    lines = ["# Bundle file v0.3", f"{len(views) + 1} 0"]
    for view in views:
        rows = [*(flip @ view.camera.R).tolist(), (flip @ view.camera.t).tolist()]
        lines += [f"{F} 0 0", *(" ".join(map(repr, row)) for row in rows)]
    (capture / "bundle.out").write_text("\n".join([*lines, *["0 0 0"] * 5]) + "\n")
    (capture / "list.txt").write_text("\n".join([*(view.image.name for view in views), "lost.jpg"]) + "\n")
    assert "1 of 15 photos were not placed and are left out, the first is lost.jpg" in told(capture, tmp_path)


def test_camera_files_that_are_not_used_are_named(capture: Path, tmp_path: Path) -> None:
    (capture / "cameras.xml").write_text("<document/>")
    assert "cameras.xml is not used: cameras are those of COLMAP" in told(capture, tmp_path)


def test_photos_of_a_smaller_size_leave_the_originals_alone(nerf: Path) -> None:
    shutil.copytree(nerf / "images", nerf / "images_1")
    document = change(nerf)
    for frame in document["frames"]:
        frame["file_path"] = frame["file_path"].replace("images/", "images_1/")
        frame["depth_file_path"] = "depth/x.png"
    change(nerf, frames=document["frames"])
    found = read_capture(nerf)
    assert found.train[0].image.parent == nerf / "images_1"
    assert [text for text in found.warnings if "no camera" in text] == []
    assert "14 frames name depth maps, which are not used" in found.warnings[0]


def test_a_folder_called_test_may_hold_photos_of_the_same_file(nerf: Path) -> None:
    (nerf / "test").mkdir()
    document = change(nerf)
    (nerf / "images/000.png").rename(nerf / "test/r_0.png")
    document["frames"][0]["file_path"] = "test/r_0"
    change(nerf, frames=document["frames"], test_filenames=["test/r_0.png"])
    assert [view.name for view in read_capture(nerf).test] == ["test__r_0"]
