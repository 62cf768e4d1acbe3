"""Relief-mapped meshes from glTF, OBJ and files beside them, and packed relief textures."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
import trimesh
from PIL import Image

import ibrpipe
from ibrpipe.io.surfaces.materials import texture_size, write_packed
from ibrpipe.io.surfaces.uv_maps import map_mesh
from ibrpipe.types import Mesh

PLACES = np.array([[0, 0, 0], [2, 0, 0], [2, 2, 0], [0, 2, 0]], float)
FACES = np.array([[0, 1, 2], [0, 2, 3]])
UV = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], float)  # v upward, as in files


def normal_image(alpha=True):
    codes = np.zeros((4, 6, 4 if alpha else 3), np.uint8)
    codes[..., :3] = (128, 200, 230)
    if alpha:
        codes[..., 3] = np.arange(6) * 51
    return Image.fromarray(codes)


@pytest.fixture
def obj(tmp_path):
    Image.fromarray(np.tile(np.uint8([[[255, 0, 0]], [[0, 0, 255]]]), (1, 3, 1))).save(tmp_path / "color.png")
    normal_image().save(tmp_path / "normal.png")
    (tmp_path / "quad.mtl").write_text("newmtl m\nKd 1 1 1\nmap_Kd color.png\nnorm normal.png\n")
    lines = ["mtllib quad.mtl", "usemtl m"]
    lines += ["v {} {} {}".format(*place) for place in PLACES] + ["vt {} {}".format(*each) for each in UV]
    (tmp_path / "quad.obj").write_text("\n".join([*lines, "f 1/1 2/2 3/3", "f 1/1 3/3 4/4"]))
    return tmp_path / "quad.obj"


@pytest.fixture
def glb(tmp_path):
    mesh = trimesh.Trimesh(PLACES, FACES, process=False)
    color = Image.fromarray(np.tile(np.uint8([[[255, 0, 0]], [[0, 0, 255]]]), (1, 3, 1)))
    material = trimesh.visual.material.PBRMaterial(baseColorTexture=color, normalTexture=normal_image())
    mesh.visual = trimesh.visual.TextureVisuals(uv=UV, material=material)
    mesh.export(tmp_path / "quad.glb")
    return tmp_path / "quad.glb"


@pytest.mark.parametrize("kind", ["obj", "glb"])
def test_textures_of_the_material(kind, request):
    source = ibrpipe.read_relief_mesh(request.getfixturevalue(kind))
    np.testing.assert_allclose(source.height[0], np.arange(6) / 5, atol=1e-6)
    np.testing.assert_allclose(source.color[:, 0], [[1, 0, 0], [0, 0, 1]], atol=1e-6)
    assert source.normal[0, 0, 1] < -0.3  # green up in the file, v down here
    assert source.thickness == pytest.approx(0.1)
    corner = np.flatnonzero((source.mesh.vertices[source.mesh.faces] == PLACES[3]).all(-1).ravel())
    np.testing.assert_allclose(source.uv.reshape(-1, 2)[corner], [[0, 0]], atol=1e-6)  # top left of the picture
    view = ibrpipe.Camera.look_at((1, 1.01, 6), (1, 1, 0), up=(0, 1, 0), width=20, height=20)
    frame = ibrpipe.render(source, view, "relief", mapping="plain", anisotropy=0)
    seen = frame.color[frame.alpha[:, 10] > 0, 10]
    quarter = len(seen) // 4
    np.testing.assert_allclose(seen[[quarter, -1 - quarter]], [[1, 0, 0], [0, 0, 1]], atol=0.2)


def test_files_beside_the_mesh(obj, tmp_path):
    cv2.imwrite(str(tmp_path / "h.png"), np.full((5, 7), 32768, np.uint16))
    source = ibrpipe.read_relief_mesh(
        obj, height=tmp_path / "h.png", repeat=(3, 2), thickness=0.25, height_range=(0, 2), edges="cut"
    )
    np.testing.assert_allclose(source.height, np.full((5, 7), 0.25), atol=1e-5)
    assert (source.uv.max(axis=(0, 1)) == (3, 2)).all()
    assert (source.thickness, source.edges) == (0.25, "cut")
    np.save(tmp_path / "dem.npy", np.linspace(236.0, 1076.0, 12).reshape(3, 4))
    source = ibrpipe.read_relief_mesh(obj, height=tmp_path / "dem.npy", height_range=(236, 1076))
    assert (source.height.min(), source.height.max()) == (0.0, 1.0)


@pytest.mark.parametrize(
    ("heights", "text"),
    [([[0.5, np.nan]], "dem.npy: height holds nan"), ([[0.5, -0.1]], "height holds -0.1"), ([[1.0, 7.0]], "holds 7")],
)
def test_heights_that_leave_the_range_are_refused(obj, tmp_path, heights, text):
    np.save(tmp_path / "dem.npy", np.array(heights))
    with pytest.raises(ibrpipe.IbrError, match=text):
        ibrpipe.read_relief_mesh(obj, height=tmp_path / "dem.npy")


def test_wrong_files_are_told(obj, tmp_path):
    normal_image(alpha=False).save(tmp_path / "normal.png")
    with pytest.raises(ibrpipe.IbrError, match="brings no heights"):
        ibrpipe.read_relief_mesh(obj)
    with pytest.raises(ibrpipe.IbrError, match="four channels"):
        ibrpipe.read_relief_mesh(obj, packed=tmp_path / "normal.png")
    (tmp_path / "normal.png").unlink()
    with pytest.raises(ibrpipe.IbrError, match="does not exist"):
        ibrpipe.read_relief_mesh(obj)
    with pytest.raises(ibrpipe.IbrError, match="unknown kind"):
        ibrpipe.read_relief_mesh(tmp_path / "mesh.blend")
    np.save(tmp_path / "h.npy", np.zeros((2, 2)))
    normal_image().save(tmp_path / "normal.png")
    with pytest.raises(ibrpipe.IbrError, match="height_range"):
        ibrpipe.read_relief_mesh(obj, height=tmp_path / "h.npy", height_range=(1, 1))


def test_packed_relief_comes_back(obj, tmp_path):
    rng = np.random.default_rng(5)
    normal = rng.normal(size=(6, 5, 3)) * (0.3, 0.3, 0) + (0, 0, 1)
    normal = (normal / np.linalg.norm(normal, axis=-1, keepdims=True)).astype(np.float32)
    height = (0.5 + 0.5 * rng.random((6, 5))).astype(np.float32)
    source = ibrpipe.ReliefMesh(Mesh(PLACES, FACES), np.zeros((2, 3, 2)), height, 1.0, height - 0.25, normal=normal)
    for bits, room in ((16, 2e-5), (8, 5e-3)):
        write_packed(source, tmp_path / "packed.png", bits)
        again = ibrpipe.read_relief_mesh(obj, packed=tmp_path / "packed.png")
        np.testing.assert_allclose(again.height, source.height, atol=room)
        np.testing.assert_allclose(again.back, source.back, atol=room)
        np.testing.assert_allclose(again.normal, source.normal, atol=3 * room)


@pytest.mark.parametrize("projection", ["cylinder", "sphere", "planar", "box"])
def test_made_texture_coordinates(projection):
    ball = trimesh.creation.icosphere(3)
    mesh = Mesh(ball.vertices, ball.faces)
    uv = map_mesh(mesh, projection)
    assert np.isfinite(uv).all()
    spread = np.ptp(uv, axis=1)
    assert (spread < 0.6).all()  # no face spans the seam
    assert 0.4 < texture_size(mesh, uv) < 9
    shift = uv - np.round(uv)
    place = mesh.vertices[mesh.faces]
    if projection in ("cylinder", "sphere"):  # faces agree on u at shared vertices, but for whole textures
        away = np.hypot(place[..., 0], place[..., 2]) > 1e-3
        turns = np.arctan2(place[..., 0], place[..., 2]) / (2 * np.pi)
        gap = shift[..., 0] - turns
        assert np.abs(gap - np.round(gap))[away].max() < 1e-9
    with pytest.raises(ibrpipe.IbrError, match="choose among"):
        map_mesh(mesh, "fish")


def two_materials(tmp_path, second="map_Bump bumps.png"):
    """Two squares side by side, the first red with heights, the second blue."""
    Image.fromarray(np.full((2, 2, 3), (255, 0, 0), np.uint8)).save(tmp_path / "red.png")
    Image.fromarray(np.tile(np.arange(0, 240, 40, dtype=np.uint8), (4, 1))).save(tmp_path / "bumps.png")
    normal_image(alpha=False).save(tmp_path / "normal.png")
    (tmp_path / "two.mtl").write_text(
        f"newmtl a\nKd 1 1 1\nmap_Kd red.png\ndisp bumps.png\nnewmtl b\nKd 0 0 1\n{second}\n"
    )
    lines = ["mtllib two.mtl", *("vt {} {}".format(*each) for each in UV)]
    for x in (0, 3):
        lines += ["v {} {} {}".format(*place) for place in PLACES + np.array([x, 0, 0])]
    lines += ["usemtl a", "f 1/1 2/2 3/3", "f 1/1 3/3 4/4", "usemtl b", "f 5/1 6/2 7/3", "f 5/1 7/3 8/4"]
    (tmp_path / "two.obj").write_text("\n".join(lines))
    return tmp_path / "two.obj"


def test_several_materials_become_several_sources(tmp_path):
    path = two_materials(tmp_path)
    one, other = ibrpipe.read_relief_meshes(path, thickness=0.3)
    np.testing.assert_allclose(one.height[0], np.arange(0, 240, 40) / 255, atol=1e-6)
    np.testing.assert_allclose(other.height, one.height)
    assert (one.mesh.vertices[:, 0].max(), other.mesh.vertices[:, 0].min()) == (2, 3)
    view = ibrpipe.Camera.look_at((2.5, 1.01, 9), (2.5, 1, 0), up=(0, 1, 0), width=40, height=20)
    frame = ibrpipe.render([one, other], view, "relief")
    np.testing.assert_allclose(frame.color[10, 12], [1, 0, 0], atol=1e-3)
    np.testing.assert_allclose(frame.color[10, 27], [0, 0, 1], atol=1e-3)
    with pytest.raises(ibrpipe.IbrError, match="2 textured materials; read it with read_relief_meshes"):
        ibrpipe.read_relief_mesh(path)


def test_materials_without_heights_are_flat_and_coloured_bumps_are_normals(tmp_path):
    one, other = ibrpipe.read_relief_meshes(two_materials(tmp_path, "map_Bump normal.png"), height_range=(0, 2))
    assert one.height.max() < 0.5
    assert (other.height == 1.0).all()
    assert other.normal[0, 0, 1] < -0.3
    plain = ibrpipe.read_relief_meshes(two_materials(tmp_path, ""))[1]
    assert (plain.height == 1.0).all()
    np.testing.assert_allclose(plain.color, [[[0, 0, 1]]])
    (tmp_path / "bumps.png").unlink()
    with pytest.raises(ibrpipe.IbrError, match=r"bumps.png: the map that two.obj names does not exist"):
        ibrpipe.read_relief_meshes(tmp_path / "two.obj")


@pytest.mark.parametrize("kind", ["glb", "gltf"])
def test_tangents_of_the_file(kind, tmp_path):
    mesh = trimesh.Trimesh(PLACES, FACES, process=False)
    material = trimesh.visual.material.PBRMaterial(normalTexture=normal_image())
    mesh.visual = trimesh.visual.TextureVisuals(uv=UV, material=material)
    mesh.vertex_attributes["_TANGEN"] = np.tile(np.float32([0.6, 0.8, 0, 1]), (4, 1))
    turn = np.array([[0, -1, 0, 5], [1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]], float)
    scene = trimesh.Scene()
    scene.add_geometry(mesh, transform=turn)
    if kind == "glb":
        (tmp_path / "quad.glb").write_bytes(scene.export(file_type="glb").replace(b'"_TANGEN"', b'"TANGENT"'))
    else:
        for name, content in trimesh.exchange.gltf.export_gltf(scene).items():
            (tmp_path / name.replace("model", "quad")).write_bytes(content.replace(b'"_TANGEN"', b'"TANGENT"'))
    source = ibrpipe.read_relief_mesh(tmp_path / f"quad.{kind}")
    np.testing.assert_allclose(source.tangents, np.broadcast_to([-0.8, 0.6, 0], (2, 3, 3)), atol=1e-6)
    assert source.mesh.vertices[:, 0].max() == 5
    assert ibrpipe.read_relief_mesh(tmp_path / f"quad.{kind}", uv="planar").tangents is None
    view = ibrpipe.Camera.look_at((4, 1, 4), (4, 1, 0), up=(0, 1, 0), width=20, height=20)
    assert np.isfinite(ibrpipe.render(source, view, "relief").depth).any()
