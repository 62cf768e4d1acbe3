"""The steps of coding, and bisection against looking at all."""

from __future__ import annotations

import pytest

from ibrpipe.modelling.compression.steps import STEPS, coarsest, finest, keep_normals


def test_steps_go_from_exact_to_coarse() -> None:
    assert STEPS[0].layers.lossless
    assert STEPS[0].components is None
    for name, exact in (("color_quality", 101), ("normal_bits", 99)):
        values = [getattr(step.layers, name) or exact for step in STEPS]
        assert values == sorted(values, reverse=True)
    depths = [step.layers.depth_step or 0.0 for step in STEPS]
    assert depths == sorted(depths)
    components = [step.components or 100 for step in STEPS]
    assert components == sorted(components, reverse=True)


@pytest.mark.parametrize("count", [1, 2, 5, 14])
def test_bisection_finds_what_a_search_of_all_finds(count: int) -> None:
    for edge in range(count + 1):
        asked: list[int] = []

        def kept(step: int, edge: int = edge, asked: list[int] = asked) -> bool:
            asked.append(step)
            return step < edge

        assert coarsest(count, kept) == (edge - 1 if edge else None)
        assert len(asked) == len(set(asked)) <= count.bit_length()
        assert finest(count, lambda step, edge=edge: step >= edge) == (edge if edge < count else None)


def test_normals_can_be_kept_in_every_step() -> None:
    assert keep_normals(STEPS[0]) == STEPS[0]
    for step in STEPS[1:]:
        kept = keep_normals(step)
        assert (kept.layers.normal_tolerance, kept.layers.normal_bits) == (None, 8)
        assert (kept.layers.color_quality, kept.components) == (step.layers.color_quality, step.components)
