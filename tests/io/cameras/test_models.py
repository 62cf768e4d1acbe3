"""COLMAP text, COLMAP binary (old and with rigs) and transforms.json tell the same cameras."""

import contextlib
import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ibrpipe.errors import CaptureError, FormatError
from ibrpipe.io.cameras.colmap import find_model, read_model
from ibrpipe.io.cameras.lenses import Lens
from ibrpipe.io.cameras.transforms import pose_from_opengl, read_transforms
from ibrpipe.native_imports import import_pycolmap
from ibrpipe.types import Camera

SIZE = (96, 72)
LENSES = {
    1: Lens("PINHOLE", (101.5, 102.25, 47.0, 36.5), *SIZE),
    2: Lens("OPENCV", (101.0, 102.0, 48.0, 36.0, -0.1, 0.02, 0.001, -0.002), *SIZE),
    3: Lens("OPENCV_FISHEYE", (60.0, 61.0, 48.0, 36.0, 0.01, -0.002, 0.0, 0.0), *SIZE),
}
NAMES = ["a b.png", "b/é.png", "c.png", "d.png", "e.png"]


def poses():
    rng = np.random.default_rng(11)
    eyes = rng.normal(size=(len(NAMES), 3)) * 4
    return [Camera.look_at(eye, rng.normal(size=3) * 0.1, rng.normal(size=3)).cam_from_world for eye in eyes]


def lens_of(index):
    return LENSES[1 + index % 3]


def quaternion(rotation):
    """Quaternion w, x, y, z of a rotation matrix by its eigenvector: nothing shared with the code under test."""
    (a, b, c), (d, e, f), (g, h, i) = rotation
    symmetric = np.array(
        [
            [a - e - i, d + b, g + c, h - f],
            [d + b, e - a - i, h + f, c - g],
            [g + c, h + f, i - a - e, d - b],
            [h - f, c - g, d - b, a + e + i],
        ]
    )
    x, y, z, w = np.linalg.eigh(symmetric)[1][:, -1]
    return w, x, y, z


@pytest.fixture
def text_model(tmp_path):
    folder = tmp_path / "sparse" / "0"
    folder.mkdir(parents=True)
    cameras = [
        f"{key} {lens.model} {lens.width} {lens.height} {' '.join(map(repr, lens.params))}"
        for key, lens in LENSES.items()
    ]
    (folder / "cameras.txt").write_text("# cameras\n" + "\n".join(cameras) + "\n")
    lines = ["# images"]
    for index, (name, pose) in enumerate(zip(NAMES, poses())):
        numbers = [*quaternion(pose[:, :3]), *pose[:, 3]]
        lines += [
            f"{index + 1} {' '.join(repr(float(v)) for v in numbers)} {1 + index % 3} {name}",
            "1.5 2.5 -1" if index else "",
        ]
    (folder / "images.txt").write_text("\n".join(lines) + "\n", encoding="utf-8")
    (folder / "points3D.txt").write_text("")
    return folder


def write_transforms(path):
    frames = []
    for index, (name, pose) in enumerate(zip(NAMES, poses())):
        lens = lens_of(index)
        world_from_camera = np.linalg.inv(np.vstack([pose, [0, 0, 0, 1]])) @ np.diag([1, -1, -1, 1])
        frame = dict(zip(("fl_x", "fl_y", "cx", "cy"), lens.params[:4]))
        names = ("k1", "k2", "p1", "p2") if lens.model == "OPENCV" else ("k1", "k2", "k3", "k4")
        frame |= dict(zip(names, lens.params[4:]))
        frame["camera_model"] = "OPENCV_FISHEYE" if lens.model == "OPENCV_FISHEYE" else "OPENCV"
        frames.append(frame | {"file_path": f"images/{name}", "transform_matrix": world_from_camera.tolist()})
    path.write_text(json.dumps({"w": SIZE[0], "h": SIZE[1], "frames": frames}), encoding="utf-8")
    return path


def same(one, two, tolerance=1e-9):
    assert [shot.file for shot in one] == [shot.file for shot in two]
    for first, second in zip(one, two):
        assert first.lens.model == second.lens.model
        assert (first.lens.width, first.lens.height) == (second.lens.width, second.lens.height)
        assert np.allclose(first.lens.params, second.lens.params, rtol=0, atol=tolerance)
        assert np.abs(first.cam_from_world - second.cam_from_world).max() < tolerance


def without_blank(shots):
    """The names as pycolmap, which writes the other files here, reads them."""
    return [replace(shot, file=shot.file.split()[0]) for shot in shots]


def test_text_model_gives_the_poses_that_were_written(text_model):
    shots = read_model(text_model, Path("images"))
    assert [shot.file for shot in shots] == NAMES
    for index, (shot, pose) in enumerate(zip(shots, poses())):
        assert np.abs(shot.cam_from_world - pose).max() < 1e-9
        assert shot.lens == lens_of(index)
        assert shot.image == Path("images") / NAMES[index]


def test_reading_agrees_with_pycolmap(text_model):
    # the text reader of pycolmap ends names at a blank, hence the photo's place
    model = import_pycolmap().Reconstruction(str(text_model))
    for shot in read_model(text_model, Path("images")):
        image = model.images[NAMES.index(shot.file) + 1]
        assert np.abs(image.cam_from_world().matrix() - shot.cam_from_world).max() < 1e-12
        assert tuple(image.camera.params) == shot.lens.params
        assert image.camera.model_name == shot.lens.model


def test_binary_with_rigs_agrees_with_text(text_model, tmp_path):
    binary = tmp_path / "binary"
    binary.mkdir()
    import_pycolmap().Reconstruction(str(text_model)).write_binary(str(binary))
    assert (binary / "rigs.bin").is_file()
    assert (binary / "frames.bin").is_file()
    same(read_model(binary, Path("images")), without_blank(read_model(text_model, Path("images"))))


def test_old_binary_agrees_with_text(text_model, tmp_path):
    binary = tmp_path / "binary"
    binary.mkdir()
    import_pycolmap().Reconstruction(str(text_model)).write_binary(str(binary))
    (binary / "rigs.bin").unlink()
    (binary / "frames.bin").unlink()
    same(read_model(binary, Path("images")), without_blank(read_model(text_model, Path("images"))))


def test_text_with_rigs_agrees(text_model, tmp_path):
    newer = tmp_path / "newer"
    newer.mkdir()
    import_pycolmap().Reconstruction(str(text_model)).write_text(str(newer))
    assert (newer / "rigs.txt").is_file()
    same(read_model(newer, Path("images")), without_blank(read_model(text_model, Path("images"))))


def test_a_second_sensor_of_a_rig_gets_its_own_pose(tmp_path):
    """Two cameras fixed to each other: the model stores one pose per frame and one per sensor."""
    pycolmap = import_pycolmap()
    model = pycolmap.Reconstruction()
    rig, frame = pycolmap.Rig(rig_id=1), pycolmap.Frame(frame_id=1, rig_id=1)
    cameras = [
        pycolmap.Camera(camera_id=i, model="PINHOLE", width=96, height=72, params=[100, 100, 48, 36]) for i in (1, 2)
    ]
    for camera in cameras:
        model.add_camera(camera)
    first, second = poses()[:2]
    apart = np.vstack([second, [0, 0, 0, 1]]) @ np.linalg.inv(np.vstack([first, [0, 0, 0, 1]]))
    rig.add_ref_sensor(cameras[0].sensor_id)
    rig.add_sensor(cameras[1].sensor_id, pycolmap.Rigid3d(apart[:3]))
    model.add_rig(rig)
    images = [pycolmap.Image(image_id=i, camera_id=i, frame_id=1, name=f"{i}.png") for i in (1, 2)]
    frame.rig_from_world = pycolmap.Rigid3d(first)
    for image in images:
        frame.add_data_id(image.data_id)
    model.add_frame(frame)
    for image in images:
        model.add_image(image)
    model.register_frame(1)
    model.write_binary(str(tmp_path))
    shots = read_model(tmp_path, Path("images"))
    assert [shot.file for shot in shots] == ["1.png", "2.png"]
    for shot, pose in zip(shots, (first, second)):
        assert np.abs(shot.cam_from_world - pose).max() < 1e-9


def test_transforms_agree_with_text(text_model, tmp_path):
    shots, mesh = read_transforms(write_transforms(tmp_path / "transforms.json"))
    assert mesh is None
    same(shots, read_model(text_model, Path("images")))
    assert [shot.image for shot in shots] == [tmp_path / "images" / name for name in NAMES]


def test_the_fixture_capture_agrees_with_itself(tiny_ball):
    model = find_model(tiny_ball)
    shots, mesh = read_transforms(tiny_ball / "transforms.json")
    same(shots, read_model(model, tiny_ball / "images"))
    assert mesh == tiny_ball / "mesh.ply"
    assert shots[0].mask == tiny_ball / "masks" / "000.png"


def test_opengl_camera_looks_along_minus_z():
    # at (0, 0, 5) with identity rotation: sees the origin 5 ahead; OpenGL's up (world y) is up, so down in OpenCV is -y
    pose = pose_from_opengl(np.array([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 5], [0, 0, 0, 1.0]]))
    assert np.allclose(pose @ [0, 0, 0, 1], [0, 0, 5])
    assert np.allclose(pose @ [1, 2, 0, 1], [1, -2, 5])


def test_float32_matrices_are_made_rotations_again():
    pose = poses()[0]
    matrix = np.linalg.inv(np.vstack([pose, [0, 0, 0, 1]])) @ np.diag([1, -1, -1, 1])
    found = pose_from_opengl(matrix.astype(np.float32))
    assert np.abs(found[:, :3] @ found[:, :3].T - np.eye(3)).max() < 1e-12
    assert np.abs(found - pose).max() < 1e-5


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda m: m * np.array([2, 2, 2, 1.0]), "no rigid motion .determinant 8"),
        (lambda m: m * np.array([-1, 1, 1, 1.0]), "no rigid motion .determinant -1"),
        (lambda m: m * 0, "no rigid motion .determinant 0"),
        (lambda m: m * np.nan, "NaN"),
        (lambda m: m[:2], r"must be 4 x 4, got shape \(2, 4\)"),
    ],
)
def test_matrices_that_are_no_poses_are_told(change, words):
    with pytest.raises(CaptureError, match=words):
        pose_from_opengl(change(np.eye(4)))


def blender(tmp_path, **keys):
    frame = {"file_path": "./train/r_0", "transform_matrix": np.eye(4).tolist()}
    (tmp_path / "transforms.json").write_text(json.dumps({"w": 100, "h": 50, "frames": [frame], **keys}))
    return tmp_path / "transforms.json"


def test_blender_style_angle_and_names_without_suffix(tmp_path):
    (shot,), _ = read_transforms(blender(tmp_path, camera_angle_x=2 * np.arctan(0.5)))
    assert shot.image == tmp_path / "train" / "r_0.png"
    assert shot.lens.model == "PINHOLE"
    assert np.allclose(shot.lens.params, (100.0, 100.0, 50.0, 25.0))


def test_frame_keys_override_global_keys(tmp_path):
    frame = {"file_path": "images/a.png", "transform_matrix": np.eye(4).tolist(), "fl_x": 70, "w": 30}
    (tmp_path / "t.json").write_text(json.dumps({"w": 100, "h": 50, "fl_x": 90, "frames": [frame]}))
    (shot,), _ = read_transforms(tmp_path / "t.json")
    assert shot.lens.params == (70.0, 70.0, 15.0, 25.0)
    assert (shot.lens.width, shot.lens.height) == (30, 50)


@pytest.mark.parametrize(
    ("keys", "model"),
    [
        ({"k1": 0.1}, "OPENCV"),
        ({"k1": 0.1, "camera_model": "SIMPLE_RADIAL"}, "OPENCV"),
        ({"k1": 0.1, "k3": 0.2}, "FULL_OPENCV"),
        ({"k1": 0.1, "is_fisheye": True}, "OPENCV_FISHEYE"),
        ({"camera_model": "OPENCV_FISHEYE"}, "OPENCV_FISHEYE"),
        ({"camera_model": "SIMPLE_PINHOLE"}, "PINHOLE"),
    ],
)
def test_camera_models_of_transforms(tmp_path, keys, model):
    (shot,), _ = read_transforms(blender(tmp_path, fl_x=100, **keys))
    assert shot.lens.model == model


@pytest.mark.parametrize(
    ("keys", "error", "words"),
    [
        ({"fl_x": 100, "camera_model": "BANANA"}, CaptureError, "'BANANA' is not known"),
        ({"fl_x": 100, "k4": 0.1}, CaptureError, "k4 = 0.1 is not known"),
        ({"fl_x": -100}, CaptureError, "focal length is -100"),
        ({"fl_x": "wide"}, FormatError, "wide"),
        ({}, FormatError, "neither 'fl_x' nor 'camera_angle_x'"),
        ({"frames": []}, FormatError, "no list 'frames'"),
        ({"frames": [{}]}, FormatError, "frame 0 has no 'file_path'"),
        ({"frames": [{"file_path": "a.png"}]}, FormatError, "has no 'transform_matrix'"),
    ],
)
def test_bad_transforms_are_told(tmp_path, keys, error, words):
    with pytest.raises(error, match=words) as caught:
        read_transforms(blender(tmp_path, **keys))
    assert "transforms.json" in str(caught.value)


def edit(path, old, new):
    text = path.read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new, 1), encoding="utf-8")


@pytest.mark.parametrize(
    ("file", "old", "new", "error", "words"),
    [
        ("cameras.txt", "PINHOLE", "BANANA", CaptureError, "cameras.txt, line 2: camera model 'BANANA'"),
        ("cameras.txt", "101.5", "-101.5", CaptureError, "cameras.txt, line 2: focal length"),
        ("cameras.txt", "101.5 ", "", CaptureError, "cameras.txt, line 2: .* takes 4 parameters, got 3"),
        ("cameras.txt", "1 PINHOLE 96", "1 PINHOLE wide", FormatError, "cameras.txt, line 2: expected ID MODEL"),
        ("images.txt", " c.png", "", FormatError, "images.txt, line 6: expected ID QW"),
        ("images.txt", " 2 b/", " 9 b/", FormatError, "images.txt, line 4: photo b/é.png names camera 9"),
        ("images.txt", " 2 b/", " two b/", FormatError, "images.txt, line 4: expected ID QW"),
    ],
)
def test_broken_text_models_are_told_by_line(text_model, file, old, new, error, words):
    edit(text_model / file, old, new)
    with pytest.raises(error, match=words):
        read_model(text_model, Path("images"))


@pytest.mark.parametrize("column", range(1, 8))
def test_nan_poses_are_told_with_line_and_photo(text_model, column):
    lines = (text_model / "images.txt").read_text(encoding="utf-8").splitlines()
    words = lines[5].split()
    words[column] = "nan"
    lines[5] = " ".join(words)
    (text_model / "images.txt").write_text("\n".join(lines), encoding="utf-8")
    with pytest.raises(CaptureError, match=r"images.txt, line 6: the pose of c.png holds NaN"):
        read_model(text_model, Path("images"))


def test_zero_quaternions_are_told(text_model):
    lines = (text_model / "images.txt").read_text(encoding="utf-8").splitlines()
    words = lines[5].split()
    lines[5] = " ".join([words[0], "0", "0", "0", "0", *words[5:]])
    (text_model / "images.txt").write_text("\n".join(lines), encoding="utf-8")
    with pytest.raises(CaptureError, match=r"line 6: the pose of c.png has the quaternion 0 0 0 0"):
        read_model(text_model, Path("images"))


@pytest.mark.parametrize("stem", ["cameras", "images"])
def test_incomplete_models_are_told(text_model, stem):
    (text_model / f"{stem}.txt").unlink()
    with pytest.raises(FormatError, match=f"{stem}.txt is missing"):
        read_model(text_model, Path("images"))


def test_models_without_images_are_told(text_model):
    for name in ("cameras.txt", "images.txt"):
        (text_model / name).write_text("")
    with pytest.raises(CaptureError, match="no image with a pose"):
        read_model(text_model, Path("images"))


@pytest.fixture
def binary_model(text_model, tmp_path):
    folder = tmp_path / "binary"
    folder.mkdir()
    import_pycolmap().Reconstruction(str(text_model)).write_binary(str(folder))
    return folder


@pytest.mark.parametrize("stem", ["cameras", "images"])
def test_binary_models_truncated_anywhere_are_told(binary_model, stem):
    data = (binary_model / f"{stem}.bin").read_bytes()
    for keep in range(0, len(data), 7):
        (binary_model / f"{stem}.bin").write_bytes(data[:keep])
        with pytest.raises(FormatError, match=rf"{stem}.bin: the COLMAP model is truncated .it has {keep} bytes"):
            read_model(binary_model, Path("images"))


def test_unknown_model_number_is_told(binary_model):
    data = bytearray((binary_model / "cameras.bin").read_bytes())
    data[12:16] = (77).to_bytes(4, "little")
    (binary_model / "cameras.bin").write_bytes(data)
    with pytest.raises(CaptureError, match=r"cameras.bin, camera \d: camera model number 77 is not known"):
        read_model(binary_model, Path("images"))


@pytest.mark.parametrize("seed", range(20))
def test_damaged_binary_models_never_crash(binary_model, seed):
    """Whatever the bytes, either a model or one of our errors comes out."""
    rng = np.random.default_rng(seed)
    for stem in ("cameras", "images"):
        data = bytearray((binary_model / f"{stem}.bin").read_bytes())
        for place in rng.integers(0, len(data), 4):
            data[place] = rng.integers(0, 256)
        (binary_model / f"{stem}.bin").write_bytes(data)
    with contextlib.suppress(FormatError, CaptureError):
        shots = read_model(binary_model, Path("images"))
        assert all(np.isfinite(shot.cam_from_world).all() for shot in shots)


def test_model_folders_are_found(text_model, tmp_path):
    assert find_model(tmp_path) == text_model
    shutil.move(str(text_model), str(tmp_path / "flat"))
    assert find_model(tmp_path) is None
    shutil.rmtree(tmp_path / "sparse")
    shutil.move(str(tmp_path / "flat"), str(tmp_path / "sparse"))
    assert find_model(tmp_path) == tmp_path / "sparse"
