"""Bytes against error: the choice by a price against a search of all choices."""

from __future__ import annotations

from itertools import product
from pathlib import Path

import numpy as np
import pytest

from ibrpipe.modelling.compression.parts import LEAST_ERROR, Parts, Source
from ibrpipe.modelling.compression.tradeoff import Choice, Curve, choices, filled, finer_while_worth


def curves(seed: int, parts: int = 3, levels: int = 5) -> dict[str, Curve]:
    rng = np.random.default_rng(seed)
    sizes = [np.sort(rng.integers(10, 1000, levels)).astype(float)[::-1] for _ in range(parts)]
    errors = [np.sort(rng.random(levels)) - (0.2 if n == 0 else 0.0) for n in range(parts)]
    return {f"part {n}": Curve(sizes[n], errors[n]) for n in range(parts)}


@pytest.mark.parametrize(("worth", "wanted"), [(1.0, 4), (0.02, 2), (0.003, 1), (0.0005, 0)])
def test_bytes_are_spent_as_long_as_they_are_worth_it(worth: float, wanted: int) -> None:
    sizes, squares = [1000.0, 500.0, 300.0, 250.0, 230.0], [1.0, 1.2, 1.5, 2.0, 3.0]  # 0.0016, 0.0048, 0.025, 0.088 dB
    ladder = [Choice({}, size, square - 0.9) for size, square in zip(sizes, squares)]
    assert finer_while_worth(ladder, 4, 0.9, worth) == wanted
    assert finer_while_worth(ladder, 1, 0.9, worth) == min(wanted, 1)


@pytest.mark.parametrize("seed", range(8))
def test_nothing_is_both_smaller_and_better_than_a_choice(seed: int) -> None:
    made = curves(seed)
    every = [
        (
            sum(c.sizes[p] for c, p in zip(made.values(), places)),
            sum(c.errors[p] for c, p in zip(made.values(), places)),
        )
        for places in product(range(5), repeat=3)
    ]
    found = choices(made)
    for choice in found:
        assert not any(size < choice.size - 1e-9 and error < choice.error - 1e-9 for size, error in every)
    assert [c.size for c in found] == sorted((c.size for c in found), reverse=True)
    assert [c.error for c in found] == sorted(c.error for c in found)
    assert found[0].error == pytest.approx(min(error for _, error in every))
    assert found[-1].size == pytest.approx(min(size for size, _ in every))
    # every corner of the lower hull of all choices is among those found
    for price in np.geomspace(1e-5, 1e-1, 40):
        best = min(error + price * size for size, error in every)
        assert min(c.error + price * c.size for c in found) == pytest.approx(best, rel=1e-6)


def test_levels_between_and_beyond_change_by_a_factor() -> None:
    np.testing.assert_allclose(filled(6, (1, 3), (8.0, 2.0)), [16, 8, 4, 2, 1, 0.5])
    np.testing.assert_allclose(filled(4, (1,), (3.0,), 2.0), [1.5, 3, 6, 12])


class Measured(Parts):
    """Parts whose levels of quality 90 and 50 take 1000 and 100 bytes and have the PSNR that is told."""

    def __init__(self, before: float, found: dict[int, float]) -> None:
        super().__init__(Source(Path(), None, None), lambda quality: found[quality], before)

    def coded(self, step):
        return step.layers.color_quality, {90: 1000, 50: 100}[step.layers.color_quality]


LADDER = [{}, *({"color_quality": quality} for quality in (90, 70, 50, 30, 10))]


@pytest.mark.parametrize("found", [{90: 30.1, 50: 29.5}, {90: 29.9, 50: 30.1}, {90: 29.9, 50: 29.5}])
def test_a_level_that_seems_to_mend_something_makes_no_coarser_one_free(found: dict[int, float]) -> None:
    curve = Measured(30.0, found).curve("color", LADDER, (1, 3))
    assert curve.errors[0] == 0.0
    assert (curve.errors[1:] >= LEAST_ERROR).all()
    assert (np.diff(curve.errors) >= 0).all()
    np.testing.assert_allclose(curve.sizes[[1, 3]], [1000, 100])
    if found[50] < 30:
        assert curve.errors[5] > 2 * curve.errors[3]
