"""Levels of coding: from exact to coarse, and put together."""

from __future__ import annotations

import pytest

from ibrpipe.io.layer_pictures import Coding
from ibrpipe.modelling.compression.steps import ANCHORS, FACTORS, LADDERS, CodingStep, step_of


@pytest.mark.parametrize("part", LADDERS)
def test_ladders_go_from_exact_to_coarse(part: str) -> None:
    ladder = LADDERS[part]
    assert ladder[0] == {}
    (name,) = {name for level in ladder[1:] for name in level}
    values = [level[name] for level in ladder[1:]]
    assert values == sorted(set(values), reverse=part != "depth")
    anchors = ANCHORS[part]
    assert 0 < min(anchors) <= max(anchors) < len(ladder)
    assert len(anchors) > 1 or part in FACTORS


def test_levels_of_all_parts_make_a_step() -> None:
    assert step_of([{}, {}]) == CodingStep()
    step = step_of([{"color_quality": 80}, {}, {"normal_quality": 50}, {"weights": 20}, {"components": 7}])
    assert step == CodingStep(Coding(color_quality=80, normal_quality=50), 7, 20)
    assert (step.quality_of("spiral"), step.quality_of("reflection")) == (7, 20)
