"""Errors of surfaces and depth maps: of known size, found to be near it, in figures, words and pictures."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from ibrpipe.cli.main import cli
from ibrpipe.embree import MeshCaster
from ibrpipe.errors import CaptureError
from ibrpipe.evaluation.depth_error import depth_error, maps_of
from ibrpipe.evaluation.geometry_scores import GeometryRules, measure_geometry
from ibrpipe.evaluation.report.surface_pictures import draw_surface, shade
from ibrpipe.evaluation.report.surface_words import surface_sentences
from ibrpipe.evaluation.surface_error import compare_surfaces
from ibrpipe.io.dense import Workspace, write_map
from ibrpipe.io.documents.geometry import Geometry
from ibrpipe.io.surfaces.meshes import write_mesh
from ibrpipe.io.views import read_views
from ibrpipe.types import Camera, Mesh


@pytest.fixture(scope="module")
def ball(measured):
    """Views of the ball and its mesh."""
    found = measured("ball")
    return read_views(found.folder / "views.json").train, found.caster.mesh


def _scaled(mesh: Mesh, factor: float) -> Mesh:
    return Mesh(mesh.vertices * factor, mesh.faces)


def test_a_surface_that_stands_off_is_measured(ball) -> None:
    views, truth = ball
    error = compare_surfaces(_scaled(truth, 1.02), truth, views, (0.005, 0.0065), samples=3000)
    assert error.diagonal == pytest.approx(2 * 3**0.5, rel=0.01)
    assert np.median(error.accuracy) == pytest.approx(0.02, rel=0.05)  # 0.58 % of the diagonal
    assert np.median(error.completeness) == pytest.approx(0.02, rel=0.05)
    assert error.scores[0].f_score == 0
    assert error.scores[1].f_score == 1
    assert 0.5 < error.seen_share < 1


def test_half_a_surface_is_accurate_and_half_complete(ball) -> None:
    _, truth = ball
    upper = truth.vertices[truth.faces][:, :, 2].mean(axis=1) > 0
    error = compare_surfaces(Mesh(truth.vertices, truth.faces[upper]), truth, (), (0.001,), samples=4000)
    score = error.scores[0]
    assert score.precision == 1
    assert score.recall == pytest.approx(0.5, abs=0.02)
    assert score.f_score == pytest.approx(2 * score.recall / (1 + score.recall))
    assert error.seen_share == 1


def test_what_was_filled_is_told_apart(ball) -> None:
    _, truth = ball[:2]
    off = truth.vertices.copy()
    filled = off[:, 2] > 0.5
    off[filled] *= 1.1
    error = compare_surfaces(Mesh(off, truth.faces), truth, (), (0.005,), 3000, filled)
    score = error.scores[0]
    assert score.precision < 0.8
    alone = score.f_score_seen
    assert alone is not None
    precision = alone * score.recall / (2 * score.recall - alone)
    assert 0.9 < precision <= 1  # faces at the rim count as seen
    assert compare_surfaces(truth, truth, (), (0.005,), 3000).scores[0].f_score_seen is None


def test_what_nobody_sees_does_not_count(ball) -> None:
    views, truth = ball
    inner = _scaled(truth, 0.05)  # a stray part deep inside: its nearest true points are partly unseen
    both = Mesh(
        np.concatenate([truth.vertices, inner.vertices]),
        np.concatenate([truth.faces, inner.faces + len(truth.vertices)]),
    )
    wall = Mesh(truth.vertices + np.array([0, 0, 50.0]), truth.faces)
    assert compare_surfaces(both, truth, views, samples=3000).scores[2].precision < 1
    with pytest.raises(CaptureError, match="no two photos see"):
        compare_surfaces(truth, wall, views, samples=1000)


def test_depth_maps_are_held_against_the_truth(ball, tmp_path: Path) -> None:
    views, truth = ball
    caster, workspace, draw = MeshCaster(truth), Workspace(tmp_path), np.random.default_rng(0)
    workspace.lay_out()
    for view in views[:3]:
        true = caster.cast_camera(view.camera).t
        depth = np.where(np.isfinite(true), true + 0.01 * draw.normal(size=true.shape), 0)
        depth[draw.random(depth.shape) < 0.25] = 0
        write_map(workspace.depth(view.name), depth)
    error = depth_error(maps_of(workspace, views), caster, (0.01, 0.03))
    assert error is not None
    assert error.maps == 3
    assert error.known == pytest.approx(0.75, abs=0.02)
    assert error.rmse == pytest.approx(0.01, rel=0.05)
    assert error.bad[0] == pytest.approx(0.317, abs=0.02)  # beyond one deviation
    assert error.bad[1] < 0.01
    assert depth_error((), caster, (0.01,)) is None


def test_figures_and_words(ball, tmp_path: Path) -> None:
    views, truth = ball
    rules = GeometryRules((0.001, 0.01), 2000)
    scores = measure_geometry(_scaled(truth, 1.01), truth, "true.ply", views, None, rules)
    assert [score.f_score for score in scores.thresholds] == [0, 1]
    assert scores.depth is None
    facts = {"schema": 1, "decision": "photos", "reason": "why", "vertices": 6000, "faces": 12345}
    facts |= {"method": "poisson", "unseen_share": 0.02, "boundary_loops": 1}
    text = " ".join(surface_sentences(scores, Geometry.model_validate(facts)))
    for part in ("Poisson", "1.000 at 1 %", "2.0 %", "1 open border,", "true.ply"):
        assert part in text
    assert surface_sentences(None, None) == []
    facts |= {"boundary_loops": 0, "filled_by_outlines": True, "voxel": 0.2, "voxel_wanted": 0.1}
    facts |= {"seconds": {"depth": 71.2, "fusion": 3}}
    made = Geometry.model_validate(facts)
    assert made.filled_by_hull  # by the name that it had earlier
    assert '"filled_by_hull": true' in made.to_json()
    text = " ".join(surface_sentences(None, made, peak_memory_bytes=1_200_000_000))
    for part in ("it is closed", "confidence 0", "2.0 times larger", "depth 71 s, fusion 3 s; 1.20 GB"):
        assert part in text


def test_pictures_show_the_surface_its_error_and_its_back(ball) -> None:
    views, truth = ball
    confidence = np.linspace(0, 1, len(truth.vertices)).astype(np.float32)
    drawn = draw_surface(_scaled(truth, 1.02), views[:1], 60, confidence, truth)
    assert all(uri.startswith("data:image/jpeg") for uri in (drawn[0].shaded, drawn[0].error, drawn[0].missing))
    assert drawn[0].width == 60
    unsure = draw_surface(truth, views[:1], 60, 0 * confidence)
    assert unsure[0].confidence != draw_surface(truth, views[:1], 60, 0 * confidence + 0.01)[0].confidence
    plain = draw_surface(truth, views[:1], 60)
    assert plain[0].confidence is plain[0].error is plain[0].missing is None
    caster, camera = MeshCaster(truth), Camera.look_at((4, 0, 0), (0, 0, 0), width=24, height=24)
    front = shade(caster, caster.cast_camera(camera), camera)[12, 12].astype(int)
    inside = MeshCaster(Mesh(truth.vertices, truth.faces[:, ::-1].copy()))
    back = shade(inside, inside.cast_camera(camera), camera)[12, 12].astype(int)
    assert np.ptp(front) < 15 < back[0] - back[2]


def test_the_command_prints_figures(ball, tmp_path: Path) -> None:
    write_mesh(ball[1], tmp_path / "a.ply")
    write_mesh(_scaled(ball[1], 1.01), tmp_path / "b.ply")
    call = [
        "compare-mesh",
        str(tmp_path / "b.ply"),
        str(tmp_path / "a.ply"),
        "--samples",
        "1000",
        "--threshold",
        "0.01",
    ]
    done = CliRunner().invoke(cli, call)
    assert done.exit_code == 0
    assert "within 1 %  precision 1.0000  recall 1.0000  F 1.0000" in done.output
    found = json.loads(CliRunner().invoke(cli, [*call, "--json"]).stdout)
    assert found["accuracy_median"] == pytest.approx(0.01, rel=0.1)
    assert CliRunner().invoke(cli, ["compare-mesh", str(tmp_path / "c.ply"), str(tmp_path / "a.ply")]).exit_code == 1
