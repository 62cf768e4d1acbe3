"""``ibrpipe relief map`` and ``ibrpipe relief dual`` through the command line."""

from __future__ import annotations

import json

import cv2
import numpy as np
import pytest
import trimesh
from click.testing import CliRunner

from ibrpipe.cli.main import cli
from ibrpipe.io.photos.images import read_depth, read_image


def call(*words):
    return CliRunner().invoke(cli, [str(word) for word in words], catch_exceptions=False)


@pytest.fixture
def ball(tmp_path):
    trimesh.creation.icosphere(2).export(tmp_path / "ball.ply")
    cv2.imwrite(str(tmp_path / "height.png"), np.tile(np.arange(0, 256, 32, dtype=np.uint8), (8, 1)))
    return tmp_path / "ball.ply"


def test_frames_of_a_mapped_mesh(tmp_path, ball):
    orbit = "orbit:frames=2,width=40,height=30,up=y"
    out = tmp_path / "frames"
    for model, light in (("flat", "--light"), ("shell", "--sun")):
        done = call("relief", "map", ball, "--height", tmp_path / "height.png", "--repeat", 4, 4, "--path", orbit,
                    "--model", model, light, 3, 4, 5, "--json", "--out", out)  # fmt: skip
        assert done.exit_code == 0
        assert [each["view"] for each in json.loads(done.stdout)] == ["orbit_0000", "orbit_0001"]
        frames = json.loads((out / "frames.json").read_text())
        assert frames["options"]["model"] == model
        assert (out.parent / frames["frames"][0]["file"]).is_file()
        assert np.isfinite(read_depth(out / "orbit_0000.exr")).mean() > 0.2


def test_light_is_set_on_the_command_line(tmp_path, ball):
    words = ("relief", "map", ball, "--height", tmp_path / "height.png", "--path",
             "orbit:frames=1,width=40,height=30,up=y", "--light", 3, 4, 5)  # fmt: skip

    def seen(name, *more):
        done = call(*words, *more, "--out", tmp_path / name)
        assert done.exit_code == 0, done.output
        pixels = read_image(tmp_path / name / "orbit_0000.exr")
        return pixels[pixels[..., 3] == 1, :3]

    dark = ("--diffuse", 0, "--specular", 0)
    np.testing.assert_allclose(seen("a", "--ambient", 0.4, *dark), 0.4, atol=1e-3)  # the surface is white
    tinted = seen("b", "--ambient", "0.1,0.2,0.3", *dark)
    np.testing.assert_allclose(tinted, np.tile([0.1, 0.2, 0.3], (len(tinted), 1)), atol=1e-3)
    usual, matt = seen("c"), seen("d", "--specular", 0)
    assert usual.max() > matt.max() + 0.05
    assert seen("e", "--shininess", 200).sum() < usual.sum()
    assert json.loads((tmp_path / "b/frames.json").read_text())["options"]["ambient"] == [0.1, 0.2, 0.3]
    wrong = call(*words, "--ambient", "0.1,x", "--out", tmp_path / "w")
    assert (wrong.exit_code, "neither a number nor three" in wrong.output) == (2, True)
    few = call(*words, "--ambient", "0.1,0.2", "--out", tmp_path / "w")
    assert (few.exit_code, "one or three numbers" in few.output) == (1, True)


def test_a_quad_is_seen_from_behind_where_asked(tmp_path, ball):
    call("relief", "dual", ball, "--side", "-x", "--texels", 32, "--out", tmp_path / "d")
    words = ("relief", "map", tmp_path / "d/quad.obj", "--packed", tmp_path / "d/packed.png", "--edges", "cut",
             "--path", "orbit:width=40,height=40,frames=4,elevation=0")  # fmt: skip
    call(*words, "--out", tmp_path / "one")
    call(*words, "--two-sided", "--out", tmp_path / "two")
    one, two = ([np.isfinite(read_depth(file)).sum() for file in sorted((tmp_path / name).glob("*.exr"))]
                for name in ("one", "two"))  # fmt: skip
    assert min(one) == 0
    assert (np.array(two) > 0).sum() > (np.array(one) > 0).sum()


def test_dual_depth_object_keeps_its_outline(tmp_path, ball):
    assert call("relief", "dual", ball, "--side", "-x", "--texels", 64, "--out", tmp_path / "d").exit_code == 0
    done = call("relief", "map", tmp_path / "d/quad.obj", "--packed", tmp_path / "d/packed.png", "--edges", "cut",
                "--thickness", 2.004, "--path", "orbit:width=60,height=60,frames=4,elevation=0", "--out",
                tmp_path / "f")  # fmt: skip
    assert done.exit_code == 0
    shares = [np.isfinite(read_depth(file)).mean() for file in sorted((tmp_path / "f").glob("*.exr"))]
    assert 0.15 < max(shares) < 0.35  # a disc two units deep, not the whole square
    assert min(shares) == 0.0  # nothing from behind


def test_deformed_copies_one_for_each_frame(tmp_path, ball):
    (tmp_path / "moved").mkdir()
    for k, size in enumerate((1.0, 1.3)):
        mesh = trimesh.load(ball, process=False)
        mesh.vertices *= size
        mesh.export(tmp_path / f"moved/ball_{k}.ply")
    words = ("relief", "map", ball, "--height", tmp_path / "height.png", "--search", "linear-binary",
             "--linear-steps", 16, "--anisotropy", 0, "--moved", tmp_path / "moved",
             "--out", tmp_path / "f")  # fmt: skip
    assert call(*words, "--path", "orbit:frames=1,width=40,height=30,up=y").exit_code == 0
    small, large = (np.isfinite(read_depth(file)).mean() for file in sorted((tmp_path / "f").glob("*.exr")))
    assert 1.4 < large / small < 2.0
    wrong = call(*words, "--path", "orbit:frames=3,width=40,height=30,up=y")
    assert wrong.exit_code == 1
    assert "2 moved meshes for 3 views" in wrong.output


@pytest.mark.parametrize(
    ("words", "code", "told"),
    [
        (("--light", "nan", 1, 2), 1, "renderer 'relief': light is (nan, 1.0, 2.0); give a place x y z"),
        (("--sun", "inf", 1, 2), 1, "light is (inf, 1.0, 2.0, 0.0); give a place x y z or a direction"),
        (("--model", "shell", "--mapping", "bump"), 1, "model 'shell' shows a relief, not mapping 'bump'"),
        (("--linear-steps", "abc"), 2, "'abc' is not a valid integer"),
        (("--linear-steps", 0), 2, "0 is not in the range 1<=x<=4096"),
        (("--least-steps", 4097), 2, "4097 is not in the range 1<=x<=4096"),
        (("--binary-steps", 65), 2, "65 is not in the range 0<=x<=64"),
        (("--anisotropy", -1), 2, "-1 is not in the range 0<=x<=64"),
        (("--search", "best"), 2, "'best' is not one of 'exact', 'linear-binary'"),
        (("--thickness", "nan"), 1, "thickness is nan; give a positive length"),
        (("--repeat", "nan", 1), 1, "uv holds NaN"),
        (("--height-range", "nan", 1), 1, "height_range is (nan, 1.0); give two different finite numbers"),
    ],
)
def test_wrong_options_are_one_line(tmp_path, ball, words, code, told):
    done = call("relief", "map", ball, "--height", tmp_path / "height.png", *words, "--out", tmp_path / "f")
    assert done.exit_code == code
    assert told in done.output
    assert sum("rror: " in line for line in done.output.splitlines()) == 1
    assert not (tmp_path / "f").exists()


def test_failures_are_one_line(tmp_path, ball):
    done = call("relief", "map", ball, "--out", tmp_path / "f")
    assert done.exit_code == 1
    assert "brings no heights" in done.output
    assert len(done.output.strip().splitlines()) == 1
    assert call("relief", "map", ball, "--light", 1, 2, 3, "--sun", 1, 2, 3, "--out", tmp_path / "f").exit_code == 2
    assert "choose among" in call("relief", "dual", ball, "--side", "up", "--out", tmp_path / "d").output
