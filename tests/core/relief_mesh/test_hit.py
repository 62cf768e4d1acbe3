"""Where rays meet the relief below polygons, and below all prisms of a shell: kernels against brute force."""

from __future__ import annotations

import numpy as np
import pytest
import relief_mesh_twin as twin
from kernel_runs import on_all_thread_counts
from relief_mesh_scene import QUAD, QUAD_UV, bent_sheet, buffers, camera, parts, rough

from ibrpipe import ReliefMesh
from ibrpipe.core.relief_mesh.hit import hit_faces
from ibrpipe.core.relief_mesh.raster import bound_faces, draw_faces
from ibrpipe.core.relief_mesh.shell import hit_shell
from ibrpipe.core.relief_mesh.tree import fit_boxes


def below_faces(source, view, keep=True, **options):
    """(depth, mine, places, turns) of the nearest sheet of polygons, and the polygons seen."""
    part, local, rule = parts(source, view, **options)
    bounds, face = np.empty((len(part.corners), 4), np.int32), np.empty((view.height, view.width), np.int32)
    layer, after, found = np.empty(face.shape), np.zeros(face.shape), buffers(view)
    bound_faces(local, part.corners, view.K @ view.R, False, view.width, view.height, bounds)
    draw_faces(local, part.corners, bounds, view.world_from_pixel, after, found[0], layer, face)
    mesh = local, part.corners, source.uv, part.frames(local)
    kept = found if keep else (*found[:2], np.empty((0, 0, 3)), np.empty((0, 0, 9), np.float32))
    hit_faces(mesh, part.layers, rule, view.world_from_pixel, layer, face, *kept)
    return *found, face


def below_shell(source, view, depth=np.inf, **options):
    part, local, rule = parts(source, view, model="shell", **options)
    normals, found = np.empty((len(local), 3)), buffers(view)
    found[0][:] = depth
    normals[part.corners] = part.frames(local, smooth=True)[:, :, :3]
    boxes = fit_boxes(local, normals, part.corners, source.thickness, part.order)
    shell = local, normals, part.corners, source.uv, part.walls
    hit_shell(shell, part.layers, rule, view.world_from_pixel, part.order, boxes, *found)
    return found


SCENES = {
    "cut": ReliefMesh(QUAD, QUAD_UV, rough((7, 5)), 0.4, edges="cut"),
    "tiled": ReliefMesh(QUAD, QUAD_UV * 2.5, rough((6, 6)), 0.4),
    "bent": ReliefMesh(*bent_sheet(), rough((5, 6)), 0.1),
    "two layers": ReliefMesh(QUAD, QUAD_UV, 0.5 + 0.5 * rough((6, 6)), 0.6, back=0.5 * rough((6, 6), 4), edges="cut"),
}


@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize("search", ["exact", "linear-binary"])
def test_hits_below_polygons_equal_brute_force(name, search):
    source, view = SCENES[name], camera()
    options = {"search": search, "linear_steps": 24, "binary_steps": 6, "least_steps": 8}
    depth, mine, places, turns, face = on_all_thread_counts(lambda: below_faces(source, view, **options))
    wanted, texture = twin.cast(source, view, search, 24, 6, 8)
    single = np.isfinite(wanted) == (mine > 0)  # what a second sheet shows is not this kernel's
    same = np.isclose(depth, wanted, rtol=1e-6)
    assert (same & single).mean() > 0.98
    assert 25 < (mine > 0).sum() < mine.size
    assert (np.isinf(depth) == (mine == 0)).all()
    assert np.isnan(places[face < 0]).all()
    hit = (mine > 0) & same
    shift = 0.5 if source.edges == "cut" else -0.5
    scale = np.array([source.height.shape[1], source.height.shape[0], 1.0])
    np.testing.assert_allclose(places[hit], texture[hit] * scale + (shift, shift, 0), atol=1e-4)
    axes = twin.corner_axes(source)
    for y, x in np.argwhere(hit)[::7]:
        direction = view.world_from_pixel @ (x + 0.5, y + 0.5, 1.0)
        corners = source.mesh.vertices[source.mesh.faces[face[y, x]]] - view.center
        weights = np.linalg.solve(corners.T, direction)
        frame = twin.frame_at(source, axes, face[y, x], weights / weights.sum(), direction)
        np.testing.assert_allclose(turns[y, x].reshape(3, 3) @ frame, np.eye(3), atol=1e-5)


@pytest.mark.parametrize("mapping", ["plain", "bump"])
def test_plain_and_bump_mapping_hit_the_polygons_themselves(mapping):
    source, view = SCENES["bent"], camera()
    depth, mine, places, _, face = below_faces(source, view, mapping=mapping)
    local = source.mesh.vertices - view.center
    assert (mine > 0).sum() > 30
    for y, x in np.argwhere(mine > 0):
        direction = view.world_from_pixel @ (x + 0.5, y + 0.5, 1.0)
        share = np.linalg.solve(local[source.mesh.faces[face[y, x]]].T, direction)
        assert depth[y, x] == pytest.approx(1 / share.sum(), rel=1e-6)
        uv = share @ source.uv[face[y, x]] / share.sum()
        np.testing.assert_allclose(places[y, x], (*(uv * (6, 5) - 0.5), 0), atol=1e-9)


def test_parallax_mapping_shifts_by_the_depth_where_the_ray_enters():
    source, view = SCENES["tiled"], camera()
    flat, shifted = (below_faces(source, view, mapping=name) for name in ("bump", "parallax"))
    np.testing.assert_array_equal(flat[0], shifted[0])  # as published: depth stays the polygon's
    layers, hit = twin.Layers(source), np.argwhere(flat[1] > 0)
    for y, x in hit:
        frame = np.linalg.inv(flat[3][y, x].reshape(3, 3).astype(float))
        way = np.linalg.solve(frame, view.world_from_pixel @ (x + 0.5, y + 0.5, 1.0))
        start = flat[2][y, x, :2]
        deep = twin.bilinear(layers.front, *start, True)
        np.testing.assert_allclose(shifted[2][y, x, :2] - start, deep * way[:2] / way[2] * 6, atol=1e-4)
    assert len(hit) > 50


def test_places_are_kept_only_where_asked_for_and_nearer_depths_stay():
    source, view = SCENES["cut"], camera()
    full, bare = below_faces(source, view), below_faces(source, view, keep=False)
    np.testing.assert_array_equal(full[0], bare[0])
    np.testing.assert_array_equal(full[1], bare[1])
    assert np.isnan(bare[2]).all()
    part, local, rule = parts(source, view)
    mesh = local, part.corners, source.uv, part.frames(local)
    found = buffers(view)
    found[0][:] = 0.1
    hit_faces(mesh, part.layers, rule, view.world_from_pixel, np.full(full[4].shape, 1.0), full[4], *found)
    assert (found[0] == np.float32(0.1)).all()
    assert not found[1].any()


@pytest.mark.parametrize("name", ["cut", "tiled", "bent"])
@pytest.mark.parametrize("eye", [(0.8, -1.5, 1.1), (0.3, 0.2, 2.0), (0.0, -3.0, 0.3)])
def test_hits_in_a_shell_equal_brute_force_over_its_tetrahedra(name, eye):
    source, view = SCENES[name], camera(eye)
    depth, mine, places, turns = on_all_thread_counts(lambda: below_shell(source, view))
    wanted = twin.cast_shell(source, view)
    assert np.isclose(depth, wanted, rtol=1e-6).mean() > 0.98
    assert (mine > 0).sum() > 10
    np.testing.assert_array_equal(mine > 0, np.isfinite(depth))
    np.testing.assert_array_equal(mine > 0, np.isfinite(turns).all(axis=2))
    assert ((places[mine > 0, 2] > -1e-6) & (places[mine > 0, 2] < 1 + 1e-6)).all()


def test_a_shell_behind_what_is_drawn_leaves_it_alone():
    source, view = SCENES["tiled"], camera()
    depth, mine, places, _ = below_shell(source, view, depth=0.05)
    assert (depth == np.float32(0.05)).all()
    assert not mine.any()
    assert np.isnan(places).all()
