"""Meshes as other programs write them: polygons, relative indices, quantised and compressed glTF, materials, units."""

import json
import shutil

import numpy as np
import pytest
import trimesh
from PIL import Image

import ibrpipe
from ibrpipe.capture.audit import Surface
from ibrpipe.capture.coverage import spread_points
from ibrpipe.capture.units import other_units
from ibrpipe.embree import MeshCaster
from ibrpipe.errors import CaptureError, FormatError, MissingFileError
from ibrpipe.io.surfaces import gltf_file
from ibrpipe.io.surfaces.mesh_materials import read_textured
from ibrpipe.io.surfaces.meshes import read_mesh, read_surface
from ibrpipe.stages.ingest import IngestConfig, Inputs, run
from ibrpipe.types import Mesh

#: An L of area 3 with its inner corner at (1, 1), begun where a fan leaves it; extruded by 0.5
OUTLINE = np.array([[2, 0], [2, 1], [1, 1], [1, 2], [0, 2], [0, 0]], np.float64)
AREA, VOLUME = 2 * 3 + 8 * 0.5, 3 * 0.5


def prism():
    count = len(OUTLINE)
    points = np.concatenate([np.column_stack([OUTLINE, np.full(count, z)]) for z in (0.0, 0.5)])
    sides = [[n, (n + 1) % count, count + (n + 1) % count, count + n] for n in range(count)]
    return points, [list(range(count))[::-1], list(range(count, 2 * count)), *sides]


def area_and_volume(mesh):
    corners = mesh.vertices[mesh.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    volume = (corners[:, 0] * np.cross(corners[:, 1], corners[:, 2])).sum() / 6
    return np.linalg.norm(normals, axis=1).sum() / 2, volume


def write_ply(path, kind, points, faces):
    header = f"ply\nformat {kind} 1.0\nelement vertex {len(points)}\n"
    header += "".join(f"property double {axis}\n" for axis in "xyz")
    header += f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    if kind == "ascii":
        rows = [" ".join(map(repr, point)) for point in points.tolist()]
        rows += [" ".join(map(str, [len(face), *face])) for face in faces]
        path.write_text(header + "\n".join(rows) + "\n")
    else:
        order = "<" if "little" in kind else ">"
        body = b"".join(bytes([len(face)]) + np.array(face, f"{order}i4").tobytes() for face in faces)
        path.write_bytes(header.encode() + points.astype(f"{order}f8").tobytes() + body)


@pytest.mark.parametrize("turned", [0, 1, 2, 3, 4, 5])
@pytest.mark.parametrize("kind", ["ascii", "binary_little_endian", "binary_big_endian", "obj", "obj relative"])
def test_concave_polygons_keep_area_volume_and_sides(tmp_path, kind, turned):
    points, faces = prism()
    faces[:2] = [face[turned:] + face[:turned] for face in faces[:2]]
    if kind.startswith("obj"):
        path, shift = tmp_path / "m.obj", -len(points) if "relative" in kind else 1
        rows = [f"v {x} {y} {z}" for x, y, z in points] + ["f " + " ".join(str(n + shift) for n in f) for f in faces]
        path.write_text("\n".join(rows))
    else:
        path = tmp_path / "m.ply"
        write_ply(path, kind, points, faces)
    assert area_and_volume(read_mesh(path)) == pytest.approx((AREA, VOLUME))


def test_relative_indices_count_from_where_they_stand(tmp_path):
    path = tmp_path / "m.obj"
    path.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf -3 -2 -1\nv 5 0 0\nv 7 0 0\nv 5 2 0\nf -3/1 -2/1 -1/1\nvt 0 0\n")
    assert area_and_volume(read_mesh(path))[0] == pytest.approx(0.5 + 2)
    path.write_text("v 0 0 0\nf -3 -2 -1\n")
    with pytest.raises(FormatError, match="counts -3 back from 1"):
        read_mesh(path)


def test_vertices_that_no_face_uses_do_not_count(tmp_path):
    points, faces = prism()
    write_ply(tmp_path / "m.ply", "ascii", np.concatenate([points, [[1e3, 1e3, 1e3]] * 2]), faces)
    assert read_surface(tmp_path / "m.ply").vertices.max() == 2
    assert area_and_volume(read_surface(tmp_path / "m.ply")) == pytest.approx((AREA, VOLUME))


# glTF


def gltf(path, change=lambda document, add: None, positions=None, uv=None):
    """Write a square of two triangles with a texture, red left and blue right; `change` edits the document."""
    data, views, accessors = b"", [], []
    kinds = {"float32": 5126, "uint16": 5123, "int16": 5122, "uint8": 5121}

    def add(values, **more):
        nonlocal data
        values = np.asarray(values)
        views.append({"buffer": 0, "byteOffset": len(data), "byteLength": values.nbytes})
        data += values.tobytes() + b"\0" * (-values.nbytes % 4)
        shape = {1: "SCALAR", 2: "VEC2", 3: "VEC3"}[values.shape[1] if values.ndim > 1 else 1]
        kind = kinds[values.dtype.name]
        bounds = {"min": values.min(0).tolist(), "max": values.max(0).tolist()} if values.ndim > 1 else {}
        accessors.append(
            {"bufferView": len(views) - 1, "componentType": kind, "count": len(values), "type": shape, **bounds, **more}
        )
        return len(accessors) - 1

    square = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], np.float32)
    attributes = {"POSITION": add(square if positions is None else positions[0], **(positions or [0, {}])[1])}
    attributes["TEXCOORD_0"] = add(np.array([[0, 1], [1, 1], [1, 0], [0, 0]], np.float32) if uv is None else uv)
    primitive = {"attributes": attributes, "indices": add(np.array([0, 1, 2, 0, 2, 3], np.uint16)), "material": 0}
    Image.fromarray(np.array([[[255, 0, 0], [0, 0, 255]]], np.uint8)).save(path.with_name("t.png"))
    document = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [primitive]}],
        "materials": [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}],
        "textures": [{"source": 0}],
        "images": [{"uri": "t.png"}],
        "bufferViews": views,
        "accessors": accessors,
    }
    change(document, add)
    path.with_name("data.bin").write_bytes(data)
    document["buffers"] = [{"uri": "data.bin", "byteLength": len(data)}]
    path.write_text(json.dumps(document))
    return path


def test_normalised_integers_are_shares_of_full_scale(tmp_path):
    codes = np.array([[-32767, 0, 0], [32767, 0, 0], [32767, 16384, 0], [-32768, 16384, 0]], np.int16)

    def change(document, add):
        document["extensionsRequired"] = ["KHR_mesh_quantization"]
        document["nodes"][0]["scale"] = [2, 2, 2]

    padded = np.zeros((4, 4), np.int16)
    padded[:, :3] = codes
    path = gltf(tmp_path / "m.gltf", change, (codes, {"normalized": True}))
    found = read_mesh(path)
    assert np.abs(found.vertices[:, 0]).tolist() == [2, 2, 2, 2]
    assert found.vertices[:, 1].max() == pytest.approx(2 * 16384 / 32767)


def test_sparse_accessors_are_filled(tmp_path):
    def change(document, add):
        rows = add(np.array([2], np.uint16))
        new = add(np.array([[3, 3, 0]], np.float32))
        views = [document["accessors"][index]["bufferView"] for index in (rows, new)]
        indices = {"bufferView": views[0], "componentType": 5123}
        document["accessors"][0]["sparse"] = {"count": 1, "indices": indices, "values": {"bufferView": views[1]}}

    assert read_mesh(gltf(tmp_path / "m.gltf", change)).vertices.max() == 3


def texture_info(**info):
    def change(document, add):
        document["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"].update(info)
        second = add(np.array([[0.5, 1], [1, 1], [1, 0], [0.5, 0]], np.float32))
        document["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_1"] = second

    return change


def test_the_second_set_of_coordinates(tmp_path):
    found = read_textured(gltf(tmp_path / "m.gltf", texture_info(texCoord=1)))
    assert sorted(set(found.uv[..., 0].ravel().tolist())) == [0.5, 1]


def test_texture_transform_scales_turns_and_shifts(tmp_path):
    way = {"offset": [0.25, 0.5], "scale": [2, 3], "rotation": np.pi / 2}
    found = read_textured(gltf(tmp_path / "m.gltf", texture_info(extensions={"KHR_texture_transform": way})))
    plain = read_textured(gltf(tmp_path / "p.gltf")).uv
    wanted = np.stack([3 * plain[..., 1] + 0.25, -2 * plain[..., 0] + 0.5], axis=-1)  # counter-clockwise, v downward
    assert np.abs(found.uv - wanted).max() < 1e-6


@pytest.mark.parametrize("uv", [np.array([[0, 255], [255, 255], [255, 0], [0, 0]], np.uint8)])
def test_coordinates_as_bytes(tmp_path, uv):
    def change(document, add):
        document["accessors"][1]["normalized"] = True

    assert (
        read_textured(gltf(tmp_path / "m.gltf", change, uv=uv)).uv == read_textured(gltf(tmp_path / "p.gltf")).uv
    ).all()


def test_what_gltf_needs_and_is_not_there_is_named(tmp_path):
    def needs(name):
        return lambda document, add: document.update(extensionsRequired=[name])

    with pytest.raises(FormatError, match="needs EXT_meshopt_compression, which is not read"):
        read_mesh(gltf(tmp_path / "m.gltf", needs("EXT_meshopt_compression")))
    path = gltf(tmp_path / "m.gltf")
    (tmp_path / "t.png").unlink()
    assert len(read_mesh(path).faces) == 2
    with pytest.raises(MissingFileError, match=r"t.png: the texture that m.gltf names does not exist"):
        read_textured(path)
    (tmp_path / "data.bin").unlink()
    with pytest.raises(MissingFileError, match=r"data.bin: the buffer that m.gltf names does not exist"):
        read_mesh(path)


@pytest.mark.parametrize("how", ["../outside.bin", "..%2Foutside.bin", "absolute", "link"])
def test_buffers_lie_beside_the_mesh(tmp_path, how):
    (tmp_path / "mesh").mkdir()
    path, outside = gltf(tmp_path / "mesh/m.gltf"), tmp_path / "outside.bin"
    (tmp_path / "mesh/data.bin").rename(outside)
    if how == "link":
        (tmp_path / "mesh/data.bin").symlink_to(outside)
    else:
        name = str(outside) if how == "absolute" else how
        path.write_text(path.read_text().replace("data.bin", name))
    with pytest.raises(FormatError, match=r"m.gltf: '.*' leads out of .*; put what the mesh names beside it"):
        read_mesh(path)


def test_draco_is_decoded_or_named(tmp_path, monkeypatch):
    pytest.importorskip("DracoPy")
    box = trimesh.creation.box((1, 2, 3))
    path = tmp_path / "m.glb"
    path.write_bytes(trimesh.exchange.gltf.export_glb(trimesh.Scene(box), extension_draco=True))
    assert b"KHR_draco_mesh_compression" in path.read_bytes()
    assert area_and_volume(read_mesh(path))[1] == pytest.approx(6, rel=1e-3)
    monkeypatch.setattr(gltf_file.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(FormatError, match=r"compressed by Draco.*pip install 'ibrpipe\[draco\]'"):
        read_mesh(path)


# OBJ materials

SQUARE = "v -1 -1 0\nv 1 -1 0\nv 1 1 0\nv -1 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nusemtl m\nf 1/1 2/2 3/3 4/4\n"


def obj(folder, line, library="m.mtl", named=None):
    (folder / "tex").mkdir(exist_ok=True)
    for name in ("plain.png", "UPPER.PNG", "my wood.png", "tex/sub.png"):
        Image.fromarray(np.array([[[255, 0, 0], [0, 0, 255]]], np.uint8)).save(folder / name)
    (folder / library).write_text(f"newmtl m\nKd 1 1 1\n{line}\n")
    (folder / "m.obj").write_text(f"mtllib {named or library}\n{SQUARE}")
    return folder / "m.obj"


LINES = [
    "map_Kd plain.png",
    "map_Kd tex\\sub.png",
    "map_Kd C:\\work\\tex\\sub.png",
    "map_Kd upper.png",
    "map_Kd my wood.png",
    "map_Kd -s 1 1 1 -o 0 0 0 my wood.png",
    "map_Kd -clamp on -blendu off -bm 0.5 plain.png",
    "\tmap_Kd\tplain.png  ",
    'map_Kd "my wood.png"',
]


@pytest.mark.parametrize("line", LINES)
def test_maps_are_found_as_programs_name_them(tmp_path, line):
    found = read_textured(obj(tmp_path, line))
    assert found.color.tolist() == [[[1, 0, 0], [0, 0, 1]]]
    assert found.uv.max() == 1


def test_options_that_change_values_are_told_where_they_would(tmp_path, caplog):
    read_textured(obj(tmp_path, "map_Kd -mm 0.1 0.8 plain.png\nbump -bm 1 plain.png"))
    assert [record.getMessage() for record in caplog.records] == [
        f"{tmp_path / 'm.mtl'}: map_Kd plain.png: -mm 0.1 0.8 is not applied, values stay as they are: apply it to the "
        "picture"
    ]
    caplog.clear()
    read_textured(obj(tmp_path, "map_Kd -mm 0 1 plain.png\nbump -bm 0.5 plain.png"))
    assert ["-bm 0.5 is not applied" in record.getMessage() for record in caplog.records] == [True]


def test_names_of_material_files_may_have_blanks_and_other_case(tmp_path):
    assert read_textured(obj(tmp_path, LINES[0], "my mat.mtl")).color.shape == (1, 2, 3)
    assert read_textured(obj(tmp_path, LINES[0], "m.mtl", "M.MTL")).color.shape == (1, 2, 3)


def test_scale_and_offset_lay_the_texture(tmp_path):
    plain = read_textured(obj(tmp_path, "map_Kd plain.png")).uv
    found = read_textured(obj(tmp_path, "map_Kd -s 4 2 1 -o 0.5 0.25 plain.png")).uv
    assert (found[..., 0] == 4 * plain[..., 0] + 0.5).all()
    assert (1 - found[..., 1] == 2 * (1 - plain[..., 1]) + 0.25).all()


def test_missing_maps_and_material_files_are_told(tmp_path):
    with pytest.raises(
        MissingFileError, match=r"gone.png: the map that m.obj names does not exist \(map_Kd in m.mtl\)"
    ):
        read_textured(obj(tmp_path, "map_Kd -s 2 2 gone.png"))
    path = obj(tmp_path, LINES[0], named="gone.mtl")
    with pytest.raises(MissingFileError, match=r"gone.mtl: the material file that m.obj names does not exist"):
        read_textured(path)
    assert len(read_mesh(path).faces) == 2
    (tmp_path / "broken.png").write_text("no image")
    with pytest.raises(FormatError, match=r"broken.png: the texture that m.obj names is no image"):
        read_textured(obj(tmp_path, "map_Kd broken.png"))


def test_a_height_map_with_a_blank_in_its_name(tmp_path):
    Image.fromarray(np.full((2, 2), 128, np.uint8)).save(tmp_path / "my disp.png")
    relief = ibrpipe.read_relief_mesh(obj(tmp_path, "map_Kd plain.png\ndisp -mm 0 1 my disp.png"))
    assert relief.height[0, 0] == pytest.approx(128 / 255)


# units


def test_a_mesh_in_other_units_is_called_that(tiny_ball, tmp_path):
    root = shutil.copytree(tiny_ball, tmp_path / "capture")
    for factor, words in (
        (1000, "times larger than the ring of cameras, which are inside it"),
        (1e-3, "times smaller"),
    ):
        mesh = read_mesh(tiny_ball / "mesh.ply")
        trimesh.Trimesh(mesh.vertices * factor, mesh.faces, process=False).export(root / "mesh.ply")
        (tmp_path / "out").mkdir(exist_ok=True)
        with pytest.raises(CaptureError, match=f"{words}.*scale one of them"):
            run(Inputs(root, tmp_path / "out"), IngestConfig())


def test_rooms_and_objects_are_in_their_units():
    ring = np.array([[np.cos(a), np.sin(a), 0] for a in np.linspace(0, 6, 12)])
    assert other_units("m", 0.5, ring, (0.0, 0.4), 0.9, True) is None
    assert other_units("room", 40.0, ring, (0.0, 1.0), None, True) is None
    assert other_units("field", 200.0, ring, (0.0, 0.5), None, True).severity == "warning"


@pytest.mark.parametrize("backs", [0.0, 1.0])
def test_winding_alone_makes_no_mesh_wrong(backs):
    ring = np.array([[np.cos(a), np.sin(a), 0] for a in np.linspace(0, 6, 12)])
    assert other_units("terrain", 40.0, ring, (backs, 0.5), None, True) is None
    assert other_units("terrain", 200.0, ring, (backs, 0.5), None, True).severity == "warning"


def test_a_mesh_all_around_that_shows_its_backs_is_a_room_unless_masks_tell_otherwise():
    ring = np.array([[np.cos(a), np.sin(a), 0] for a in np.linspace(0, 6, 12)])
    room = other_units("room", 40.0, ring, (1.0, 1.0), None, True)
    assert (room.severity, "a room stays as it is, the plan turns its faces" in room.remedy) == ("warning", True)
    assert other_units("object", 40.0, ring, (1.0, 1.0), 0.3, True).severity == "error"
    assert other_units("millimetres", 2000.0, ring, (1.0, 1.0), None, True).severity == "error"


def test_what_is_all_around_is_told_from_what_lies_ahead_however_it_is_wound():
    ring = np.array([[np.cos(a), np.sin(a), 0] for a in np.linspace(0, 6, 12)])
    wall = np.array([(-60, -60, -3), (60, -60, -3), (60, 60, -3), (-60, 60, -3)], float)
    box = trimesh.creation.box((40, 40, 40))
    ahead, around = Mesh(wall, np.array([[0, 1, 2], [0, 2, 3]])), Mesh(box.vertices, box.faces)
    for mesh, least, most in ((ahead, 0.3, 0.5), (around, 1, 1)):
        for faces in (mesh.faces, mesh.faces[:, ::-1]):
            turned = Mesh(mesh.vertices, faces)
            assert least <= Surface(spread_points(turned, 500), MeshCaster(turned)).around(ring) <= most
