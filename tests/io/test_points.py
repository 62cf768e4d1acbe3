"""Sparse points of COLMAP models, text and binary, as points.npz."""

from __future__ import annotations

import shutil
import struct
from pathlib import Path

import numpy as np
import pytest

from ibrpipe.errors import FormatError, MissingFileError
from ibrpipe.io.captures import read_capture
from ibrpipe.io.points import points_of_views, read_points, write_points
from ibrpipe.stages.ingest import IngestConfig, Inputs, run

#: number, position, error, images (by number); image n of the tiny capture is photo n - 1
POINTS = [
    (7, (0.5, -1.25, 2.0), 0.5, [3, 1, 3]),
    (2, (1.0, 2.0, 3.0), -1.0, [14, 2]),
    (4, (9.0, 9.0, 9.0), 0.1, [5]),  # one photo alone: left out
    (5, (9.0, 9.0, 9.0), 0.1, [5, 99]),  # the other photo is not there: left out
]


def write_text(model: Path) -> None:
    lines = ["# a comment"]
    for key, xyz, error, images in POINTS:
        track = " ".join(f"{image} 0" for image in images)
        lines.append(f"{key} {' '.join(map(str, xyz))} 1 2 3 {error} {track}")
    (model / "points3D.txt").write_text("\n".join(lines) + "\n")


def write_binary(model: Path) -> None:
    data = struct.pack("<Q", len(POINTS))
    for key, xyz, error, images in POINTS:
        data += struct.pack("<Q3d3BdQ", key, *xyz, 1, 2, 3, error, len(images))
        data += b"".join(struct.pack("<II", image, 0) for image in images)
    (model / "points3D.bin").write_bytes(data)
    (model / "points3D.txt").unlink()


@pytest.fixture
def capture(tiny_ball: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(tiny_ball, tmp_path / "capture"))


@pytest.mark.parametrize("write", [write_text, write_binary])
def test_points_are_read_and_kept_by_ingest(capture: Path, tmp_path: Path, write: object) -> None:
    write(capture / "sparse/0")  # type: ignore[operator]
    (tmp_path / "out").mkdir()
    run(Inputs(capture, tmp_path / "out"), IngestConfig())
    points = read_points(tmp_path / "out/points.npz")
    assert points.xyz.tolist() == [[1.0, 2.0, 3.0], [0.5, -1.25, 2.0]]
    assert points.error.tolist() == [-1.0, 0.5]
    assert points.offsets.tolist() == [0, 2, 4]
    assert points.views.tolist() == [1, 13, 0, 2]
    assert [str(array.dtype) for array in vars(points).values()] == ["float64", "float32", "int64", "int32"]


def test_views_are_counted_without_those_held_out(capture: Path) -> None:
    write_text(capture / "sparse/0")
    found = read_capture(capture)
    views = found.train[1:]
    points = points_of_views(capture / "sparse/0", capture / "images", views)
    assert points is not None
    assert points.views.tolist() == [0, 12]


def test_no_points_no_file(capture: Path, tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    run(Inputs(capture, tmp_path / "out"), IngestConfig())
    assert not (tmp_path / "out/points.npz").exists()


def test_damaged_points_are_told_in_one_line(capture: Path, tmp_path: Path) -> None:
    model, views = capture / "sparse/0", read_capture(capture).train
    (model / "points3D.txt").write_text("1 2 3\n")
    with pytest.raises(FormatError, match="line 1: expected ID X Y Z"):
        points_of_views(model, capture / "images", views)
    write_binary(model)
    data = (model / "points3D.bin").read_bytes()
    (model / "points3D.bin").write_bytes(data[:-5])
    with pytest.raises(FormatError, match="truncated"):
        points_of_views(model, capture / "images", views)
    (tmp_path / "p.npz").write_bytes(b"no")
    with pytest.raises(FormatError, match="not a file of sparse points"):
        read_points(tmp_path / "p.npz")
    with pytest.raises(MissingFileError):
        read_points(tmp_path / "none.npz")


def test_round_trip(capture: Path, tmp_path: Path) -> None:
    write_text(capture / "sparse/0")
    points = points_of_views(capture / "sparse/0", capture / "images", read_capture(capture).train)
    assert points is not None
    write_points(points, tmp_path / "p.npz")
    back = read_points(tmp_path / "p.npz")
    assert all(np.array_equal(value, getattr(back, name)) for name, value in vars(points).items())


def test_points_stay_where_a_model_names_photos_in_another_way(capture: Path) -> None:
    write_text(capture / "sparse/0")
    before = points_of_views(capture / "sparse/0", capture / "images", read_capture(capture).train)
    path = capture / "sparse/0/images.txt"
    path.write_text(path.read_text().replace(".png", ".PNG").replace(" 000", " images\\000"))
    after = points_of_views(capture / "sparse/0", capture / "images", read_capture(capture).train)
    assert before is not None
    assert after is not None
    assert (after.views == before.views).all()
