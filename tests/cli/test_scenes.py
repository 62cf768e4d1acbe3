"""Scenes on the command line: generated, inspected, and what is told of wrong calls."""

from __future__ import annotations

import json

import numpy as np
import pytest
from click.testing import CliRunner

import ibrpipe
from ibrpipe.cli.main import cli
from ibrpipe.errors import ConfigError
from ibrpipe.io.photos.images import read_depth, read_image
from ibrpipe.io.surfaces.meshes import write_mesh
from ibrpipe.modelling.relief_textures import asset_from_reliefs
from ibrpipe.stages.render import _shown_bounds
from ibrpipe.synthetic.instanced.forest import forest
from ibrpipe.types import Mesh
from ibrpipe.types.camera import ParallelFrame
from ibrpipe.types.layers import single_layer


def call(*args):
    return CliRunner().invoke(cli, [str(each) for each in args])


def test_a_forest_is_written_and_inspected(tmp_path):
    made = call("synth", "forest", tmp_path / "wood", "--trees", 7, "--seed", 3, "--species", "oak")
    assert made.exit_code == 0, made.output
    assert "6 parts, 12,699 sub-objects, 209,106 polygons" in made.stdout
    wanted = forest(7, 3, ("oak",)).parts["forest"].children[0].matrices
    found = ibrpipe.read_scene(tmp_path / "wood")
    assert (found.parts["forest"].children[0].matrices == wanted).all()
    facts = json.loads(call("inspect", tmp_path / "wood", "--json").stdout)
    assert (facts["kind"], facts["root"], facts["polygons"]) == ("scene", "forest", 7 * 29872 + 2)
    assert facts["parts"]["oak-cluster"]["instances"] == 7 * 7 * 6**3
    assert facts["parts"]["oak-tree"]["sub_objects"] == 1814
    assert facts["bytes"] == sum(path.stat().st_size for path in (tmp_path / "wood").rglob("*") if path.is_file())
    assert "oak-cluster" in call("inspect", tmp_path / "wood" / "scene.yaml").stdout


@pytest.mark.parametrize(
    ("args", "message"),
    [
        (["forest", "x", "--blocks", "2"], "scene forest has no --blocks; leave it out"),
        (["glossy", "x", "--trees", "2"], "scene glossy has no --trees; leave it out"),
        (["solids", "x", "--seed", "2"], "scene solids has no --seed; leave it out"),
        (["forest", "x", "--trees", "0"], "0 is not in the range"),
        (["forest", "x", "--species", "mapel"], "there is no species 'mapel'; did you mean \"maple\"?"),
    ],
)
def test_wrong_settings_of_scenes_are_told(args, message):
    result = call("synth", *args)
    assert (result.exit_code, message in result.stderr) == (2, True), result.output


def test_an_asset_stands_on_a_lawn_in_a_clearing(tmp_path):
    asset = tmp_path / "asset"
    depth = np.tile(np.linspace(1.0, 1.5, 8, dtype=np.float32), (6, 1))
    frame = ParallelFrame(np.zeros(3), np.array([0.1, 0, 0]), np.array([0, 0, -0.2]), np.array([0, 1.0, 0]))
    layers = single_layer(frame, depth, np.full((6, 8, 3), 0.5, np.float32), observed=True)
    ibrpipe.write_asset(ibrpipe.Asset((ibrpipe.Texture(layers),)), asset)
    made = call("synth", "forest", tmp_path / "scene", "--trees", 30, "--asset", asset, "--asset-height", 2)
    assert made.exit_code == 0, made.output
    scene = ibrpipe.read_scene(tmp_path / "scene")
    held = {copies.part: copies.matrices for copies in scene.parts["forest"].children}
    bounds = scene.bounds["captured"]
    world = held["captured"][0]
    low, high = scene.parts["captured"].sources[0].bounds
    np.testing.assert_allclose((world[:3, :3] @ (high - low))[2], 2.0)
    bottom = world[:3, :3] @ [*(0.5 * (low + high))[:2], low[2]] + world[:3, 3]
    np.testing.assert_allclose(bottom, [0, 0, 0.02], atol=1e-12)
    assert not bounds.empty
    trees = np.concatenate([held["maple-tree"], held["oak-tree"]])[:, :2, 3]
    before = np.concatenate([copies.matrices for copies in forest(30).parts["forest"].children])[:, :2, 3]
    lawn = np.hypot(*held["grass"][:, :2, 3].T)
    assert 7 < lawn.max() < np.hypot(*trees.T).min()
    assert len(trees) == (np.hypot(*before.T) > lawn.max()).sum() < len(before)
    assert 20 < len(lawn) / (np.pi * lawn.max() ** 2) < 30


def test_a_folder_with_other_things_is_left_alone(tmp_path):
    (tmp_path / "note.txt").write_text("mine")
    result = call("synth", "solids", tmp_path)
    assert result.exit_code == 1
    assert "holds files but no scene that ibrpipe wrote" in result.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["note.txt"]


def test_a_scene_is_prerendered_and_rendered_along_an_orbit(tmp_path):
    call("synth", "solids", tmp_path / "scene")
    slicing = ("--directions", 6, "--finest", 4, "--rays", 1)
    made = call("prerender", tmp_path / "scene", "--out", tmp_path / "slices", *slicing)
    assert made.exit_code == 0, made.output
    assert "1 parts from 6 directions" in made.stdout
    path = ("--path", "orbit:frames=2,width=48,height=36", "--repeats", 1)
    shown = call("render", "--scene", tmp_path / "scene", "--slices", tmp_path / "slices", *path, "--out", tmp_path)
    assert shown.exit_code == 0, shown.output
    folder = tmp_path / "render-orbit-frames=2,width=48,height=36"
    assert f"{folder / 'hierarchical'}: 2 frames of hierarchical" in shown.stdout
    frames = json.loads((folder / "frames.json").read_text())
    assert [frame["width"] for frame in frames["frames"]] == [48, 48]
    assert (frames["samples"], frames["path"]) == (1, path[1])
    pixels = read_image(folder / frames["frames"][0]["file"])
    assert 0.03 < pixels[..., 3].mean() < 0.3


@pytest.mark.parametrize(
    ("args", "code", "message"),
    [
        (["--slices", "x"], 2, "--slices are those of a scene; give --scene, too"),
        (["--scene", "scene", "--path", "test"], 1, "a scene has no photos, so no path 'test'; give orbit"),
        (["--scene", "scene", "--path", "orbit:frame=2"], 2, "'frame=2' is not understood"),
        (["--scene", "none"], 1, "there is no such scene"),
        (["--scene", "scene", "--asset", "a"], 2, "--asset does nothing for a scene; leave out either it or --scene"),
        (["--scene", "scene", "--views", "v"], 2, "--views does nothing for a scene"),
        (["--scene", "scene", "--dask", "tcp://h:1"], 2, "--dask does nothing for a scene"),
        (
            ["--scene", "scene", "--slices", "none"],
            1,
            "prerendered.json: does not exist",
        ),
        (["--scene", "scene", "--renderers", "ldi"], 1, "renderer 'ldi' cannot take a Scene of meshes alone"),
        (["--scene", "scene", "--mesh", "m.ply"], 2, "--mesh does nothing for a scene"),
        (["--asset", "a", "--asset", "b", "--views", "v"], 2, "--views does nothing for several assets or meshes"),
        (["--asset", "a", "--mesh", "b.ply", "--dask", "tcp://h:1"], 2, "--dask does nothing for several assets"),
        (["--progressive", "--renderers", "splat"], 2, "with renderer ldi, not with splat"),
    ],
)
def test_wrong_calls_of_render_with_scenes_are_told(args, code, message, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    call("synth", "solids", "scene")
    result = call("render", *args, "--out", "out")
    assert (result.exit_code, message in result.stderr) == (code, True), result.output


def test_an_orbit_goes_round_the_copies_and_not_the_ground():
    low, high = _shown_bounds(forest(4))
    assert max(abs(low[0]), high[0]) < 20 < forest(4).bounds["forest"].high[0]
    with pytest.raises(ConfigError, match="the scene is empty"):
        _shown_bounds(ibrpipe.Scene([ibrpipe.Part("a")], "a"))


def sheet(folder, x, height, tint):
    """Write a level relief texture 1 x 1 in the plane z = height, its corner at x."""
    frame = ParallelFrame(
        np.array([x, 0.5, 0.0]), np.array([0.05, 0, 0]), np.array([0, -0.05, 0]), np.array([0, 0, 1.0])
    )
    color = np.tile(np.float32(tint), (20, 20, 1))
    relief = ibrpipe.ReliefTexture(frame, color, np.full((20, 20), height, np.float32))
    ibrpipe.write_asset(asset_from_reliefs([relief], ["sheet"], "test"), folder)
    return folder


def rendered(folder):
    """Colour, depth and camera of the one frame in a folder."""
    entry = json.loads((folder / "frames.json").read_text())["frames"][0]
    pixels = read_image(folder / entry["file"])
    return pixels[..., :3], read_depth(folder / entry["file"]), np.array(entry["cam_from_world"])


@pytest.mark.parametrize("renderer", ["ldi", "prewarp", "epipolar", "relief", "splat"])
def test_several_assets_and_meshes_are_in_one_picture(renderer, tmp_path):
    low, high = sheet(tmp_path / "low", 0.0, 0.0, (1, 0, 0)), sheet(tmp_path / "high", 0.5, 0.2, (0, 1, 0))
    corners = np.array([[1.2, -0.6, 0.4], [1.8, -0.6, 0.4], [1.8, 0.6, 0.4], [1.2, 0.6, 0.4]])
    write_mesh(Mesh(corners, np.array([[0, 1, 2], [0, 2, 3]])), tmp_path / "blue.ply")
    words = ("--path", "orbit:frames=1,width=90,height=60,elevation=89.9", "--samples", 1, "--repeats", 1)
    words = ("--mesh", tmp_path / "blue.ply", "--renderers", renderer, *words, "--out", tmp_path / "out")
    both = call("render", "--asset", low, "--asset", high, *words)
    assert both.exit_code == 0, both.output
    (folder,) = (tmp_path / "out").glob("render-orbit*")
    color, depth, pose = rendered(folder)
    near = np.isfinite(depth)
    eye_height = -(pose[:, :3].T @ pose[:, 3])[2]
    red, green = (color[..., 0] > 0.9) & near, (color[..., 1] > 0.9) & near
    grey = near & ~red & ~green
    for place, height in ((red, 0.0), (green, 0.2), (grey, 0.4)):
        assert place.sum() > 60
        assert np.median(depth[place]) == pytest.approx(eye_height - height, abs=0.02)
    # the upper sheet hides half of the lower one, and the mesh some of the upper one
    assert 1.6 < green.sum() / red.sum() < 2.0


def test_a_scene_places_assets_for_any_renderer(tmp_path):
    sheet(tmp_path / "sheet", -0.5, 0.0, (1, 0, 0))
    text = """
version: 1
root: room
parts:
  sheet: {assets: [sheet]}
  room: {children: [{part: sheet, at: [{translate: [0, 0, 1]}, {translate: [2, 0, 0], scale: 2}]}]}
"""
    (tmp_path / "scene.yaml").write_text(text)
    words = ("--path", "orbit:frames=1,width=90,height=60,elevation=89.9", "--samples", 1, "--repeats", 1)
    done = call("render", "--scene", tmp_path, "--renderers", "prewarp", *words, "--out", tmp_path / "out")
    assert done.exit_code == 0, done.output
    _, depth, pose = rendered(next((tmp_path / "out").glob("render-*")))
    eye_height = -(pose[:, :3].T @ pose[:, 3])[2]
    found, counts = np.unique(np.round(eye_height - depth[np.isfinite(depth)], 1), return_counts=True)
    assert set(found[counts > 5]) == {0.0, 1.0}
    share = counts[found == 0.0].sum() / counts[found == 1.0].sum()
    assert share == pytest.approx(4.0 * ((eye_height - 1) / eye_height) ** 2, rel=0.1)


def test_the_first_picture_is_written_first(tmp_path, monkeypatch):
    asset = sheet(tmp_path / "a", 0.0, 0.0, (1, 0, 0))
    words = ("--path", "orbit:frames=1,width=40,height=30", "--progressive", "--repeats", 2)
    done = call("render", "--asset", asset, *words, "--out", tmp_path / "out")
    assert done.exit_code == 0, done.output
    folder = next((tmp_path / "out").glob("render-*"))
    entry = json.loads((folder / "frames.json").read_text())["frames"][0]
    first, last = folder / entry["first"], folder / entry["png"]
    assert first.name == f"{last.stem}_first.png"
    assert first.stat().st_mtime_ns <= last.stat().st_mtime_ns
    assert 0 < entry["first_ms"] <= entry["ms"]
    one, other = (read_image(file)[..., 3] for file in (first, last))
    assert set(np.unique(one)) == {0, 1}  # one ray a pixel
    assert len(np.unique(other)) > 2  # several at edges
