"""Sides of surfaces: leaves have two, closed bodies one, whatever the winding; files; what the plan tells."""

from __future__ import annotations

import json

import numpy as np
import pytest

from ibrpipe.capture.photo_set import PhotoSet, load_photos
from ibrpipe.embree import MeshCaster
from ibrpipe.errors import FormatError, MissingFileError
from ibrpipe.io.surfaces.meshes import write_mesh
from ibrpipe.modelling.sides import Sides, caster_of, find_sides, read_sides, write_sides
from ibrpipe.stages import layers as layers_stage
from ibrpipe.stages import plan as plan_stage
from ibrpipe.synthetic.scene import joined_mesh
from ibrpipe.synthetic.scenes import make_scene
from ibrpipe.synthetic.surfaces import ball, lobed_ball, wound
from ibrpipe.types import Camera, Mesh

WINDINGS = ("consistent", "inverted", "mixed")


def remade(mesh, winding):
    return wound(mesh, winding, np.random.default_rng(3))


@pytest.fixture(scope="module")
def plant(measured):
    """The foliage's mesh and photos, and (F,) which of its faces are leaves."""
    found = measured("foliage")
    scene = make_scene("foliage", 0.35)
    _, owner = joined_mesh(scene.parts)
    leaf = np.array([part.back is not None for part in scene.parts])[owner]
    return found.caster.mesh, found.photos, leaf


@pytest.mark.parametrize("winding", WINDINGS)
def test_leaves_have_two_sides_and_closed_bodies_one(plant, winding):
    mesh, photos, leaf = plant
    sides, told = find_sides(remade(mesh, winding), photos)
    assert not sides.both[~leaf].any()
    assert sides.both[leaf].mean() > 0.9  # some are hardly seen from one side in so few small photos
    assert not sides.again.any()
    turned = remade(mesh, winding)
    outward = np.where(sides.turned[:, None], turned.faces[:, ::-1], turned.faces)
    np.testing.assert_array_equal(outward[~leaf], mesh.faces[~leaf])
    assert told["measured"]["pieces"] == 44
    assert told["measured"]["closed_pieces"] == 8
    assert 32 <= told["measured"]["pieces_with_both_sides"] <= 36
    assert 0.3 < told["measured"]["both_sides_share"] < 0.5
    assert told["choice"] == "both"


def test_all_windings_give_one_surface(plant):
    mesh, photos, _ = plant
    meshes = [find_sides(remade(mesh, winding), photos)[0].caster(remade(mesh, winding)).mesh for winding in WINDINGS]
    for other in meshes[1:]:
        np.testing.assert_array_equal(other.faces, meshes[0].faces)


@pytest.mark.parametrize("scene", ["ball", "glossy", "lambert"])
def test_other_scenes_have_no_second_side(measured, scene):
    found = measured(scene)
    sides, told = find_sides(found.caster.mesh, found.photos)
    assert sides.plain
    assert told["choice"] == "one"
    assert told["measured"]["pieces_with_both_sides"] == 0


def test_the_user_may_decide(plant):
    mesh, photos, leaf = plant
    np.testing.assert_array_equal(find_sides(mesh, photos, "always")[0].both, leaf)
    assert not find_sides(mesh, photos, "never")[0].both.any()


def test_faces_given_twice_count_once(plant):
    mesh, photos, leaf = plant
    doubled = Mesh(mesh.vertices, np.concatenate([mesh.faces, mesh.faces[leaf][:, ::-1]]))
    sides, told = find_sides(doubled, photos)
    assert sides.again.sum() == leaf.sum() == told["measured"]["faces_left_out"]
    single = find_sides(mesh, photos)[0]
    np.testing.assert_array_equal(sides.caster(doubled).mesh.faces, single.caster(mesh).mesh.faces)


def test_rays_meet_the_side_that_they_come_from():
    square = Mesh(np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], float), np.array([[0, 1, 2], [0, 2, 3]]))
    caster = MeshCaster(square, two_sided=np.array([True, False]))
    assert caster.fronts == 2
    assert len(caster.mesh.faces) == 3
    origins = np.array([[0.6, 0.2, 1.0], [0.6, 0.2, -1.0], [0.2, 0.6, -1.0]])
    hits = caster.cast(origins, np.array([[0, 0, -1.0], [0, 0, 1.0], [0, 0, 1.0]]))
    np.testing.assert_array_equal(hits.face, [0, 2, 1])
    np.testing.assert_allclose(hits.normal, [[0, 0, 1], [0, 0, -1], [0, 0, 1]])  # a single side is met from behind
    corner = square.vertices[caster.mesh.faces[hits.face]]
    weights = np.column_stack([1 - hits.uv.sum(axis=1), hits.uv])
    np.testing.assert_allclose(
        np.einsum("nc,ncd->nd", weights, corner), [[0.6, 0.2, 0]] * 2 + [[0.2, 0.6, 0]], atol=1e-6
    )
    np.testing.assert_allclose(caster.smooth_normals(hits.face, hits.uv), hits.normal, atol=1e-6)
    ray, all_hits = caster.cast_all(origins[:2], np.array([[0, 0, -1.0], [0, 0, 1.0]]))
    np.testing.assert_array_equal(ray, [0, 1])
    np.testing.assert_array_equal(all_hits.face, [0, 2])


def test_sides_survive_their_file(tmp_path):
    bits = np.random.default_rng(0).random((3, 21)) < 0.5
    write_sides(Sides(*bits), tmp_path / "sides.npz")
    first = (tmp_path / "sides.npz").read_bytes()
    found = read_sides(tmp_path / "sides.npz")
    np.testing.assert_array_equal([found.turned, found.both, found.again], bits)
    write_sides(found, tmp_path / "sides.npz")
    assert (tmp_path / "sides.npz").read_bytes() == first


def test_bad_files_and_other_meshes_end_in_one_line(tmp_path, plant):
    mesh, _, _ = plant
    with pytest.raises(MissingFileError, match="run the plan stage again"):
        read_sides(tmp_path / "none.npz")
    (tmp_path / "bad.npz").write_bytes(b"PK\3\4nothing")
    with pytest.raises(FormatError, match="not the sides of a mesh"):
        read_sides(tmp_path / "bad.npz")
    write_sides(Sides(*np.zeros((3, 5), bool)), tmp_path / "other.npz")
    with pytest.raises(FormatError, match=f"5 faces but the mesh has {len(mesh.faces)}"):
        caster_of(mesh, tmp_path / "other.npz")


def test_stages_agree_on_sides(measured, tmp_path):
    """Plan and layers of the mesh as it is and wound by chance: the same numbers, and both sides in the layers."""
    found, figures = measured("foliage"), []
    for winding in ("consistent", "mixed"):
        out = tmp_path / winding
        (out / "plan").mkdir(parents=True)
        (out / "layers").mkdir()
        write_mesh(remade(found.caster.mesh, winding), out / "mesh.ply")
        config = plan_stage.PlanConfig(residuals="never", reflection="never", samples=4000)
        planned = plan_stage.run(
            plan_stage.Inputs(found.folder / "views.json", out / "mesh.ply", 0, out / "plan"), config
        )
        told = json.loads(planned.plan.read_text())["reasons"][0]
        assert told["what"] == "sides of the surface"
        assert told["measured"]["pieces_with_both_sides"] >= 32
        assert (out / "plan" / "summary.txt").read_text().startswith("sides of the surface: photos see")
        inputs = layers_stage.Inputs(
            found.folder / "views.json", out / "mesh.ply", planned.plan, out / "layers", planned.sides
        )
        layers_stage.run(inputs, layers_stage.LayersConfig(sharpen=0))
        figures.append(json.loads((out / "layers" / "layers.json").read_text()))
    assert figures[0] == figures[1]


def test_photos_load_with_a_caster_of_sides(plant, measured):
    """Depth maps do not hang on sides."""
    from ibrpipe.io.views import read_views

    mesh, photos, leaf = plant
    views = read_views(measured("foliage").folder / "views.json").train[:2]
    both = load_photos(views, MeshCaster(mesh, two_sided=leaf))
    np.testing.assert_array_equal(both.depth, photos.depth[: len(both.depth)])


def photos_from(directions, mesh, size=48):
    """Photos of nothing in particular, without masks, from directions around a mesh about the origin."""
    cameras = tuple(Camera.look_at(4 * np.array(d, float), (0, 0, 0), (0, 0.1, 1), 40, size, size) for d in directions)
    count, caster = size * size, MeshCaster(mesh)
    return PhotoSet(
        cameras, np.stack([c.pixel_from_world for c in cameras]), np.stack([c.center for c in cameras]),
        np.full((len(cameras), 2), size, np.int32), np.arange(len(cameras) + 1) * count,
        np.zeros((count * len(cameras), 3), np.float32),
        np.concatenate([caster.cast_camera(camera).t.ravel() for camera in cameras]),
        np.ones(count * len(cameras), np.float32),
    )  # fmt: skip


ABOVE, BELOW = [(1, 0, 1.5), (-1, 0.5, 1.5), (0, -1, 2)], [(1, 0, -1.2), (-1, 0.5, -1), (0.2, -1, -1)]


@pytest.mark.parametrize("winding", WINDINGS)
def test_open_shells_have_the_sides_that_photos_see(winding):
    """A bowl without a wall's thickness, open above, as a reconstruction may leave it."""
    whole = ball(lobed_ball(1.0, 1, 0.0, 1.0), 24, 16).mesh
    lower = whole.vertices[whole.faces].mean(axis=1)[:, 2] < 0
    bowl = remade(Mesh(whole.vertices, whole.faces[lower]), winding)
    sides, told = find_sides(bowl, photos_from(ABOVE + BELOW, bowl))
    assert sides.both.all()
    assert told["measured"]["both_sides_share"] == 1.0
    sides, _ = find_sides(bowl, photos_from([(0.3, -0.1, -1), (-0.2, 0.2, -1)], bowl))
    assert not sides.both.any()
    faces = np.where(sides.turned[:, None], bowl.faces[:, ::-1], bowl.faces)
    np.testing.assert_array_equal(faces, whole.faces[lower])
    sides, _ = find_sides(bowl, photos_from([(0.1, 0, 1)], bowl))
    assert not sides.both.any()
    faces = np.where(sides.turned[:, None], bowl.faces[:, ::-1], bowl.faces)
    np.testing.assert_array_equal(faces, whole.faces[lower][:, ::-1])
