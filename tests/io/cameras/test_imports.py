"""Cameras, meshes and depth of other programs: the tiny capture in their formats gives the same views."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ibrpipe.errors import CaptureError, FormatError, IbrError, MissingFileError
from ibrpipe.io.captures import Capture, read_capture
from ibrpipe.io.photos.images import write_exr
from ibrpipe.io.views import load_depth

FLIP = np.diag([1.0, -1.0, -1.0])


@pytest.fixture
def capture(tiny_ball: Path, tmp_path: Path) -> Path:
    """The capture without test views, so that photos are views."""
    root = Path(shutil.copytree(tiny_ball, tmp_path / "capture"))
    shutil.rmtree(root / "test")
    return root


def bare(root: Path) -> Capture:
    """Take the cameras away; return what they were."""
    before = read_capture(root)
    shutil.rmtree(root / "sparse")
    (root / "transforms.json").unlink()
    return before


def same(after: Capture, before: Capture, atol: float = 1e-6) -> None:
    for one, two in zip(after.train + after.test, before.train + before.test, strict=True):
        assert one.image == two.image
        assert np.allclose(one.camera.K, two.camera.K, atol=1e-4)
        assert np.allclose(one.camera.cam_from_world, two.camera.cam_from_world, atol=atol)


SENSOR = (
    '<sensor id="0" type="frame"><resolution width="96" height="72"/><calibration type="frame" class="adjusted">'
    '<resolution width="96" height="72"/><f>{f}</f><cx>{cx}</cx><cy>{cy}</cy>{more}</calibration></sensor>'
)


def metashape(root: Path, before: Capture, more: str = "") -> None:
    """Write cameras.xml in the axes of a chunk that is turned, moved and scaled against the world."""
    scale, R, t = 2.5, Rotation.from_euler("xyz", (0.3, -1.0, 2.0)).as_matrix(), np.array([1.0, -2.0, 0.5])
    views = before.train + before.test
    K = views[0].camera.K
    cameras = []
    for index, view in enumerate(views):
        matrix = np.eye(4)
        matrix[:3, :3] = R.T @ view.camera.R.T
        matrix[:3, 3] = R.T @ (view.camera.center - t) / scale
        numbers = " ".join(map(repr, matrix.ravel().tolist()))
        cameras.append(
            f'<camera id="{index}" sensor_id="0" label="{view.name}"><transform>{numbers}</transform></camera>'
        )
    cameras.append('<camera id="99" sensor_id="0" label="not aligned"/>')
    sensor = SENSOR.format(f=K[1, 1], cx=K[0, 2] - 48, cy=K[1, 2] - 36, more=more)
    (root / "cameras.xml").write_text(
        f'<?xml version="1.0"?><document version="2.0"><chunk><sensors>{sensor}</sensors>'
        f"<cameras><group>{''.join(cameras)}</group></cameras><transform><rotation>"
        f"{' '.join(map(repr, R.ravel().tolist()))}</rotation><translation>{t[0]} {t[1]} {t[2]}</translation>"
        f"<scale>{scale}</scale></transform></chunk></document>"
    )


def test_cameras_of_metashape(capture: Path) -> None:
    before = bare(capture)
    metashape(capture, before)
    same(read_capture(capture), before)


def test_distortion_of_metashape_is_browns_with_p1_and_p2_swapped(capture: Path) -> None:
    metashape(capture, bare(capture), "<k1>0.1</k1><p1>0.002</p1><p2>-0.001</p2>")
    lens = read_capture(capture).train[0].distortion
    assert lens is not None
    assert lens.model == "OPENCV"
    assert lens.params[4:] == (0.1, 0.0, -0.001, 0.002)


def bundler(root: Path, before: Capture) -> None:
    lines = ["# Bundle file v0.3", f"{len(before.train + before.test) + 1} 0"]
    names = []
    for view in before.train + before.test:
        lines.append(f"{float(view.camera.K[0, 0])!r} 0 0")
        lines += [" ".join(map(repr, row)) for row in (FLIP @ view.camera.R).tolist()]
        lines.append(" ".join(map(repr, (FLIP @ view.camera.t).tolist())))
        names.append(f"./images/{view.image.name} 0 100.5")
    lines += ["0 0 0"] * 5
    (root / "bundle.out").write_text("\n".join(lines) + "\n")
    (root / "list.txt").write_text("\n".join([*names, "lost.jpg"]) + "\n")


def test_cameras_of_bundler(capture: Path) -> None:
    before = bare(capture)
    bundler(capture, before)
    same(read_capture(capture), before)


def test_a_colmap_dense_workspace_is_a_capture(capture: Path) -> None:
    before = bare(Path(shutil.copytree(capture, capture.with_name("copy"))))
    for path in (capture / "sparse/0").iterdir():
        path.rename(capture / "sparse" / path.name)
    (capture / "sparse/0").rmdir()
    (capture / "transforms.json").unlink()
    (capture / "mesh.ply").rename(capture / "meshed-poisson.ply")
    (capture / "fused.ply").write_text("a point cloud is no mesh")
    after = read_capture(capture)
    assert after.mesh == capture / "meshed-poisson.ply"
    assert len(after.train) == len(before.train)


def depth_png(path: Path, millimetres: np.ndarray) -> None:
    import cv2

    path.parent.mkdir(exist_ok=True)
    assert cv2.imwrite(str(path), millimetres)


def test_depth_of_an_rgbd_camera(capture: Path) -> None:
    stored = np.arange(36 * 48, dtype=np.uint16).reshape(36, 48)
    depth_png(capture / "depth/001.png", stored)
    write_exr(capture / "depth/002.exr", np.full((72, 96), 2.5, np.float32))
    np.save(capture / "depth/003.npy", np.full((72, 96), 3.5, np.float32))
    views = {view.name: view for view in read_capture(capture).train}
    found = load_depth(views["001"])
    assert found.shape == (72, 96)
    assert np.isinf(found[0, 0])  # 0 = not measured
    assert found[71, 95] == pytest.approx(stored[-1, -1] / 1000)
    assert load_depth(views["002"])[5, 5] == 2.5
    assert load_depth(views["003"])[5, 5] == 3.5
    depth_png(capture / "depth/001.png", stored[:, :36])
    with pytest.raises(CaptureError, match="is 36 x 36 pixels but the camera states 96 x 72"):
        load_depth(views["001"])
    depth_png(capture / "depth/001.png", stored.astype(np.uint8))
    with pytest.raises(FormatError, match=r"stored as uint8 integers; expected .*16-bit PNG in millimetres"):
        load_depth(views["001"])


def edit(path: Path, old: str, new: str) -> None:
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))


DAMAGES: dict[str, tuple[Callable[[Path], object], type[IbrError], str]] = {
    "no XML": (lambda c: (c / "cameras.xml").write_text("{"), FormatError, "is not XML"),
    "no chunk": (lambda c: (c / "cameras.xml").write_text("<a/>"), FormatError, "has no chunk"),
    "short transform": (
        lambda c: edit(c / "cameras.xml", "0.0 0.0 0.0 1.0</t", "</t"),
        FormatError,
        "transform of 001 holds 12 numbers, expected 16",
    ),
    "photo is missing": (lambda c: (c / "images/002.png").unlink(), MissingFileError, "names the photo 002"),
    "no aligned camera": (
        lambda c: (c / "cameras.xml").write_text("<d><chunk><camera id='1'/></chunk></d>"),
        CaptureError,
        "no aligned camera",
    ),
    "fisheye": (
        lambda c: edit(c / "cameras.xml", 'id="0" type="frame"', 'id="0" type="fisheye"'),
        CaptureError,
        "fisheye",
    ),
    "skew": (lambda c: edit(c / "cameras.xml", "</cy>", "</cy><b2>3</b2>"), CaptureError, "skew"),
}


@pytest.mark.parametrize("case", DAMAGES)
def test_damaged_metashape_files_are_told(capture: Path, case: str) -> None:
    damage, kind, words = DAMAGES[case]
    metashape(capture, bare(capture))
    damage(capture)
    with pytest.raises(kind, match=words) as caught:
        read_capture(capture)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("damage", "words"),
    [
        (lambda c: (c / "list.txt").unlink(), "list.txt: does not exist"),
        (lambda c: edit(c / "list.txt", "lost.jpg\n", ""), "list.txt names 14 photos; expected the same number"),
        (lambda c: (c / "bundle.out").write_text("# Bundle\nhello\n"), "is no Bundler file"),
        (lambda c: edit(c / "bundle.out", "15 0\n", "15 0\n1 "), "is no Bundler file"),
    ],
)
def test_damaged_bundler_files_are_told(capture: Path, damage: Callable[[Path], object], words: str) -> None:
    bundler(capture, bare(capture))
    damage(capture)
    with pytest.raises(IbrError, match=words):
        read_capture(capture)


def test_calibrate_leaves_these_cameras_alone(capture: Path, tmp_path: Path) -> None:
    from ibrpipe.stages.calibrate import CalibrateConfig, Inputs, run

    metashape(capture, bare(capture))
    found = run(Inputs(capture, 0, tmp_path / "out"), CalibrateConfig()).calibration_document
    assert json.loads(found.read_text())["decision"] == "given"
