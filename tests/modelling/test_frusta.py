"""Perspective images in the plan: placed by themselves, edited by the pipeline file, and what their texels are."""

from __future__ import annotations

import numpy as np
import pytest
import yaml

from ibrpipe.embree import MeshCaster
from ibrpipe.engine.pipeline_file import load_pipeline
from ibrpipe.errors import ConfigError
from ibrpipe.modelling.frusta import Frustum, cube_frusta
from ibrpipe.modelling.plan_file import read_plan
from ibrpipe.modelling.planning import PlanConfig, choose_rectangles
from ibrpipe.modelling.rectangles import before_surface
from ibrpipe.stages.plan import Inputs, run
from ibrpipe.stages.registry import load_stages


def test_a_frustums_rectangle_has_its_camera_and_lies_before_the_surface(measured):
    caster = measured("ball").caster
    frustum = Frustum(eye=(3, -4, 2), target=(0.1, 0, 0), up=(0, 0.2, 1), fov=35)
    rectangle = before_surface("one", frustum, caster, 0.05)
    wanted = frustum.camera(rectangle.width)
    np.testing.assert_allclose(rectangle.frame.K, wanted.K, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(rectangle.frame.cam_from_world, wanted.cam_from_world, atol=1e-12)
    away = np.linalg.norm(np.subtract(frustum.eye, frustum.target))
    assert 2 * away * np.tan(np.radians(17.5)) / rectangle.width == pytest.approx(0.05, rel=0.01)
    assert ((caster.mesh.vertices - rectangle.origin) @ rectangle.f).min() > -0.01 * away


@pytest.mark.parametrize(("arrange", "most"), [("cube", 6), ("greedy", 6)])
def test_arrangements_face_all_that_can_be_seen(measured, arrange, most):
    caster = measured("ball").caster
    placed, (why,) = choose_rectangles(PlanConfig(arrange=arrange, maps=6), caster, 0.1, 3)
    assert 3 <= len(placed) <= most
    assert why["choice"] == len(placed)
    corners = caster.mesh.vertices[caster.mesh.faces]
    best = np.max([each.facing(corners.mean(axis=1), caster.flat_normals.astype(float)) for each in placed], axis=0)
    assert np.mean(best > 0.1) > 0.95
    assert [each.name for each in placed] == [f"map {k:02d}" for k in range(len(placed))]
    assert choose_rectangles(PlanConfig(arrange=arrange, maps=6), caster, 0.1, 3)[1] == [why]


def test_frusta_go_out_to_a_file_and_come_back_by_the_pipeline_file(measured, tmp_path):
    folder = measured("ball").folder
    for name in ("first", "second"):
        (tmp_path / name).mkdir()
    config = PlanConfig(samples=1000, arrange="cube", residuals="never", texel=0.1)
    made = run(Inputs(folder / "views.json", folder / "mesh.ply", 0, tmp_path / "first"), config)
    entries = yaml.safe_load((tmp_path / "first/frusta.yaml").read_text())
    assert {tuple(entry["eye"]) for entry in entries} <= {
        each.eye for each in cube_frusta(measured("ball").caster.mesh)
    }
    entries[0]["fov"] = 20.0
    text = {"plan": {"samples": 1000, "residuals": "never", "texel": 0.1, "frusta": entries[:2]}}
    (tmp_path / "mine.yaml").write_text(yaml.safe_dump(text))
    edited = load_pipeline(tmp_path / "mine.yaml", load_stages()).configs["plan"]
    second = run(Inputs(folder / "views.json", folder / "mesh.ply", 0, tmp_path / "second"), edited)
    one, other = (read_plan(outputs.plan) for outputs in (made, second))
    assert len(other) == 2
    np.testing.assert_allclose(other[0].rectangle.frame.K[0, 0] / other[0].rectangle.width, 0.5 / np.tan(np.pi / 18))
    np.testing.assert_allclose(other[1].rectangle.frame.K, one[1].rectangle.frame.K)
    assert len(yaml.safe_load((tmp_path / "second/frusta.yaml").read_text())) == 2


@pytest.mark.parametrize(
    ("line", "match"),
    [
        ("frusta: [{eye: [0, 0, 1], target: [0, 0, 1]}]", "must differ"),
        ("frusta: [{eye: [0, 0], target: [0, 0, 1]}]", "mine.yaml:2: plan.frusta.0.eye"),
        ("frusta: [{eye: [0, 0, 3], target: [0, 0, 1], zoom: 2}]", 'unknown key "zoom" in plan.frusta.0'),
        ("frusta: [{eye: [0, 0, 3], target: [0, 0, 1], fov: 180}]", "plan.frusta.0.fov is 180"),
        ("arrange: sphere", "plan.arrange is sphere|'sphere'"),
    ],
)
def test_mistakes_in_the_pipeline_file_are_named(tmp_path, line, match):
    (tmp_path / "mine.yaml").write_text(f"plan:\n  {line}\n")
    with pytest.raises(ConfigError, match=match):
        load_pipeline(tmp_path / "mine.yaml", load_stages())


def test_a_frustum_that_sees_nothing_stands_at_its_target(measured):
    caster = MeshCaster(measured("ball").caster.mesh)
    rectangle = before_surface("away", Frustum(eye=(50, 0, 0), target=(60, 0, 0)), caster, 0.5)
    assert (rectangle.origin - (50, 0, 0)) @ rectangle.f == pytest.approx(10.0)
