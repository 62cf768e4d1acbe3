"""Bytes against error: the choice by a price against a search of all choices."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from ibrpipe.modelling.compression.tradeoff import Curve, choices, filled


def curves(seed: int, parts: int = 3, levels: int = 5) -> dict[str, Curve]:
    rng = np.random.default_rng(seed)
    sizes = [np.sort(rng.integers(10, 1000, levels)).astype(float)[::-1] for _ in range(parts)]
    errors = [np.sort(rng.random(levels)) - (0.2 if n == 0 else 0.0) for n in range(parts)]
    return {f"part {n}": Curve(sizes[n], errors[n]) for n in range(parts)}


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


def test_what_mends_something_is_interpolated_evenly() -> None:
    np.testing.assert_allclose(filled(5, (1, 3), (-1.0, 1.0)), [-1, -1, 0, 1, 1])
