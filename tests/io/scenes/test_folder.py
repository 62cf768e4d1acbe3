"""Scene folders: what is written is read again, authored ones mean what they say, wrong ones say where."""

from __future__ import annotations

import logging

import numpy as np
import pytest
import yaml

import ibrpipe
from ibrpipe.errors import ConfigError, FormatError, IbrError, MissingFileError, RendererError, ResourceError
from ibrpipe.io.documents.scene import Placement
from ibrpipe.io.photos.images import write_png
from ibrpipe.io.scenes.placement import placement_matrix
from ibrpipe.io.surfaces.meshes import write_mesh
from ibrpipe.synthetic.instanced.city import city
from ibrpipe.synthetic.instanced.forest import forest
from ibrpipe.synthetic.instanced.solids import solids
from ibrpipe.types import Instances, Light, Lighting, Mesh, PaintedMesh, Part, ReliefTexture, Scene
from ibrpipe.types.camera import Camera, ParallelFrame
from ibrpipe.types.layers import single_layer
from ibrpipe.types.textures import DepthImage

TRIANGLE = Mesh(np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]), np.array([[0, 1, 2]]))


def assert_same(one, two):
    assert list(one.parts) == list(two.parts)
    assert one.root == two.root
    np.testing.assert_array_equal(one.lighting.ambient, two.lighting.ambient)
    for a, b in zip(one.lighting.lights, two.lighting.lights, strict=True):
        np.testing.assert_allclose(a.direction, b.direction, rtol=1e-15)
        np.testing.assert_array_equal(a.color, b.color)
    for name, part in one.parts.items():
        for a, b in zip(part.meshes, two.parts[name].meshes, strict=True):
            np.testing.assert_array_equal(a.mesh.vertices, b.mesh.vertices)
            np.testing.assert_array_equal(a.mesh.faces, b.mesh.faces)
            np.testing.assert_array_equal(a.color, b.color)
            assert (a.specular, a.shininess if a.specular else 32.0) == (b.specular, b.shininess)
        for a, b in zip(part.children, two.parts[name].children, strict=True):
            assert a.part == b.part
            np.testing.assert_array_equal(a.matrices, b.matrices)


@pytest.mark.parametrize("made", [lambda: forest(30, 0), lambda: city(2), solids], ids=["forest", "city", "solids"])
def test_generated_scenes_come_back_bit_by_bit(made, tmp_path):
    scene = made()
    ibrpipe.write_scene(scene, tmp_path / "scene")
    assert_same(scene, ibrpipe.read_scene(tmp_path / "scene"))
    assert_same(scene, ibrpipe.read_scene(tmp_path / "scene" / "scene.yaml"))


def relief():
    frame = ParallelFrame(np.zeros(3), np.array([0.1, 0, 0]), np.array([0, 0.2, 0.01]), np.array([0, 0, 1.0]))
    height = np.random.default_rng(1).random((4, 6)).astype(np.float32)
    height[0, 0] = np.nan
    return ReliefTexture(frame, np.random.default_rng(2).random((4, 6, 3)).astype(np.float32), height)


def test_captured_sources_highlights_lights_and_flattened_copies_come_back(tmp_path, caplog):
    layers = single_layer(Camera.look_at((0, 0, 3), (0, 0, 0), width=6, height=4), np.full((4, 6), 3.0),
                          np.full((4, 6, 3), 0.25, np.float32), observed=True)  # fmt: skip
    painted = PaintedMesh(TRIANGLE, np.eye(3, dtype=np.float32), 0.5, 8.0)
    flat = np.tile(np.eye(4), (20, 1, 1))
    flat[3, 0, 0] = 0.0
    inner = Part("a leaf: ä", (painted,), (relief(), layers, ibrpipe.Texture(layers)))
    scene = Scene([inner, Part("root", children=(Instances(inner.name, flat),))], "root",
                  Lighting(np.array([0.1, 0.2, 0.3]), (Light([1, 2, 3], [0, 1, 2]), Light([0, 0, -1]))))  # fmt: skip
    ibrpipe.write_scene(scene, tmp_path / "scene")
    with caplog.at_level(logging.WARNING):
        found = ibrpipe.read_scene(tmp_path / "scene")
    assert "1 of 20 copies of a leaf: ä are flattened by singular matrices (the first is number 3)" in caplog.text
    assert_same(scene, found)
    images, one, two = found.parts[inner.name].sources[2], *found.parts[inner.name].sources[:2]
    np.testing.assert_array_equal(images.height, relief().height)
    np.testing.assert_array_equal(images.color, relief().color)
    np.testing.assert_array_equal(images.frame.world_from_local, relief().frame.world_from_local)
    for asset in (one, two):
        np.testing.assert_array_equal(asset.textures[0].layers.depth, layers.depth)


def test_a_new_scene_takes_the_place_of_the_old_and_leaves_what_users_put_there(tmp_path):
    ibrpipe.write_scene(forest(30), tmp_path / "scene")
    (tmp_path / "scene" / "meshes" / "note.txt").write_text("mine")
    ibrpipe.write_scene(solids(), tmp_path / "scene")
    left = {path.name for path in (tmp_path / "scene").rglob("*") if path.is_file()}
    assert left == {"scene.yaml", "note.txt", "000-wall-0.ply", "001-ball-0.ply"}


def test_meshes_that_users_named_in_a_written_scene_stay(tmp_path):
    ibrpipe.write_scene(solids(), tmp_path / "scene")
    content = yaml.safe_load((tmp_path / "scene" / "scene.yaml").read_text())
    write_mesh(TRIANGLE, tmp_path / "scene" / "meshes" / "mine.ply")
    content["parts"]["ball"]["meshes"].append({"file": "meshes/mine.ply"})
    (tmp_path / "scene" / "scene.yaml").write_text(yaml.safe_dump(content, sort_keys=False))
    ibrpipe.write_scene(ibrpipe.read_scene(tmp_path / "scene"), tmp_path / "scene")
    left = {path.name for path in (tmp_path / "scene").rglob("*.ply")}
    assert left == {"mine.ply", "000-wall-0.ply", "001-ball-0.ply", "001-ball-1.ply"}


def test_scenes_made_by_hand_are_not_written_over(tmp_path):
    write(tmp_path, {"root": "a", "parts": {"a": {}}})
    with pytest.raises(ResourceError, match="holds files but no scene that ibrpipe wrote; name another folder"):
        ibrpipe.write_scene(solids(), tmp_path)


def test_what_has_no_form_in_a_folder_is_told_and_leaves_nothing(tmp_path):
    image = DepthImage(Camera.look_at((0, 0, 3), (0, 0, 0), width=2, height=2), np.zeros((2, 2, 3)), np.ones((2, 2)))
    with pytest.raises(RendererError, match="DepthImage has no form of its own in a scene folder; make an asset"):
        ibrpipe.write_scene(Scene([Part("a", sources=(image,))], "a"), tmp_path / "scene")
    assert list(tmp_path.iterdir()) == []


def write(folder, content):
    text = content if isinstance(content, str) else yaml.safe_dump({"version": 1, **content}, sort_keys=False)
    (folder / "scene.yaml").write_text(text, encoding="utf-8")
    return folder


def test_an_authored_hierarchy_means_what_it_says(tmp_path):
    write_mesh(TRIANGLE, tmp_path / "plain.ply")
    codes = np.array([[255, 188, 0]] * 3)
    (tmp_path / "painted.ply").write_text(
        "ply\nformat ascii 1.0\nelement vertex 3\n" + "".join(f"property float {a}\n" for a in "xyz")
        + "".join(f"property uchar {c}\n" for c in ("red", "green", "blue"))
        + "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
        + "".join(f"{x} {y} 0 {r} {g} {b}\n" for (x, y), (r, g, b) in zip(((0, 0), (1, 0), (0, 1)), codes))
        + "3 0 1 2\n"
    )  # fmt: skip
    (tmp_path / "brick").mkdir()
    write_png(tmp_path / "brick" / "height.png", np.full((4, 8, 1), 0.5, np.float32))
    write_png(tmp_path / "brick" / "color.png", np.full((4, 8, 3), 0.5, np.float32))
    np.save(tmp_path / "many.npy", np.tile(np.eye(4)[:3], (5, 1, 1)))
    write(
        tmp_path,
        """
version: 1
root: scene
parts:
  leaf:
    meshes:
      - {file: plain.ply, color: [0.1, 0.2, 0.3], specular: 0.5}
      - {file: painted.ply}
  wall:
    reliefs:
      - {folder: brick, size: [2, 1], depth_range: [0, 0.1]}
  scene:
    meshes: [{file: plain.ply}]
    children:
      - part: leaf
        at:
          - {scale: [1, 2, 3], rotate: {axis: [0, 0, 5], degrees: 90}, translate: [1, 0, 0]}
          - {matrix: [[1, 0, 0, 7], [0, 1, 0, 8], [0, 0, 1, 9]]}
      - {part: leaf, matrices: many.npy}
      - {part: wall}
""",
    )
    scene = ibrpipe.read_scene(tmp_path)
    plain, painted = scene.parts["leaf"].meshes
    np.testing.assert_array_equal(plain.color, np.tile(np.float32([0.1, 0.2, 0.3]), (3, 1)))
    assert plain.specular == 0.5
    np.testing.assert_allclose(painted.color, np.tile([1.0, 0.503, 0.0], (3, 1)), atol=1e-3)
    wall = scene.parts["wall"].sources[0]
    np.testing.assert_allclose(wall.height, 0.1 * 188 / 255, atol=1e-6)
    np.testing.assert_array_equal(wall.frame.a, [0.25, 0, 0])
    authored, many, one = scene.parts["scene"].children
    np.testing.assert_array_equal(authored.matrices[0], [[0, -2, 0, 1], [1, 0, 0, 0], [0, 0, 3, 0], [0, 0, 0, 1]])
    np.testing.assert_array_equal(authored.matrices[1][:3, 3], [7, 8, 9])
    assert (len(many), len(one)) == (5, 1)


def test_turns_follow_each_other_and_quarters_are_exact():
    turns = [{"axis": [0, 0, 1], "degrees": 90}, {"axis": [1, 0, 0], "degrees": -270}]
    matrix = placement_matrix(Placement(rotate=turns))
    np.testing.assert_array_equal(matrix[:3, :3] @ [1, 0, 0], [0, 0, 1])
    slight = placement_matrix(Placement(rotate={"axis": [0, 0, 2], "degrees": 30}))
    np.testing.assert_allclose(slight[:2, :2], [[0.75**0.5, -0.5], [0.5, 0.75**0.5]], atol=1e-15)


def test_a_part_may_be_another_scene(tmp_path):
    ibrpipe.write_scene(forest(5), tmp_path / "forest")
    write(tmp_path, {"root": "both", "parts": {"both": {"children": [{"part": "wood"}]}, "wood": {"scene": "forest"}}})
    found, alone = ibrpipe.read_scene(tmp_path), forest(5)
    assert found.polygons["both"] == alone.polygons["forest"]
    assert found.parts["wood"].children[0].part == "wood.forest"


PARTS = {"a": {"children": [{"part": "b"}]}, "b": {"meshes": [{"file": "t.ply"}]}}


def changed(**parts):
    return {"root": "a", "parts": {**PARTS, **parts}}


@pytest.mark.parametrize(
    ("content", "error", "words"),
    [
        ("a: [", ConfigError, "scene.yaml:1: not valid YAML"),
        ({"parts": {}}, ConfigError, "root is missing; add it"),
        ({"root": "c", "parts": PARTS}, ConfigError, "scene.yaml:2: the scene's root 'c' is no part; expected"),
        ({**changed(), "lights": 1}, ConfigError, 'unknown key "lights"; did you mean "lighting"'),
        (changed(b={"children": [{"part": "a"}]}), ConfigError, r"holds copies of itself \(a > b > a\); a scene"),
        (changed(a={"children": [{"part": "bb"}]}), ConfigError, "scene.yaml:6: there is no part 'bb'; did you mean"),
        (changed(b={"meshes": [{"file": "no.ply"}]}), MissingFileError, r"scene.yaml:\d+: .*no.ply: the mesh does not"),
        (changed(b={"meshes": [{"file": "../t.ply"}]}), ConfigError, "'../t.ply' leads out of the scene's folder"),
        (changed(b={"meshes": [{"file": "/etc/t.ply"}]}), ConfigError, "leads out of the scene's folder; put what"),
        (changed(b={"assets": ["no"]}), MissingFileError, r"scene.yaml:\d+: .*no"),
        (changed(b={"scene": "."}), ConfigError, "holds itself, through parts that are scenes"),
        (changed(b={"scene": "no"}), MissingFileError, "there is no such scene; give a folder with scene.yaml"),
        (changed(b={"reliefs": [{"folder": "x"}]}), ConfigError, "give size or frame, one of them"),
        (changed(a={"children": [{"part": "b", "at": [{"scale": float("nan")}]}]}), ConfigError, "finite number"),
        (changed(a={"children": [{"part": "b", "at": [{"matrix": [[1, 0, 0, 0]] * 4}]}]}), ConfigError, "ends in row"),
        (changed(a={"children": [{"part": "b", "at": [{"matrix": [[1, 0]] * 3}]}]}), ConfigError, "4 items"),
        (changed(a={"children": [{"part": "b", "at": [], "matrices": "m.npy"}]}), ConfigError, "at stands beside matr"),
        (changed(a={"children": [{"part": "b", "matrices": "no.npy"}]}), MissingFileError, "the matrices do not exist"),
        (changed(a={"children": [{"part": "b", "matrices": "bad.npy"}]}), FormatError, r"got float64 \(3, 3\)"),
        (changed(a={"children": [{"part": "b", "matrices": "nan.npy"}]}), IbrError, "matrix 0 of 'b' holds NaN"),
        (changed(a={"children": [{"part": "b", "matrices": "t.ply"}]}), FormatError, "t.ply: not a NumPy array file"),
        (changed(**{"x/y": {}}), IbrError, "give a name without /"),
        ({**changed(), "lighting": {"lights": [{"direction": [0, 0, 0]}]}}, IbrError, "direction must not be zero"),
        ({**changed(), "version": 2}, ConfigError, "scene.yaml:1: version is 2"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_told_in_one_line_with_its_place(content, error, words, tmp_path):
    write_mesh(TRIANGLE, tmp_path / "t.ply")
    np.save(tmp_path / "bad.npy", np.eye(3))
    np.save(tmp_path / "nan.npy", np.full((1, 4, 4), np.nan))
    write(tmp_path, content)
    with pytest.raises(error, match=words) as told:
        ibrpipe.read_scene(tmp_path)
    assert "\n" not in str(told.value)
    assert str(told.value).startswith(str(tmp_path / "scene.yaml"))


def test_what_is_no_scene_is_told(tmp_path):
    with pytest.raises(MissingFileError, match="there is no such scene"):
        ibrpipe.read_scene(tmp_path)
    (tmp_path / "scene.txt").write_text("")
    with pytest.raises(FormatError, match=r"is no scene; expected scene.yaml or a .glb or .gltf file"):
        ibrpipe.read_scene(tmp_path / "scene.txt")
