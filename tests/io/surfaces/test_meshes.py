import numpy as np
import pytest
import trimesh

from ibrpipe.errors import FormatError, MissingFileError
from ibrpipe.io.surfaces.meshes import read_mesh, write_mesh
from ibrpipe.types import Mesh

HEADER = (
    "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
    "element face {}\nproperty list uchar int vertex_indices\nend_header\n"
)
CORNERS = "0 0 0\n1 0 0\n0 1 0\n"


def signed_volume(mesh):
    a, b, c = (mesh.vertices[mesh.faces[:, i]] for i in range(3))
    return float((np.cross(a, b) * c).sum() / 6)


@pytest.mark.parametrize("suffix", ["ply", "obj", "glb", "stl"])
def test_a_box_keeps_its_volume_in_every_format(tmp_path, suffix):
    trimesh.creation.box((1.0, 2.0, 3.0)).export(tmp_path / f"box.{suffix}")
    mesh = read_mesh(tmp_path / f"box.{suffix}")
    assert len(mesh.faces) == 12
    assert signed_volume(mesh) == pytest.approx(6.0, rel=1e-6)


def test_glb_scene_joins_its_parts_where_the_nodes_put_them(tmp_path):
    scene = trimesh.Scene()
    scene.add_geometry(trimesh.creation.box((1, 1, 1)))
    scene.add_geometry(
        trimesh.creation.box((1, 1, 1)), transform=trimesh.transformations.translation_matrix((5.0, 0.0, 0.0))
    )
    scene.export(tmp_path / "two.glb")
    mesh = read_mesh(tmp_path / "two.glb")
    assert len(mesh.faces) == 24
    assert mesh.vertices[:, 0].max() == pytest.approx(5.5)
    assert signed_volume(mesh) == pytest.approx(2.0, rel=1e-6)


def test_written_ply_loses_nothing(tmp_path):
    rng = np.random.default_rng(1)
    mesh = Mesh(rng.normal(size=(50, 3)) + 1e6, rng.integers(0, 50, (70, 3)))
    write_mesh(mesh, tmp_path / "ü.ply")
    back = read_mesh(tmp_path / "ü.ply")
    assert (back.vertices == mesh.vertices).all()
    assert (back.faces == mesh.faces).all()


def test_open3d_reads_what_is_written(tmp_path):
    from ibrpipe.native_imports import import_open3d

    mesh = Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0.25]], [[0, 1, 2]])
    write_mesh(mesh, tmp_path / "a.ply")
    other = import_open3d().io.read_triangle_mesh(str(tmp_path / "a.ply"))
    assert np.asarray(other.vertices).tolist() == mesh.vertices.tolist()
    assert np.asarray(other.triangles).tolist() == mesh.faces.tolist()


def test_polygons_are_cut_into_triangles(tmp_path):
    (tmp_path / "quad.obj").write_text("v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\n")
    mesh = read_mesh(tmp_path / "quad.obj")
    normals = np.cross(
        mesh.vertices[mesh.faces[:, 1]] - mesh.vertices[mesh.faces[:, 0]],
        mesh.vertices[mesh.faces[:, 2]] - mesh.vertices[mesh.faces[:, 0]],
    )
    assert normals[:, 2].sum() == pytest.approx(2.0)
    assert (normals[:, 2] > 0).all()


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("points.ply", HEADER.format(0) + CORNERS, "no triangles"),
        ("range.ply", HEADER.format(1) + CORNERS + "3 0 1 7\n", "vertex 7 of 3"),
        ("negative.ply", HEADER.format(1) + CORNERS + "3 0 1 -1\n", "damaged"),
        ("nan.ply", HEADER.format(1) + CORNERS.replace("1 0 0", "nan 0 0") + "3 0 1 2\n", "NaN or infinite"),
        ("empty.ply", "", "damaged"),
        ("words.ply", "hello", "damaged"),
        ("index.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n", "damaged"),
        ("empty.obj", "", "no triangles"),
        ("words.stl", "hello", "no triangles"),
        ("words.glb", "hello", "damaged"),
        ("mesh.fbx", "hello", "unknown kind of mesh file; expected .ply"),
    ],
)
def test_broken_meshes_are_told(tmp_path, name, content, words):
    (tmp_path / name).write_text(content)
    with pytest.raises(FormatError, match=words) as caught:
        read_mesh(tmp_path / name)
    assert name in str(caught.value)
    assert "\n" not in str(caught.value)


def test_truncated_binary_ply_is_told(tmp_path):
    write_mesh(Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]] * 50), tmp_path / "a.ply")
    data = (tmp_path / "a.ply").read_bytes()
    (tmp_path / "a.ply").write_bytes(data[:-40])
    with pytest.raises(FormatError, match="damaged"):
        read_mesh(tmp_path / "a.ply")


def test_missing_mesh_is_told(tmp_path):
    with pytest.raises(MissingFileError, match="does not exist"):
        read_mesh(tmp_path / "a.ply")
