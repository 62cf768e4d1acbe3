"""Every way to break a capture ends in one line that names the file and the remedy, by the stage and by the command."""

import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from ibrpipe.cli.main import cli
from ibrpipe.errors import IbrError
from ibrpipe.io.photos.images import write_exr, write_png
from ibrpipe.stages.ingest import IngestConfig, Inputs, run

IMAGES, CAMERAS, TRANSFORMS = "sparse/0/images.txt", "sparse/0/cameras.txt", "transforms.json"


def edit(path, old, new, count=1):
    text = path.read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new, count), encoding="utf-8")


def edit_pose(capture, column, value):
    lines = (capture / IMAGES).read_text().splitlines()
    index = next(i for i, line in enumerate(lines) if line.endswith(" 003.png"))
    words = lines[index].split()
    words[column] = value
    lines[index] = " ".join(words)
    (capture / IMAGES).write_text("\n".join(lines) + "\n")


def only_transforms(capture):
    shutil.rmtree(capture / "sparse")
    return capture / TRANSFORMS


def frames(capture, change):
    path = only_transforms(capture)
    document = json.loads(path.read_text())
    change(document)
    path.write_text(json.dumps(document))


def keep_photos(capture, count):
    lines = (capture / IMAGES).read_text().splitlines()
    head = [line for line in lines if line.startswith("#")]
    body = [line for line in lines if not line.startswith("#")]
    (capture / IMAGES).write_text("\n".join(head + body[: 2 * count]) + "\n")


def truncate(path, share=0.5):
    data = path.read_bytes()
    path.write_bytes(data[: int(len(data) * share)])


def jpeg_cut(capture):
    import OpenImageIO as oiio

    picture = oiio.ImageBuf(str(capture / "images" / "002.png"))
    picture.write(str(capture / "images" / "002.jpg"))
    truncate(capture / "images" / "002.jpg", 0.6)
    edit(capture / IMAGES, "002.png", "002.jpg")


def mesh_text(capture, vertices, faces):
    header = "ply\nformat ascii 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\n"
    header += "element face {}\nproperty list uchar int vertex_indices\nend_header\n"
    lines = [" ".join(map(str, row)) for row in vertices] + [f"3 {' '.join(map(str, row))}" for row in faces]
    (capture / "mesh.ply").write_text(header.format(len(vertices), len(faces)) + "\n".join(lines) + "\n")


def mesh_changed(capture, change):
    from ibrpipe.io.surfaces.meshes import read_mesh, write_mesh
    from ibrpipe.types import Mesh

    mesh = read_mesh(capture / "mesh.ply")
    write_mesh(Mesh(*change(mesh.vertices, mesh.faces)), capture / "mesh.ply")


CORNERS = [(0, 0, 0), (1, 0, 0), (0, 1, 0)]

BROKEN = {
    "no capture folder": (shutil.rmtree, "is no folder|does not exist"),
    "empty folder": (lambda c: (shutil.rmtree(c), c.mkdir()), "no cameras found; expected a COLMAP model"),
    "no images folder": (lambda c: shutil.rmtree(c / "images"), r"000.png: the photo does not exist .14 of 14"),
    "one image missing": (lambda c: (c / "images/005.png").unlink(), r"005.png: the photo does not exist .1 of 14"),
    "one photo": (lambda c: keep_photos(c, 1), "holds 1 photo.* expected at least 2"),
    "no cameras": (lambda c: (shutil.rmtree(c / "sparse"), (c / TRANSFORMS).unlink()), "no cameras found"),
    "empty model": (lambda c: [(c / f).write_text("") for f in (CAMERAS, IMAGES)], "no image with a pose"),
    "cameras.txt missing": (lambda c: (c / CAMERAS).unlink(), "cameras.txt is missing"),
    "images.txt of nonsense": (lambda c: (c / IMAGES).write_text("hello world\n"), "line 1: expected ID QW"),
    "images.txt not text": (lambda c: (c / IMAGES).write_bytes(b"\xff\xfe\x00"), "is not UTF-8"),
    "binary model of zero bytes": (
        lambda c: [(c / f"sparse/0/{s}.bin").touch() for s in ("cameras", "images")],
        "trunc",
    ),
    "unknown camera model": (
        lambda c: edit(c / CAMERAS, "PINHOLE", "BANANA"),
        "'BANANA' is not known; expected one of",
    ),
    "negative focal length": (
        lambda c: edit(c / CAMERAS, " 125.5", " -125.5"),
        "focal length is -125.* must be positive",
    ),
    "NaN in the intrinsics": (lambda c: edit(c / CAMERAS, " 48.0", " nan"), "camera parameters .* hold NaN"),
    "wrong size in the camera": (
        lambda c: edit(c / CAMERAS, "96 72", "72 96"),
        "is 96 x 72 pixels but its camera states 72",
    ),
    "one photo of another size": (
        lambda c: write_png(c / "images/004.png", np.zeros((36, 48, 3))),
        r"004.png: is 48 x 36 pixels but its camera states 96 x 72",
    ),
    "NaN pose": (lambda c: edit_pose(c, 6, "nan"), "the pose of 003.png holds NaN"),
    "infinite pose": (lambda c: edit_pose(c, 6, "inf"), "the pose of 003.png holds NaN or infinity"),
    "zero quaternion": (lambda c: [edit_pose(c, i, "0") for i in range(1, 5)], "quaternion 0 0 0 0"),
    "photo of unknown camera": (lambda c: edit_pose(c, 8, "7"), "003.png names camera 7"),
    "two poses for a photo": (lambda c: edit(c / IMAGES, " 001.png", " 000.png"), "photo 000.png has 2 poses"),
    "zero-byte PNG": (lambda c: (c / "images/002.png").write_bytes(b""), "002.png: cannot be read as an image"),
    "photo that is text": (lambda c: (c / "images/002.png").write_text("hello"), "002.png: cannot be read as an image"),
    "truncated PNG": (lambda c: truncate(c / "images/002.png"), r"002.png: .*damaged"),
    "truncated JPEG": (jpeg_cut, r"002.jpg: .*damaged"),
    "photo with NaN": (
        lambda c: (
            write_exr(c / "images/002.exr", np.full((72, 96, 3), np.nan)),
            edit(c / IMAGES, "002.png", "002.exr"),
        ),
        r"002.exr: the photo holds NaN",
    ),
    "empty mask": (lambda c: write_png(c / "masks/006.png", np.zeros((72, 96))), r"006.png: the mask keeps no pixel"),
    "mask of another size": (
        lambda c: write_png(c / "masks/006.png", np.ones((70, 96))),
        "is 96 x 70 pixels but photo",
    ),
    "mask that is text": (lambda c: (c / "masks/006.png").write_text("hello"), "006.png: cannot be read as an image"),
    "mesh without faces": (lambda c: mesh_text(c, CORNERS, []), "no triangles; give a surface"),
    "mesh with NaN": (lambda c: mesh_text(c, [("nan", 0, 0), *CORNERS[1:]], [(0, 1, 2)]), "NaN or infinite"),
    "mesh index out of range": (lambda c: mesh_text(c, CORNERS, [(0, 1, 9)]), "names vertex 9 of 3"),
    "mesh without area": (lambda c: mesh_text(c, CORNERS, [(0, 1, 1)]), "no area"),
    "mesh of zero bytes": (lambda c: (c / "mesh.ply").write_bytes(b""), "mesh.ply: the mesh is damaged"),
    "truncated mesh": (lambda c: truncate(c / "mesh.ply"), "mesh.ply: the mesh is damaged"),
    "mesh elsewhere": (lambda c: mesh_changed(c, lambda v, f: (v + 500.0, f)), "no photo sees any of the mesh"),
    "transforms.json not JSON": (lambda c: only_transforms(c).write_text("{no"), "transforms.json: is not JSON"),
    "transforms.json a list": (lambda c: only_transforms(c).write_text("[]"), "expected a JSON object"),
    "transforms.json without frames": (lambda c: frames(c, lambda d: d.pop("frames")), "no list 'frames'"),
    "singular transform": (
        lambda c: frames(c, lambda d: d["frames"][2].update(transform_matrix=np.zeros((4, 4)).tolist())),
        r"frame 2 \(images/002.png\): transform_matrix is no rigid motion",
    ),
    "transform with NaN": (
        lambda c: frames(c, lambda d: d["frames"][2].update(transform_matrix=[[float("nan")] * 4] * 4)),
        "transform_matrix holds NaN",
    ),
    "transforms.json without focal length": (lambda c: frames(c, lambda d: d.pop("fl_x")), "neither 'fl_x'"),
    "named mask missing": (
        lambda c: frames(c, lambda d: d["frames"][2].update(mask_path="masks/none.png")),
        "none.png: the image does not exist",
    ),
    "exposure.csv with another column": (
        lambda c: (c / "exposure.csv").write_text("file,ev\n000.png,0\n"),
        "expected a column named 'relative_exposure_stops'",
    ),
    "exposure.csv without a photo": (
        lambda c: (c / "exposure.csv").write_text("file,relative_exposure_stops\n000.png,0\n"),
        "16 of 17 photos have no line|photos have no line",
    ),
    "test folder without cameras": (
        lambda c: (shutil.rmtree(c / "test/sparse"), (c / "test" / TRANSFORMS).unlink()),
        "test: no cameras found",
    ),
    "true depth of another size": (
        lambda c: write_exr(c / "test/depth/001.exr", np.ones((9, 9))),
        r"001.exr: is 9 x 9 pixels but the camera states 96 x 72",
    ),
}


@pytest.fixture
def capture(tiny_ball, tmp_path):
    return shutil.copytree(tiny_ball, tmp_path / "capture")


@pytest.mark.parametrize("case", BROKEN)
def test_the_stage_tells_what_is_broken(capture, tmp_path, case):
    damage, words = BROKEN[case]
    damage(capture)
    out = tmp_path / "out"
    out.mkdir()
    with pytest.raises(IbrError, match=f"(?s){words}") as caught:
        run(Inputs(capture, out), IngestConfig())
    assert "\n" not in str(caught.value)
    assert list(out.iterdir()) == []  # nothing half-written


#: One of each kind through the command: the rest differ only in the line
BY_COMMAND = ["no capture folder", "no images folder", "NaN pose", "truncated JPEG", "empty mask", "mesh without faces"]


@pytest.mark.parametrize("case", BY_COMMAND)
def test_the_command_ends_in_one_line(capture, tmp_path, case):
    damage, words = BROKEN[case]
    damage(capture)
    result = CliRunner().invoke(cli, ["ingest", str(capture), "--out", str(tmp_path / "out")])
    assert result.exit_code in (1, 2)
    told = [line for line in result.stderr.splitlines() if line.startswith(("error:", "Error:"))]
    assert len(told) == 1, result.output
    assert re.search(words, told[0])
    assert not (tmp_path / "out" / "ingest").exists()


def test_every_capture_error_is_counted(capture, tmp_path):
    for name in ("001", "002", "003"):
        truncate(capture / "images" / f"{name}.png")
    with pytest.raises(IbrError, match=r"001.png.*and 2 further errors"):
        run(Inputs(capture, tmp_path), IngestConfig())


def non_ascii(capture):
    return capture.rename(capture.with_name("Aufnahme ä 写真"))


def without_depth(capture):
    shutil.rmtree(capture / "test" / "depth")
    return capture


def without_masks(capture):
    shutil.rmtree(capture / "masks")
    return capture


def without_points(capture):
    (capture / "sparse/0/points3D.txt").unlink()
    return capture


@pytest.mark.parametrize("change", [non_ascii, without_depth, without_masks, without_points])
def test_unusual_captures_that_work(capture, tmp_path, change):
    path: Path = change(capture)
    result = CliRunner().invoke(cli, ["ingest", str(path), "--out", str(tmp_path / "ö out")])
    assert result.exit_code == 0, result.output
    assert (tmp_path / "ö out" / "ingest" / "views.json").is_file()
