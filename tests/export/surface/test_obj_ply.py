"""OBJ and PLY: read by trimesh and by our own readers."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from page_assets import make_asset, paint

import ibrpipe
from ibrpipe.core.color import srgb_decode
from ibrpipe.io.surfaces.mesh_materials import read_textured
from ibrpipe.io.surfaces.meshes import read_mesh, write_mesh


def test_obj_has_its_material_and_picture_beside_it(tmp_path):
    told = ibrpipe.export(make_asset("matt"), tmp_path / "a b.obj", tolerance=1)
    assert sorted(each.name for each in tmp_path.iterdir()) == ["a b.obj", "a-b.mtl", "a-b.png"]
    found = read_textured(tmp_path / "a b.obj")
    assert told.startswith(f"{len(found.mesh.faces)} triangles")
    corners = found.mesh.vertices[found.mesh.faces]
    world = corners @ [(1, 0, 0), (0, 0, 1), (0, -1, 0)]  # y is up in the file, z in the world
    ball = (np.abs(np.linalg.norm(world, axis=2) - 1.0) < 0.01).all(axis=1)
    assert ball.sum() > 100
    column, row = np.floor(found.uv[ball] * found.color.shape[1::-1]).astype(int).reshape(-1, 2).T
    wanted = np.clip(paint(world[ball].reshape(-1, 3)), 0, 1)
    # corners of joined triangles lie up to the tolerance, one texel, aside: paint changes by 0.3 sqrt(17) / 16 at most
    assert np.median(np.abs(found.color[row, column] - wanted)) < 0.05
    part = trimesh.load_mesh(tmp_path / "a b.obj")
    assert len(part.faces) == len(found.mesh.faces)
    assert part.visual.material.image.size == found.color.shape[1::-1]


@pytest.mark.parametrize(("stem", "plain"), [("-o 壺 #1", "o-壺-1"), ("木", "木"), ("#", "surface")])
def test_objs_names_hold_any_script_and_nothing_that_ends_a_line_or_is_an_option(tmp_path, stem, plain):
    ibrpipe.export(make_asset("matt"), tmp_path / f"{stem}.obj", tolerance=8)
    assert sorted(each.name for each in tmp_path.iterdir()) == sorted([f"{stem}.obj", f"{plain}.mtl", f"{plain}.png"])
    found = read_textured(tmp_path / f"{stem}.obj")
    assert found.color.max() > 0.4
    assert trimesh.load_mesh(tmp_path / f"{stem}.obj").visual.material.image.size == found.color.shape[1::-1]


def test_ply_of_points_has_a_row_for_every_sample(tmp_path):
    asset = make_asset("matt")
    ibrpipe.export(asset, tmp_path / "x.ply", content="points")
    cloud = trimesh.load(tmp_path / "x.ply")
    assert len(cloud.vertices) == sum(len(each.layers.depth) for each in asset.textures)
    stored = cloud.metadata["_ply_raw"]["vertex"]["data"]
    assert (stored["observers"] == 1).all()
    assert "confidence" not in stored.dtype.names
    normals = np.stack([stored[name] for name in ("nx", "ny", "nz")], axis=1)
    ball = np.abs(np.linalg.norm(cloud.vertices, axis=1) - 1.0) < 1e-4
    np.testing.assert_allclose(normals[ball], cloud.vertices[ball], atol=5e-4)
    color = srgb_decode(np.asarray(cloud.colors)[ball, :3].astype(np.float32) / 255)
    np.testing.assert_allclose(color, np.clip(paint(np.asarray(cloud.vertices)[ball]), 0, 1), atol=0.01)


def test_ply_of_a_mesh_joins_samples_and_knows_the_runs_confidence(tmp_path):
    ibrpipe.write_asset(make_asset("perspective"), tmp_path / "run" / "asset")
    (tmp_path / "run" / "geometry").mkdir()
    mesh = ibrpipe.Mesh(np.array([(0, 0, 2), (0, 0, -2), (0.1, 0, -2)], float), np.array([(0, 1, 2)]))
    write_mesh(mesh, tmp_path / "run/geometry/mesh.ply", {"confidence": np.array([0.25, 0.75, 0.75], np.float32)})
    ibrpipe.export(tmp_path / "run", tmp_path / "x.ply")
    found = read_mesh(tmp_path / "x.ply")
    stored = trimesh.load(tmp_path / "x.ply", process=False).metadata["_ply_raw"]["vertex"]["data"]
    above, below = stored["z"] > 0.1, stored["z"] < -0.1
    assert above.any()
    assert below.any()
    assert set(stored["confidence"][above]) == {np.float32(0.25)}
    assert set(stored["confidence"][below]) == {np.float32(0.75)}
    assert (stored["observers"] > 0).all()
    a, b, c = (found.vertices[found.faces[:, k]] for k in range(3))
    normals = np.stack([stored[name] for name in ("nx", "ny", "nz")], axis=1)[found.faces[:, 0]]
    assert ((np.cross(b - a, c - a) * normals).sum(axis=1) > 0).mean() > 0.98


def test_a_ply_that_cannot_be_written_is_told(tmp_path):
    (tmp_path / "file").write_text("x")
    with pytest.raises(ibrpipe.IbrError, match="cannot write"):
        ibrpipe.export(make_asset("matt"), tmp_path / "file" / "x.ply")
