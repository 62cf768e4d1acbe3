"""Impostors of parts: directions, what a ball and a wall look like, files, and scenes without meshes."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest
from click.testing import CliRunner
from page_assets import make_asset
from PIL import Image

import ibrpipe
from ibrpipe.cli.main import cli
from ibrpipe.export.impostor_sample import sample_files
from ibrpipe.export.impostors import (
    depth_bytes,
    folder_names,
    held_parts,
    octahedral_directions,
    view_axes,
    write_atlas,
)
from ibrpipe.io.assets import write_asset
from ibrpipe.io.photos.images import read_depth, read_image
from ibrpipe.synthetic.instanced.forest import forest
from ibrpipe.synthetic.instanced.pieces import painted_box, placed
from ibrpipe.synthetic.instanced.solids import painted_ball, solids
from ibrpipe.types import Instances, Part, Scene


def test_directions_cover_the_sphere_and_axes_are_right_handed():
    found = octahedral_directions(9)
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), 1.0)
    np.testing.assert_allclose(found[40], [0, 0, 1])
    np.testing.assert_allclose(found[[0, 8, 72, 80]], [[0, 0, -1]] * 4, atol=1e-15)
    sphere = np.random.default_rng(1).normal(size=(500, 3))
    sphere /= np.linalg.norm(sphere, axis=1, keepdims=True)
    assert np.degrees(np.arccos((sphere @ found.T).max(axis=1))).max() < 20
    axes = view_axes(found)
    np.testing.assert_allclose(axes @ axes.transpose(0, 2, 1), np.tile(np.eye(3), (81, 1, 1)), atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(axes), 1.0)
    level = np.abs(found[:, 2]) < 0.9
    assert (axes[level, 1, 2] > 0).all()


def test_a_ball_looks_alike_from_everywhere(tmp_path):
    scene = Scene([Part("ball", (painted_ball(2.0, (0.2, 0.4, 0.8), 48),))], "ball")
    atlas = write_atlas(scene, "ball", tmp_path, grid=4, texels=32, rays=2)
    assert atlas.radius == pytest.approx(2.0, rel=1e-6)
    albedo, depth = read_image(tmp_path / "albedo.png"), read_depth(tmp_path / "depth.exr")
    normal = read_image(tmp_path / "normal.exr")
    assert albedo.shape == (32 * 6, 32 * 4, 4)
    for view in atlas.views:
        place = np.s_[view.row * 32 : view.row * 32 + 32, view.column * 32 : view.column * 32 + 32]
        assert albedo[place][..., 3].mean() == pytest.approx(np.pi / 4, abs=0.02)
        np.testing.assert_allclose(albedo[place][16, 16, :3], [0.2, 0.4, 0.8], atol=0.01)
        assert depth[place][16, 16] == pytest.approx(0.0, abs=0.02)
        x = (np.arange(32) + 0.5) / 16 - 1
        right, up, toward = (np.array(each) for each in (view.right, view.up, view.direction))
        for j, i in ((16, 24), (6, 12), (22, 9)):
            wanted = x[i] * right - x[j] * up + np.sqrt(1 - x[i] ** 2 - x[j] ** 2) * toward
            assert normal[place][j, i] @ wanted > 0.985
    assert np.isinf(depth[0, 0])
    assert not normal[0, 0].any()


def test_depth_in_bytes_is_within_a_65535th_of_the_ball():
    depth = np.array([[0.0, 1.2345, 4.0, np.inf]])
    found = depth_bytes(depth, 2.0).astype(float)
    np.testing.assert_array_equal(found[0, :, 2], [255, 255, 255, 0])
    np.testing.assert_allclose(
        (256 * found[..., 0] + found[..., 1])[0, :3] * 4 / 65535, depth[0, :3], atol=2.01 / 65535
    )


def test_pictures_for_browsers_say_the_same(tmp_path):
    scene = Scene([Part("ball", (painted_ball(2.0, (0.2, 0.4, 0.8), 24),))], "ball")
    atlas = write_atlas(scene, "ball", tmp_path, grid=2, texels=16, rays=1)
    depth, normal = read_depth(tmp_path / "depth.exr"), read_image(tmp_path / "normal.exr")
    codes, turned = (np.asarray(Image.open(tmp_path / name), float) for name in (atlas.depth_png, atlas.normal_png))
    covered = np.isfinite(depth)
    np.testing.assert_array_equal(codes[..., 2] > 0, covered)
    found = (256 * codes[..., 0] + codes[..., 1]) * 2 * atlas.radius / 65535
    np.testing.assert_allclose(found[covered], depth[covered], atol=atlas.radius / 65535 * 1.01)
    np.testing.assert_allclose(turned / 127.5 - 1, normal, atol=0.5 / 127.5 + 1e-6)


def test_an_asset_is_one_part(tmp_path):
    write_asset(make_asset("gloss"), tmp_path / "run/asset")
    result = CliRunner().invoke(cli, ["export", str(tmp_path / "run"), str(tmp_path / "impostors")])
    assert result.exit_code == 0, result.output
    assert "npm install three" in result.output
    document = json.loads((tmp_path / "impostors/run/impostors.json").read_text())
    assert document["radius"] == pytest.approx(1, abs=0.05)  # a unit ball
    cover = read_image(tmp_path / "impostors/run/albedo.png")[:128, :128, 3]
    # samples reach to 0.98 of the radius, and triangles between their centres end up to a texel of 1/16 before it
    assert cover.mean() == pytest.approx(np.pi / 4 * 0.95**2, abs=0.03)


def test_the_sample_page_escapes_and_allows_its_own_files_alone():
    evil = "</script><img src=x onerror=alert(1)>"
    page = sample_files(evil, {evil: "part"})["index.html"]
    assert "<img src=x" not in page
    assert page.count("</script>") == 3
    policy = re.search(r'Policy" content="([^"]*)"', page)[1].replace("&#39;", "'")
    assert policy.startswith("default-src 'none'; script-src 'self' 'sha256-")
    assert "unsafe" not in policy
    texts = [*sample_files("a", {}).values()]
    assert {match for text in texts for match in re.findall(r"https?://[^/\s<]*", text)} == {"http://127.0.0.1:8000"}


def test_the_six_sides_show_what_is_there(tmp_path):
    box = Scene([Part("box", (painted_box((0, 0, 0), (4, 2, 1), (0.5, 0.5, 0.5)),))], "box")
    atlas = write_atlas(box, "box", tmp_path, grid=2, texels=64, rays=1)
    cover = read_image(tmp_path / "albedo.png")[..., 3]
    depth = read_depth(tmp_path / "depth.exr")
    sides = {tuple(view.direction): view for view in atlas.views[4:]}
    for direction, area, half in (((1, 0, 0), 2 * 1, 2), ((0, -1, 0), 4 * 1, 1), ((0, 0, 1), 4 * 2, 0.5)):
        view = sides[direction]
        place = np.s_[view.row * 64 : view.row * 64 + 64, view.column * 64 : view.column * 64 + 64]
        assert cover[place].mean() * (2 * atlas.radius) ** 2 == pytest.approx(area, rel=0.1)
        assert depth[place].min() == pytest.approx(atlas.radius - half, abs=1e-4)


def test_every_part_that_the_root_holds_is_exported(tmp_path):
    ibrpipe.write_scene(solids(), tmp_path / "scene")
    args = ["export", str(tmp_path / "scene"), str(tmp_path / "out"), "--format", "impostors"]
    result = CliRunner().invoke(cli, args)
    assert result.exit_code == 0, result.output
    there = sorted(path.name for path in (tmp_path / "out").iterdir())
    assert there == ["ball", "impostors.page.js", "impostors.three.js", "index.html", "wall"]
    document = json.loads((tmp_path / "out" / "wall" / "impostors.json").read_text())
    assert (document["part"], document["grid"], len(document["views"])) == ("wall", 8, 70)


def test_a_scene_without_meshes_is_told(tmp_path):
    empty = Scene([Part("a"), Part("b", children=(Instances("a", placed((0, 0, 0))),))], "b")
    ibrpipe.write_scene(empty, tmp_path / "scene")
    args = ["export", str(tmp_path / "scene"), str(tmp_path / "out"), "--format", "impostors"]
    result = CliRunner().invoke(cli, args)
    assert result.exit_code == 1
    assert "holds has no meshes, so there are no impostors to make" in result.stderr


def test_groves_are_taken_apart_into_trees():
    scene = forest(1100)
    assert sorted(held_parts(scene, scene.root)) == ["maple-tree", "oak-tree"]
    small = solids()
    assert held_parts(small, small.root) == ["wall", "ball"]


def test_folders_lie_inside_and_no_two_parts_share_one():
    assert folder_names(["..", ".", "木", "森", "oak 1", "oak-1", "Oak 1", "oak", ".git"]) == [
        "part", "part-2", "part-3", "part-4", "oak-1", "oak-1-2", "Oak-1-3", "oak", "git",
    ]  # fmt: skip


def test_parts_of_odd_names_stay_in_the_target(tmp_path):
    box = (painted_box((0, 0, 0), (1, 1, 1), (0.5, 0.5, 0.5)),)
    held = [Part("..", box), Part("木", box), Part("森", box)]
    root = Part("root", children=tuple(Instances(part.name, np.eye(4)) for part in held))
    ibrpipe.write_scene(Scene([*held, root], "root"), tmp_path / "scene")
    args = ["export", str(tmp_path / "scene"), str(tmp_path / "out" / "atlases"), "--format", "impostors"]
    result = CliRunner().invoke(cli, args)
    assert result.exit_code == 0, result.output
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["atlases"]
    page = (tmp_path / "out" / "atlases" / "index.html").read_text()
    assert json.loads(re.search(r'id="parts">(.*?)</script>', page)[1])[1] == {"name": "木", "folder": "part-2"}
    found = {
        path.parent.name: json.loads(path.read_text())["part"]
        for path in (tmp_path / "out" / "atlases").glob("*/impostors.json")
    }
    assert found == {"part": "..", "part-2": "木", "part-3": "森"}


def test_parts_of_too_many_polygons_are_refused_before_anything_is_written(tmp_path):
    box = (painted_box((0, 0, 0), (1, 1, 1), (0.5, 0.5, 0.5)),)
    parts, ten = [Part("0", box)], np.tile(np.eye(4), (10, 1, 1))
    parts += [Part(str(n + 1), box, children=(Instances(str(n), ten),)) for n in range(9)]
    ibrpipe.write_scene(Scene(parts, "9"), tmp_path / "scene")
    args = ["export", str(tmp_path / "scene"), str(tmp_path / "out"), "--format", "impostors"]
    result = CliRunner().invoke(cli, args)
    assert result.exit_code == 1
    assert "part '8' has 1,333,333,332 polygons with its copies; impostors are made of at most 4,000,000" in (
        result.stderr
    )
    assert not (tmp_path / "out").exists()
