"""``plan.json``: round trip, plans of earlier versions, damaged ones."""

from __future__ import annotations

import json

import numpy as np
import pytest

from ibrpipe.errors import FormatError
from ibrpipe.io.documents.plan import PlannedComponent
from ibrpipe.modelling.plan_file import TexturePlan, read_plan, reason, write_plan
from ibrpipe.modelling.rectangles import Rectangle
from ibrpipe.modelling.view_dependence.spiral_plan import SpiralPlan, spiral_of

RECTANGLE = Rectangle("front", np.zeros(3), np.array([2.0, 0, 0]), np.array([0, 1.5, 0]), 8, 6, None)
EARLIER = {
    **{"name": "front", "projection": "parallel", "origin": [0.0, 0.0, 0.0], "u": [2.0, 0.0, 0.0]},
    **{"v": [0.0, 1.5, 0.0], "center": None, "width": 8, "height": 6, "max_angle_deg": 48.0, "max_layers": 3},
}


def test_round_trip(tmp_path):
    spiral, tint = SpiralPlan(k=1 / 24, residual_scale=0.75), PlannedComponent(kind="tint", strength=0.5)
    plans = [TexturePlan(RECTANGLE, 48.0, 3, (spiral, tint)), TexturePlan(RECTANGLE, 60.0, 1)]
    told = [reason("k", 1 / 24, "why", codes=[1, 2.5])]
    write_plan(plans, told, tmp_path / "plan.json")
    first, second = read_plan(tmp_path / "plan.json")
    assert (first.max_angle_deg, first.max_layers, first.rectangle.name) == (48.0, 3, "front")
    np.testing.assert_array_equal(first.rectangle.v, RECTANGLE.v)
    assert [component.kind for component in first.components] == ["spiral", "tint"]
    assert spiral_of(first) == spiral
    assert first.component("tint").settings == {"strength": 0.5}
    assert (second.components, second.component("spiral")) == ((), None)
    content = json.loads((tmp_path / "plan.json").read_text(encoding="utf-8"))
    assert list(content) == ["schema", "textures", "reasons"]
    assert content["reasons"] == told
    assert content["textures"][0]["components"][0] == {"kind": "spiral", "k": 1 / 24, "residual_scale": 0.75}


@pytest.mark.parametrize("wanted", [True, False])
def test_plans_of_earlier_versions_are_read(tmp_path, wanted):
    texture = {**EARLIER, "residuals": wanted, "k": 0.04, "residual_scale": 0.6}
    (tmp_path / "plan.json").write_text(json.dumps({"schema": 1, "textures": [texture], "reasons": []}))
    (plan,) = read_plan(tmp_path / "plan.json")
    assert plan.components == ((PlannedComponent(kind="spiral", k=0.04, residual_scale=0.6),) if wanted else ())
    if wanted:
        assert (spiral_of(plan).k, spiral_of(plan).residual_scale) == (0.04, 0.6)


@pytest.mark.parametrize(
    ("changes", "match"),
    [
        ({"components": None}, r"textures\.0\.components"),
        ({"components": [{"k": 0.1}]}, r"textures\.0\.components\.0\.kind: Field required"),
        ({"components": [], "width": 0}, r"textures\.0\.width"),
        ({"residuals": True}, "KeyError: 'k'"),
        ({"components": [], "color": 1}, r"textures\.0\.color"),
    ],
)
def test_a_damaged_plan_is_named(tmp_path, changes, match):
    text = json.dumps({"schema": 1, "textures": [EARLIER | changes], "reasons": []})
    (tmp_path / "plan.json").write_text(text)
    with pytest.raises(FormatError, match=rf"plan\.json: not a plan \({match}.*run the plan stage again"):
        read_plan(tmp_path / "plan.json")


@pytest.mark.parametrize(
    ("component", "match"),
    [
        (PlannedComponent(kind="tint"), "wants no spiral for texture front"),
        (PlannedComponent(kind="spiral", k=0.1), "texture front in the plan: residual_scale: Field required"),
        (
            PlannedComponent(kind="spiral", k=-1, residual_scale=1),
            "front in the plan: k: Input should be greater",
        ),
    ],
)
def test_a_spiral_that_the_plan_does_not_describe(component, match):
    with pytest.raises(FormatError, match=match):
        spiral_of(TexturePlan(RECTANGLE, 48.0, 3, (component,)))
