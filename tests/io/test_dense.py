"""Depth and normal maps in COLMAP's layout: read back, read by pycolmap, and damaged ones refused."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ibrpipe.errors import FormatError, MissingFileError, ShapeError
from ibrpipe.io.cameras.colmap import read_model
from ibrpipe.io.captures import read_capture
from ibrpipe.io.dense import DepthMap, Workspace, read_map, write_map, write_workspace
from ibrpipe.types import Array, Camera


@pytest.mark.parametrize("shape", [(4, 7), (4, 7, 3), (1, 1)])
def test_a_map_comes_back_bit_for_bit(tmp_path: Path, shape: tuple[int, ...]) -> None:
    array = np.random.default_rng(0).normal(size=shape).astype(np.float32)
    write_map(tmp_path / "a.bin", array)
    assert np.array_equal(read_map(tmp_path / "a.bin"), array)
    assert [path.name for path in tmp_path.iterdir()] == ["a.bin"]


def test_the_bytes_are_those_of_colmap(tmp_path: Path) -> None:
    write_map(tmp_path / "a.bin", np.arange(12, dtype=np.float32).reshape(2, 2, 3))
    content = (tmp_path / "a.bin").read_bytes()
    assert content.startswith(b"2&2&3&")
    assert np.frombuffer(content[6:], "<f4").tolist() == [0, 3, 6, 9, 1, 4, 7, 10, 2, 5, 8, 11]


@pytest.mark.parametrize("content", [b"", b"2&2&", b"2&2&1&1234", b"a&2&1&" + bytes(8), b"0&0&1&"])
def test_damaged_maps_are_refused(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "a.bin").write_bytes(content)
    with pytest.raises(FormatError, match=r"a\.bin"):
        read_map(tmp_path / "a.bin")


def test_missing_maps_and_wrong_shapes_are_told(tmp_path: Path) -> None:
    with pytest.raises(MissingFileError, match="does not exist"):
        read_map(tmp_path / "a.bin")
    with pytest.raises(ShapeError, match=r"\(H, W\)"):
        write_map(tmp_path / "a.bin", np.zeros((2, 2, 2, 2)))


READ = """
import cv2, sys, numpy as np, pycolmap
depth, normal = pycolmap.DepthMap(), pycolmap.NormalMap()
depth.read(sys.argv[1]); normal.read(sys.argv[2])
np.savez(sys.argv[3], depth=depth.to_array(), normal=normal.to_array())
"""


def test_pycolmap_reads_the_maps(tmp_path: Path) -> None:
    draw = np.random.default_rng(1)
    depth: Array = draw.uniform(1, 2, (5, 6)).astype(np.float32)
    normal: Array = draw.normal(size=(5, 6, 3)).astype(np.float32)
    names = [str(tmp_path / name) for name in ("d.bin", "n.bin", "both.npz")]
    write_map(Path(names[0]), depth)
    write_map(Path(names[1]), normal)
    done = subprocess.run([sys.executable, "-c", READ, *names], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    both = np.load(names[2])
    assert np.array_equal(both["depth"], depth)
    memory = both["normal"].reshape(3, 5, 6)  # pycolmap hands out plane after plane under an interleaved shape
    assert np.array_equal(memory.transpose(1, 2, 0), normal)


def test_a_workspace_holds_the_cameras_of_the_maps(tmp_path: Path, tiny_lambert: Path) -> None:
    views = read_capture(tiny_lambert).train[:2]
    workspace = Workspace(tmp_path / "dense")
    workspace.lay_out()
    maps = []
    for view in views:
        write_map(workspace.depth(view.name), np.ones((36, 48), np.float32))
        maps.append(DepthMap(view, workspace.depth(view.name)))
    write_workspace(workspace, maps)
    shots = read_model(workspace.sparse, workspace.images)
    assert [shot.image.is_file() for shot in shots] == [True, True]
    assert workspace.fusion_list.read_text().split() == [shot.file for shot in shots]
    for shot, view in zip(shots, views):
        assert (shot.lens.width, shot.lens.height) == (48, 36)
        assert np.allclose(shot.cam_from_world, view.camera.cam_from_world, atol=1e-12)


FUSE = """
import cv2, sys, pycolmap
pycolmap.logging.minloglevel = 2
options = pycolmap.StereoFusionOptions()
options.min_num_pixels = 3
found = pycolmap.stereo_fusion(sys.argv[2], sys.argv[1], options=options)
print(len(found.points3D), sum(abs(float(p.xyz[2]) - 5.0) < 0.02 for p in found.points3D.values()))
"""


def test_pycolmap_fuses_the_workspace(tmp_path: Path, tiny_lambert: Path) -> None:
    # three cameras side by side that look at the plane z = 5
    views = read_capture(tiny_lambert).train[:3]
    workspace = Workspace(tmp_path / "dense")
    workspace.lay_out()
    maps = []
    for number, view in enumerate(views):
        matrix = np.array([[90.0, 0, 48], [0, 90, 36], [0, 0, 1]])
        pose = np.concatenate([np.eye(3), [[-0.3 * number], [0], [0]]], axis=1)
        moved = replace(view, camera=Camera(matrix, pose, 96, 72))
        write_map(workspace.depth(view.name), np.full((72, 96), 5.0))
        write_map(workspace.normal(view.name), np.tile([0.0, 0, -1], (72, 96, 1)))
        maps.append(DepthMap(moved, workspace.depth(view.name), workspace.normal(view.name)))
    write_workspace(workspace, maps)
    (tmp_path / "out").mkdir()
    command = [sys.executable, "-c", FUSE, str(workspace.root), str(tmp_path / "out")]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    count, right = map(int, done.stdout.split())
    assert count > 1000
    assert right == count
