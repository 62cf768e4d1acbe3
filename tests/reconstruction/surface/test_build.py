"""From depth maps with noise of known size to a surface: its error is near the noise, and it says how sure it is."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ibrpipe.embree import MeshCaster
from ibrpipe.errors import CaptureError
from ibrpipe.evaluation.surface_error import compare_surfaces
from ibrpipe.io.dense import DepthMap, Workspace, write_map
from ibrpipe.io.surfaces.meshes import read_mesh
from ibrpipe.io.views import View, read_views
from ibrpipe.reconstruction.depth.fusion import Cloud, FusionRules, fuse
from ibrpipe.reconstruction.depth.map_store import load_map, slope_normals
from ibrpipe.reconstruction.surface.build import build_surface
from ibrpipe.reconstruction.surface.hull_completion import behind
from ibrpipe.reconstruction.surface.mask_consistency import contradicting, without_contradicted
from ibrpipe.reconstruction.surface.mesh_operations import (
    large_patches,
    openings,
    parts,
    simplified,
    whole_parts,
    without_vertices,
)
from ibrpipe.reconstruction.surface.poisson import POINT_BYTES, poisson_surface, thinned
from ibrpipe.reconstruction.surface.settings import SurfaceConfig
from ibrpipe.reconstruction.surface.silhouettes import load_outlines
from ibrpipe.reconstruction.surface.visual_hull import hull_surface
from ibrpipe.types import Mesh

#: standard deviation of the depth maps, as a share of the ball's diagonal
NOISE = 0.004


@pytest.fixture(scope="module")
def ball(measured) -> tuple[tuple[View, ...], Mesh, MeshCaster]:
    """Views, true mesh and its caster of the ball."""
    found = measured("ball")
    return read_views(found.folder / "views.json").train, found.caster.mesh, found.caster


@pytest.fixture(scope="module")
def noisy(ball, tmp_path_factory: pytest.TempPathFactory) -> list[DepthMap]:
    """Depth maps of the ball with noise, outliers and holes, without normals."""
    views, mesh, caster = ball
    draw, workspace = np.random.default_rng(0), Workspace(tmp_path_factory.mktemp("dense"))
    workspace.lay_out()
    diagonal, maps = np.linalg.norm(np.ptp(mesh.vertices, axis=0)), []
    for view in views:
        hits = caster.cast_camera(view.camera)
        depth = np.where(np.isfinite(hits.t), hits.t + NOISE * diagonal * draw.normal(size=hits.t.shape), 0)
        depth = np.where(draw.random(depth.shape) < 0.05, depth * draw.uniform(0.8, 1.2, depth.shape), depth)
        depth[draw.random(depth.shape) < 0.05] = 0
        write_map(workspace.depth(view.name), depth)
        write_map(workspace.normal(view.name), hits.normal @ view.camera.R.T)
        maps.append(DepthMap(view, workspace.depth(view.name), workspace.normal(view.name)))
    return maps


def test_fusion_drops_outliers_and_lessens_noise(ball, noisy, tmp_path: Path) -> None:
    _, mesh, caster = ball
    fused = fuse(noisy, FusionRules(pixels=1.5, relative=0.02), tmp_path)
    near, _ = caster.closest(fused.cloud.position)
    share = np.linalg.norm(fused.cloud.position - near, axis=1) / np.linalg.norm(np.ptp(mesh.vertices, axis=0))
    assert (share > 5 * NOISE).mean() < 0.005  # 5 % of the pixels were outliers
    assert 0.15 * NOISE < np.sqrt((share**2).mean()) < 0.8 * NOISE
    assert 0.7 < fused.confirmed / fused.known < 0.98
    assert fused.cloud.votes.min() >= 2


@pytest.mark.parametrize("method", ["volume", "poisson"])
def test_the_error_of_the_surface_is_near_the_noise(ball, noisy, tmp_path: Path, method: str) -> None:
    views, mesh, _ = ball
    config = SurfaceConfig(method=method, disparity=1.5, depth_difference=0.02)
    built = build_surface(views, noisy, config, tmp_path, 200_000_000)
    error = compare_surfaces(built.mesh, mesh, views, (0.1 * NOISE, 2 * NOISE), samples=5000)
    spread = np.sqrt((error.accuracy**2).mean()) / error.diagonal
    assert 0.1 * NOISE < spread < NOISE
    assert error.scores[0].f_score < 0.9
    assert error.scores[1].f_score > 0.97
    assert built.facts["method"] == method
    assert built.evidence.observations.shape == built.evidence.confidence.shape == (len(built.mesh.vertices),)
    assert built.evidence.confidence.max() <= 1
    assert np.median(built.evidence.observations) >= 3


def test_auto_closes_a_whole_object_by_its_outlines(ball, noisy, tmp_path: Path) -> None:
    views, _, _ = ball
    built = build_surface(views, noisy, SurfaceConfig(disparity=1.5, depth_difference=0.02), tmp_path, 200_000_000)
    assert built.facts["method"] == "poisson"
    assert built.facts["measured"]["photos_with_mask"] == len(views)
    figures = {each: built.facts["measured"][f"photo_consistency_{each}"] for each in ("poisson", "volume", "hull")}
    assert 0 < figures["volume"] <= figures["poisson"] < 1  # holes agree with nothing
    assert "the outlines alone" in built.facts["reason"]
    assert built.facts["closed"]
    assert built.facts["looked_through_share"] == 0
    again = build_surface(views, noisy, SurfaceConfig(disparity=1.5, depth_difference=0.02), tmp_path, 200_000_000)
    assert again.mesh.vertices.tobytes() == built.mesh.vertices.tobytes()


def test_without_depth_the_outlines_are_the_surface(ball, tmp_path: Path) -> None:
    views, mesh, _ = ball
    built = build_surface(views, [], SurfaceConfig(hull_completion="always", method="hull"), tmp_path, 200_000_000)
    assert built.facts["closed"]
    assert built.facts["unseen_share"] == 1.0
    assert (built.evidence.confidence == 0).all()
    error = compare_surfaces(built.mesh, mesh, views, (0.02,), samples=5000)
    assert error.scores[0].recall > 0.95
    volume = np.linalg.det(built.mesh.vertices[built.mesh.faces]).sum() / 6
    assert 4 / 3 * np.pi < volume < 1.15 * 4 / 3 * np.pi  # faces outward, no smaller than the ball


def test_one_wrong_mask_cuts_nothing_away(ball) -> None:
    outlines = load_outlines(ball[0])
    wrong = replace(outlines[3], distance=np.full_like(outlines[3].distance, 50))
    mesh, _ = hull_surface([wrong, *outlines[:3], *outlines[4:]], 1.25, 50_000_000)
    assert len(mesh.faces) > 500


def test_points_of_a_shell_inside_the_body_do_not_fill(ball) -> None:
    mesh, caster = ball[1:]
    normals = mesh.vertices / np.linalg.norm(mesh.vertices, axis=1, keepdims=True)
    assert behind(caster, 0.7 * normals, normals).all()
    assert not behind(caster, 1.1 * normals, normals).any()
    beside = normals[:, 2] < 0.5  # of a body open above only what looks up through the opening counts as outside
    open_above = without_vertices(mesh, beside)
    inner = behind(MeshCaster(open_above), 0.7 * normals, normals)
    assert inner[normals[:, 2] < -0.5].all()


def test_masks_that_lose_a_part_say_nothing_there(ball, noisy, tmp_path: Path) -> None:
    views = ball[0]
    cloud = fuse(noisy, FusionRules(pixels=1.5, relative=0.02), tmp_path).cloud
    outlines = load_outlines(views)
    assert len(contradicting(cloud, outlines)) < 0.01 * len(cloud.position)
    middle = outlines[3].camera.width // 2
    lost = np.where(np.arange(outlines[3].camera.width) < middle, np.float32(20), outlines[3].distance)
    against = contradicting(cloud, [*outlines[:3], replace(outlines[3], distance=lost), *outlines[4:]])
    mended = without_contradicted(replace(outlines[3], distance=lost), against).distance
    inside = (outlines[3].distance < -3) & (np.arange(lost.shape[1]) < middle)
    assert np.isnan(mended[inside]).mean() > 0.9
    assert np.isnan(mended).sum() < 1.5 * inside.sum()
    assert without_contradicted(outlines[0], against[:0]) is outlines[0]


def test_poisson_takes_no_more_points_than_memory_holds(ball) -> None:
    mesh = ball[1]
    normals = mesh.vertices / np.linalg.norm(mesh.vertices, axis=1, keepdims=True)
    count = len(normals)
    ones = np.ones(count, np.float32)
    cloud = Cloud(normals, normals.astype(np.float32), ones, np.full(count, 3, np.int32), 0.02 * ones)
    fine, step = poisson_surface(cloud, 0.1, 10**9)
    coarse, larger = poisson_surface(cloud, 0.02, 1000 * POINT_BYTES)
    assert step == 0.1
    assert len(thinned(normals, normals, 0.02)[0]) > 1000 >= len(thinned(normals, normals, larger)[0])
    assert larger > 0.02
    assert openings(fine).loops == openings(coarse).loops == 0


def test_points_are_left_out_where_memory_asks_for_it(noisy, tmp_path: Path) -> None:
    rules = FusionRules(pixels=1.5, relative=0.02)
    whole = fuse(noisy, rules, tmp_path / "a").cloud
    few = fuse(noisy, rules, tmp_path / "b", len(whole.position) * 10).cloud
    assert 0 < len(few.position) * 48 <= len(whole.position) * 10
    assert set(map(tuple, few.position)) <= set(map(tuple, whole.position))


def test_only_large_marked_pieces_count() -> None:
    sheet = _sheet(10)
    marked = (sheet.vertices[:, 0] < 2.5) | (sheet.vertices[:, 0] > 8.5)  # 2 and 1 of 10 columns
    assert (large_patches(sheet, marked, 0.15) == (sheet.vertices[:, 0] < 2.5)).all()
    assert not large_patches(sheet, sheet.vertices[:, 0] < 0, 0.1).any()


def test_masks_without_a_common_part_are_told(ball) -> None:
    outlines = [replace(each, distance=np.full_like(each.distance, 50)) for each in load_outlines(ball[0])]
    with pytest.raises(CaptureError, match="no part of space in common"):
        hull_surface(outlines, 1.25, 50_000_000)


def test_too_little_agreement_is_told(ball, tmp_path: Path) -> None:
    views = ball[0]
    write_map(tmp_path / "a.bin", np.full((72, 96), 4.0))
    with pytest.raises(CaptureError, match="points agree"):
        build_surface(views, [DepthMap(views[0], tmp_path / "a.bin")], SurfaceConfig(method="poisson"), tmp_path, 10**8)


def test_normals_from_the_slope_of_depth(ball) -> None:
    views, _, caster = ball
    hits = caster.cast_camera(views[0].camera)
    found = slope_normals(views[0].camera, np.where(np.isfinite(hits.t), hits.t, 0))
    cosine = (found * (hits.normal @ views[0].camera.R.T)).sum(axis=2)[np.isfinite(hits.t)]
    assert np.median(cosine) > 0.99
    assert (cosine > 0.7).mean() > 0.9


def test_maps_of_different_sizes_are_told(ball, tmp_path: Path) -> None:
    write_map(tmp_path / "depth.bin", np.ones((72, 96)))
    write_map(tmp_path / "normal.bin", np.ones((36, 48, 3)))
    with pytest.raises(CaptureError, match="write both at one size"):
        load_map(DepthMap(ball[0][0], tmp_path / "depth.bin", tmp_path / "normal.bin"))


def _sheet(count: int, at: float = 0.0) -> Mesh:
    """A flat square of count x count cells."""
    i, j = np.meshgrid(np.arange(count + 1), np.arange(count + 1), indexing="ij")
    vertices = np.stack([i.ravel() + at, j.ravel(), 0 * i.ravel()], axis=1).astype(float)
    corner = (np.arange(count)[:, None] * (count + 1) + np.arange(count)).ravel()
    faces = [np.stack([corner, corner + count + 1, corner + 1], 1)]
    faces.append(np.stack([corner + 1, corner + count + 1, corner + count + 2], 1))
    return Mesh(vertices, np.concatenate(faces))


def test_small_parts_go_and_borders_are_counted() -> None:
    large, small = _sheet(10), _sheet(1, 20.0)
    both = Mesh(np.concatenate([large.vertices, small.vertices]), np.concatenate([large.faces, small.faces + 121]))
    assert parts(both)[0] == 2
    assert openings(both).loops == 2
    kept, dropped = whole_parts(both, 0.02)
    assert (len(kept.faces), dropped) == (200, 1)
    assert whole_parts(both, 0.005)[1] == 0
    found = openings(kept)
    assert (found.loops, found.crowded) == (1, 0)
    assert found.length == pytest.approx(40)


def test_triangles_get_the_size_asked_for() -> None:
    found = simplified(_sheet(30), 3.0)
    area = 900 / len(found.faces)
    assert 0.433 * 9 * 0.8 < area < 0.433 * 9 * 1.4
    assert simplified(_sheet(3), 0.1).vertices.shape == (16, 3)


def test_the_mesh_keeps_its_values(tmp_path: Path) -> None:
    from ibrpipe.io.surfaces.meshes import read_vertex_values, write_mesh

    mesh = _sheet(2)
    values = {"confidence": np.linspace(0, 1, 9).astype(np.float32), "observations": np.arange(9, dtype=np.int32)}
    write_mesh(mesh, tmp_path / "a.ply", values)
    assert np.array_equal(read_mesh(tmp_path / "a.ply").vertices, mesh.vertices)
    found = read_vertex_values(tmp_path / "a.ply")
    assert all(np.array_equal(found[name], value) for name, value in values.items())
    write_mesh(mesh, tmp_path / "b.ply")
    assert read_vertex_values(tmp_path / "b.ply") == {}
