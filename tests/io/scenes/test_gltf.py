"""glTF files as scenes: shared meshes, hierarchy, instances, colours, and what is wrong with files."""

from __future__ import annotations

import base64
import io
import json

import numpy as np
import pytest
import trimesh
from PIL import Image

import ibrpipe
from ibrpipe.errors import FormatError, MissingFileError

CORNERS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], np.float32)


class Builder:
    """A glTF file put together by hand."""

    def __init__(self):
        self.json = {"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [], "meshes": [],
                     "accessors": [], "bufferViews": [], "buffers": [], "materials": []}  # fmt: skip

    def accessor(self, values, component=5126, normalized=False):
        kind = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}[component]
        stored = np.ascontiguousarray(values, kind)
        data = stored.tobytes()
        uri = "data:application/octet-stream;base64," + base64.b64encode(data).decode()
        self.json["buffers"].append({"byteLength": len(data), "uri": uri})
        self.json["bufferViews"].append({"buffer": len(self.json["buffers"]) - 1, "byteLength": len(data)})
        width = 1 if stored.ndim == 1 else stored.shape[1]
        self.json["accessors"].append({"bufferView": len(self.json["bufferViews"]) - 1, "componentType": component,
            "count": len(stored), "type": {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4"}[width],
            "normalized": normalized, "min": [0, 0, 0], "max": [1, 1, 1]})  # fmt: skip
        return len(self.json["accessors"]) - 1

    def mesh(self, name="leaf", primitives=1, **attributes):
        made = [{"attributes": {"POSITION": self.accessor(CORNERS + n), **attributes}} for n in range(primitives)]
        self.json["meshes"].append({"name": name, "primitives": made})
        return made[0]

    def write(self, folder, nodes, top=(0,)):
        self.json |= {"nodes": nodes, "scenes": [{"nodes": list(top)}]}
        (folder / "scene.gltf").write_text(json.dumps(self.json))
        return folder / "scene.gltf"


def test_shared_meshes_and_equal_nodes_are_one_part_and_the_hierarchy_stays(tmp_path):
    made = Builder()
    made.mesh("leaf")
    made.mesh("stem", 2)
    nodes = [{"name": "wood", "children": [1, 4]}]
    for first, x in ((1, 0.0), (4, 5.0)):
        nodes += [{"name": "tree", "mesh": 1, "children": [first + 1, first + 2], "translation": [x, 0, 0]},
                  {"mesh": 0, "scale": [1, 2, -1]}, {"mesh": 0, "rotation": [0, 0, 0.5**0.5, 0.5**0.5]}]  # fmt: skip
    scene = ibrpipe.read_scene(made.write(tmp_path, nodes))
    assert list(scene.parts) == ["leaf", "stem", "tree", "wood", "scene"]
    assert scene.polygons == {"stem": 2, "leaf": 1, "tree": 4, "wood": 8, "scene": 8}
    stem, leaves = scene.parts["tree"].children
    assert (stem.part, len(stem), leaves.part, len(leaves)) == ("stem", 1, "leaf", 2)
    np.testing.assert_array_equal(leaves.matrices[0], np.diag([1, 2, -1, 1]))
    np.testing.assert_allclose(leaves.matrices[1][:3, :3], [[0, -1, 0], [1, 0, 0], [0, 0, 1]], atol=1e-15)
    np.testing.assert_array_equal(scene.parts["wood"].children[0].matrices[:, 0, 3], [0, 5])


def test_copies_of_the_instancing_extension_are_copies(tmp_path):
    made = Builder()
    made.mesh()
    made.json["extensionsUsed"] = made.json["extensionsRequired"] = ["EXT_mesh_gpu_instancing"]
    places = np.random.default_rng(1).random((50, 3)).astype(np.float32)
    turns = np.round(np.tile([0, 0, 32767 * 0.5**0.5, 32767 * 0.5**0.5], (50, 1)))
    attributes = {"TRANSLATION": made.accessor(places), "ROTATION": made.accessor(turns, 5122, True),
                  "SCALE": made.accessor(np.full((50, 3), 2.0))}  # fmt: skip
    node = {"mesh": 0, "matrix": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 10, 0, 0, 1],
            "extensions": {"EXT_mesh_gpu_instancing": {"attributes": attributes}}}  # fmt: skip
    scene = ibrpipe.read_scene(made.write(tmp_path, [node]))
    copies = scene.parts["scene"].children[0]
    assert (copies.part, len(copies)) == ("leaf", 50)
    np.testing.assert_allclose(copies.matrices[:, :3, 3], places + np.array([10.0, 0, 0]))
    np.testing.assert_allclose(copies.matrices[7, :3, :3], [[0, -2, 0], [2, 0, 0], [0, 0, 2]], atol=1e-4)


def test_colours_are_linear_and_exact(tmp_path):
    made = Builder()
    made.json["materials"] = [{"pbrMetallicRoughness": {"baseColorFactor": [0.5, 0.011, 0.02, 1]}}]
    paint = np.array([[0.001, 0.2, 1.0], [0.5, 0.5, 0.5], [1, 0, 0]], np.float32)
    codes = np.array([[0, 51, 255, 255]] * 3)
    made.mesh("floats", COLOR_0=made.accessor(paint))
    made.mesh("codes", COLOR_0=made.accessor(codes, 5121, True))["material"] = 0
    made.mesh("material")["material"] = 0
    made.mesh("bare")
    nodes = [{"mesh": n} for n in range(4)]
    parts = ibrpipe.read_scene(made.write(tmp_path, nodes, range(4))).parts
    np.testing.assert_array_equal(parts["floats"].meshes[0].color, paint)
    np.testing.assert_allclose(parts["codes"].meshes[0].color[0], [0, 0.2 * 0.011, 0.02], rtol=1e-6)
    np.testing.assert_allclose(parts["material"].meshes[0].color[2], [0.5, 0.011, 0.02], rtol=1e-6)
    np.testing.assert_allclose(parts["bare"].meshes[0].color[2], 0.6)


def test_textures_give_colours_at_vertices(tmp_path):
    made = Builder()
    pixels = np.zeros((2, 2, 3), np.uint8)
    pixels[0, 0], pixels[1, 1] = (255, 0, 0), (0, 0, 188)  # top left red, bottom right blue
    data = io.BytesIO()
    Image.fromarray(pixels).save(data, "PNG")
    made.json["images"] = [{"uri": "data:image/png;base64," + base64.b64encode(data.getvalue()).decode()}]
    made.json |= {"textures": [{"source": 0}]}
    made.json["materials"] = [
        {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}, "baseColorFactor": [1, 1, 0.5, 1]}}
    ]
    uv = np.array([[0.25, 0.25], [0.75, 0.75], [0.5, 0.5]])
    made.mesh(TEXCOORD_0=made.accessor(uv))["material"] = 0
    color = ibrpipe.read_scene(made.write(tmp_path, [{"mesh": 0}])).parts["leaf"].meshes[0].color
    np.testing.assert_allclose(color, [[1, 0, 0], [0, 0, 0.2514], [0.25, 0, 0.0629]], atol=1e-3)


def test_a_glb_of_trimesh_reads_as_a_flat_list_would(tmp_path):
    ball = trimesh.creation.icosphere(1)
    scene = trimesh.Scene()
    scene.add_geometry(ball, node_name="a", geom_name="ball")
    mirror = np.diag([1.0, -2.0, 1.0, 1.0])
    mirror[:3, 3] = 4, 0, 0
    scene.graph.update("b", "a", matrix=mirror, geometry="ball")
    scene.export(tmp_path / "scene.glb")
    found = ibrpipe.read_scene(tmp_path / "scene.glb")
    assert found.polygons["scene"] == 160
    assert sum(bool(part.meshes) for part in found.parts.values()) == 1
    low, high = found.bounds["scene"].low, found.bounds["scene"].high
    np.testing.assert_allclose([low, high], scene.bounds, atol=1e-6)


def test_hidden_nodes_and_points_show_nothing(tmp_path):
    made = Builder()
    made.mesh()
    made.mesh("points")["mode"] = 0
    nodes = [{"mesh": 0}, {"mesh": 0, "extensions": {"KHR_node_visibility": {"visible": False}}}, {"mesh": 1}]
    scene = ibrpipe.read_scene(made.write(tmp_path, nodes, range(3)))
    assert (list(scene.parts), scene.polygons["scene"]) == (["leaf", "scene"], 1)
    with pytest.raises(FormatError, match="shows no triangles; export surfaces"):
        ibrpipe.read_scene(made.write(tmp_path, nodes, [1, 2]))


def instanced(**numbers):
    return {"mesh": 0, "extensions": {"EXT_mesh_gpu_instancing": {"attributes": numbers}}}


@pytest.mark.parametrize(
    ("nodes", "words"),
    [
        ([{"name": "a", "children": [1]}, {"name": "b", "children": [0], "mesh": 0}], "node 'a' is its own child"),
        ([{"mesh": 0, "matrix": [float("nan")] * 16}], "matrix of node 0 holds NaN or infinity"),
        ([{"mesh": 0, "scale": [1, float("inf"), 1]}], "matrix of node 0 holds NaN or infinity"),
        ([{"mesh": 5}], "the scene is damaged"),
        ([{"mesh": 0, "matrix": [1, 2, 3]}], "the scene is damaged"),
        ([instanced(TRANSLATION=1, SCALE=2)], r"the copies of node 0 have \[2, 3\] places, turns and sizes"),
        ([instanced(TRANSLATION=3)], "copies of node 0 are placed at NaN or infinity"),
        ([{"mesh": 0, "matrix": [1, 0, 0, 5, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]}], "ends in row"),
    ],
)
def test_damaged_files_are_told_in_one_line(nodes, words, tmp_path):
    made = Builder()
    made.mesh()
    made.accessor(np.zeros((2, 3)))
    made.accessor(np.ones((3, 3)))
    made.accessor(np.full((2, 3), np.nan))
    path = made.write(tmp_path, nodes)
    with pytest.raises(FormatError, match=words) as told:
        ibrpipe.read_scene(path)
    assert str(told.value).startswith(str(path))
    assert "\n" not in str(told.value)


def test_missing_and_broken_files_are_told(tmp_path):
    with pytest.raises(MissingFileError, match="the scene does not exist"):
        ibrpipe.read_scene(tmp_path / "no.glb")
    (tmp_path / "cut.glb").write_bytes(b"glTF\2\0\0\0")
    with pytest.raises(FormatError, match=r"cut\.glb"):
        ibrpipe.read_scene(tmp_path / "cut.glb")
