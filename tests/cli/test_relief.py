"""``ibrpipe relief`` and rendering an asset without a capture, through the command line."""

from __future__ import annotations

import json

import cv2
import numpy as np
import pytest
from click.testing import CliRunner

import ibrpipe
from ibrpipe.cli.main import cli
from ibrpipe.io.surfaces.meshes import read_mesh, write_mesh
from ibrpipe.types import Mesh


def call(*words):
    return CliRunner().invoke(cli, [str(word) for word in words], catch_exceptions=False)


@pytest.fixture
def cube(tmp_path):
    corners = np.array(list(np.ndindex(2, 2, 2)), float)
    faces = [[0, 1, 3], [0, 3, 2], [4, 7, 5], [4, 6, 7], [0, 5, 1], [0, 4, 5], [2, 3, 7], [2, 7, 6], [0, 2, 6],
             [0, 6, 4], [1, 5, 7], [1, 7, 3]]  # fmt: skip
    write_mesh(Mesh(corners, np.array(faces, np.int32)), tmp_path / "cube.ply")
    return tmp_path / "cube.ply"


def test_images_become_an_asset_that_is_rendered_without_a_capture(tmp_path):
    (tmp_path / "brick").mkdir()
    cv2.imwrite(str(tmp_path / "brick/height.png"), np.tile(np.arange(0, 240, 8, dtype=np.uint8), (20, 1)))
    cv2.imwrite(str(tmp_path / "brick/color.png"), np.full((20, 30, 3), 128, np.uint8))
    done = call(
        "relief", "images", tmp_path / "brick", "--size", 3, 2, "--depth-range", 0, 0.5, "--out", tmp_path / "a"
    )
    assert done.exit_code == 0
    assert "1 relief texture, 600 texels" in done.output
    assert "of neighbouring texels" not in done.output
    steep = call("relief", "images", tmp_path / "brick", "--depth-range", 0, 50, "--out", tmp_path / "steep")
    assert "of neighbouring texels differ by over 4 texels of height; they are joined all the same" in steep.output
    asset = ibrpipe.read_asset(tmp_path / "a")
    assert asset.textures[0].layers.depth.min() == pytest.approx(-0.5 * 232 / 255, abs=1e-6)
    orbit = "orbit:frames=2,width=40,height=30"
    done = call("render", "--asset", tmp_path / "a", "--renderers", "prewarp", "--path", orbit, "--out",
                tmp_path / "run")  # fmt: skip
    assert done.exit_code == 0
    folder = tmp_path / "run/render-orbit-frames=2,width=40,height=30"
    assert f"{folder / 'prewarp'}: 2 frames of prewarp" in done.stdout
    frames = json.loads((folder / "frames.json").read_text())["frames"]
    assert len(frames) == 2
    assert (folder / frames[0]["png"]).is_file()


def test_mesh_box_and_asset(tmp_path, cube):
    assert call("relief", "mesh", cube, "--side", "-x", "--texels", 8, "--out", tmp_path / "side").exit_code == 0
    assert call("relief", "box", cube, "--texels", 8, "--out", tmp_path / "box").exit_code == 0
    box = ibrpipe.read_asset(tmp_path / "box")
    assert len(box.textures) == 6
    assert [entry["name"] for entry in box.info["textures"]] == ["+x", "-x", "+y", "-y", "+z", "-z"]
    assert call("relief", "asset", tmp_path / "box", "--out", tmp_path / "again").exit_code == 0
    again = ibrpipe.read_asset(tmp_path / "again")
    for one, other in zip(box.textures, again.textures, strict=True):
        np.testing.assert_array_equal(one.layers.depth, other.layers.depth)


@pytest.fixture
def painted_cube(cube):
    """The cube, red where x is 0 and green where x is 1."""
    corners = np.array(list(np.ndindex(2, 2, 2)), np.float32)
    tints = {"red": 1 - corners[:, 0], "green": corners[:, 0], "blue": np.zeros(8, np.float32)}
    write_mesh(read_mesh(cube), cube.with_name("painted.ply"), tints)
    return cube.with_name("painted.ply")


def test_meshes_are_sampled_in_their_colours(tmp_path, painted_cube):
    assert call("relief", "box", painted_cube, "--texels", 8, "--out", tmp_path / "box").exit_code == 0
    box = ibrpipe.read_asset(tmp_path / "box")
    np.testing.assert_allclose(box.textures[0].layers.color, np.tile([0, 1, 0], (64, 1)), atol=0.01)  # +x
    np.testing.assert_allclose(box.textures[1].layers.color, np.tile([1, 0, 0], (64, 1)), atol=0.01)
    assert call("relief", "mesh", painted_cube, "--texels", 8, "--out", tmp_path / "one").exit_code == 0
    ramp = ibrpipe.read_asset(tmp_path / "one").textures[0].layers.color
    assert np.ptp(ramp[:, 0]) > 0.8
    done = call("depth-images", painted_cube, "--arrange", "cube", "--size", 16, "--out", tmp_path / "maps")
    assert done.exit_code == 0
    colors = np.concatenate([each.layers.color for each in ibrpipe.read_asset(tmp_path / "maps").textures])
    np.testing.assert_allclose(colors[:, 0] + colors[:, 1], 1.0, atol=0.02)
    assert np.abs(colors[:, 2]).max() < 0.01


def test_a_dual_relief_is_mapped_in_its_colours(tmp_path, painted_cube):
    done = call("relief", "dual", painted_cube, "--side", "+x", "--texels", 16, "--out", tmp_path / "dual")
    assert done.exit_code == 0
    source = ibrpipe.read_relief_mesh(tmp_path / "dual/quad.obj", packed=tmp_path / "dual/packed.png", edges="cut",
                                      thickness=1.0)  # fmt: skip
    there = source.height > source.back
    np.testing.assert_allclose(source.color[there], np.tile([0, 1, 0], (there.sum(), 1)), atol=0.01)


def test_an_image_is_laid_on_a_mesh_that_names_none(tmp_path, cube):
    lines = ["v 0 0 0", "v 1 0 0", "v 1 1 0", "v 0 1 0", "vt 0 0", "vt 1 0", "vt 1 1", "vt 0 1", "f 1/1 2/2 3/3 4/4"]
    (tmp_path / "quad.obj").write_text("\n".join(lines))
    cv2.imwrite(str(tmp_path / "blue.png"), np.uint8([[[255, 0, 0]]]))
    words = ("--color", tmp_path / "blue.png", "--out", tmp_path / "a")
    assert call("relief", "mesh", tmp_path / "quad.obj", "--texels", 4, *words).exit_code == 0
    color = ibrpipe.read_asset(tmp_path / "a").textures[0].layers.color
    np.testing.assert_allclose(color, np.tile([0, 0, 1], (16, 1)), atol=1e-3)
    wrong = call("relief", "mesh", cube, *words)
    assert (wrong.exit_code, wrong.output.count("\n")) == (1, 1)
    assert "has no texture coordinates" in wrong.output


def test_failures_are_one_line(tmp_path, cube):
    for words, text in (
        (("images", tmp_path / "none", "--out", tmp_path / "a"), "no such folder"),
        (("mesh", cube, "--side", "up", "--out", tmp_path / "a"), "choose among"),
        (("range", tmp_path, "--planes", tmp_path / "none.yaml", "--out", tmp_path / "a"), "no such file of planes"),
    ):
        done = call("relief", *words)
        assert done.exit_code == 1
        assert text in done.output
        assert len(done.output.strip().splitlines()) == 1
    assert call("relief", "images", "--out", tmp_path / "a").exit_code == 2
    (tmp_path / "bad.yaml").write_text("- {origin: [0, 0, 0]}")
    done = call("relief", "range", tmp_path, "--planes", tmp_path / "bad.yaml", "--out", tmp_path / "a")
    assert "is no list of planes" in done.output
