"""Mesh files with their colours, as the commands that sample meshes read them."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
import trimesh
from PIL import Image

from ibrpipe.core.color import srgb_decode
from ibrpipe.errors import FormatError, MissingFileError
from ibrpipe.io.surfaces.colored_meshes import read_colored
from ibrpipe.io.surfaces.meshes import write_mesh
from ibrpipe.types import Mesh

PLACES = np.array([[0, 0, 0], [2, 0, 0], [2, 2, 0], [0, 2, 0]], float)
FACES = np.array([[0, 1, 2], [0, 2, 3]])
UV = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], float)  # v upward, as in files


def obj(path, *head):
    lines = [*head, *("v {} {} {}".format(*place) for place in PLACES), *("vt {} {}".format(*each) for each in UV)]
    path.write_text("\n".join([*lines, "f 1/1 2/2 3/3", "f 1/1 3/3 4/4"]))
    return path


def test_a_material_brings_its_texture_and_colour(tmp_path):
    cv2.imwrite(str(tmp_path / "c.png"), np.uint8([[[0, 0, 255]], [[255, 0, 0]]]))  # red above, blue below
    (tmp_path / "m.mtl").write_text("newmtl m\nKd 1 1 1\nmap_Kd c.png\n")
    mesh, colors = read_colored(obj(tmp_path / "quad.obj", "mtllib m.mtl", "usemtl m"))
    np.testing.assert_allclose(colors.textures[0][:, 0], [[1, 0, 0], [0, 0, 1]], atol=1e-6)
    corners = mesh.vertices[mesh.faces].reshape(-1, 3), colors.uv.reshape(-1, 2)
    at = {tuple(place): tuple(uv) for place, uv in zip(*corners, strict=True)}
    assert at[(0, 2, 0)] == (0, 0)  # top left: v counts downward
    assert at[(2, 0, 0)] == (1, 1)


def test_a_file_without_colours_has_none_and_takes_an_image(tmp_path):
    bare = obj(tmp_path / "bare.obj")
    assert read_colored(bare)[1] is None
    cv2.imwrite(str(tmp_path / "c.png"), np.full((4, 4, 3), 128, np.uint8))
    colors = read_colored(bare, tmp_path / "c.png")[1]
    np.testing.assert_allclose(colors.textures[0], srgb_decode(np.float32(128 / 255)), atol=1e-6)
    with pytest.raises(MissingFileError, match=r"none\.png"):
        read_colored(bare, tmp_path / "none.png")
    write_mesh(Mesh(PLACES, FACES), tmp_path / "plain.ply")
    with pytest.raises(FormatError, match=r"plain\.ply: has no texture coordinates"):
        read_colored(tmp_path / "plain.ply", tmp_path / "c.png")


def test_colours_of_vertices_are_srgb_codes_or_linear_floats(tmp_path):
    codes = np.uint8([[255, 0, 0, 255], [0, 255, 0, 255], [0, 0, 255, 255], [128, 128, 128, 255]])
    trimesh.Trimesh(PLACES, FACES, vertex_colors=codes, process=False).export(tmp_path / "codes.ply")
    mesh, colors = read_colored(tmp_path / "codes.ply")
    grey = (mesh.vertices[mesh.faces] == PLACES[3]).all(-1)
    np.testing.assert_allclose(colors.corner[grey], srgb_decode(np.float32(128 / 255)), atol=1e-6)
    tints = {name: np.float32([0.1, 0.2, 0.3, 2.0]) for name in ("red", "green", "blue")}
    write_mesh(Mesh(PLACES, FACES), tmp_path / "floats.ply", tints)
    np.testing.assert_array_equal(read_colored(tmp_path / "floats.ply")[1].corner[1, 2], np.float32([2, 2, 2]))


def test_parts_of_a_scene_keep_their_own_textures(tmp_path):
    scene = trimesh.Scene()
    for shift, tint in ((0, (255, 0, 0)), (3, (0, 255, 0)), (6, None)):
        part = trimesh.Trimesh(PLACES + np.array([shift, 0, 0]), FACES, process=False)
        if tint:
            image = Image.fromarray(np.tile(np.uint8(tint), (2, 3, 1)))
            material = trimesh.visual.material.PBRMaterial(baseColorTexture=image)
            part.visual = trimesh.visual.TextureVisuals(uv=UV, material=material)
        scene.add_geometry(part)
    scene.export(tmp_path / "scene.glb")
    mesh, colors = read_colored(tmp_path / "scene.glb")
    assert len(colors.textures) == 2
    for shift, tint in ((0, (1, 0, 0)), (3, (0, 1, 0))):
        own = (mesh.vertices[mesh.faces][..., 0].min(axis=1) >= shift) & (
            mesh.vertices[mesh.faces][..., 0].max(axis=1) <= shift + 2
        )
        assert own.sum() == 2
        for index in colors.texture[own]:
            np.testing.assert_allclose(colors.textures[index][0, 0], tint, atol=1e-6)
    bare = mesh.vertices[mesh.faces][..., 0].min(axis=1) >= 6
    assert (colors.texture[bare] == -1).all()
    np.testing.assert_allclose(colors.corner[bare], 0.6, atol=1e-6)
