"""One step of Adam against the formula, written with whole arrays in float64."""

from __future__ import annotations

import numpy as np
import pytest

from ibrpipe.core.reflection.steps import FIRST, SECOND, TINY, adam_step


@pytest.mark.parametrize("count", [1, 2, 40])
def test_a_step_is_the_formula_of_its_source(count: int) -> None:
    rng = np.random.default_rng(count)
    values, gradient = rng.random((5000, 3)).astype(np.float32), rng.normal(size=(5000, 3)).astype(np.float32)
    first, second = rng.normal(size=(5000, 3)).astype(np.float32), rng.random((5000, 3)).astype(np.float32)
    rates, lows = np.array([0.02, 0.04, 0.05]), np.array([0.0, 0.25, -1.0])
    m = FIRST * first.astype(float) + (1 - FIRST) * gradient.astype(float)
    v = SECOND * second.astype(float) + (1 - SECOND) * gradient.astype(float) ** 2
    corrected = (m / (1 - FIRST**count)) / np.sqrt(v / (1 - SECOND**count))
    wanted = np.maximum(values - rates * corrected, lows)
    adam_step(values, gradient, first, second, rates, lows, count)
    np.testing.assert_allclose(first, m, rtol=1e-6, atol=1e-7)
    np.testing.assert_allclose(second, v, rtol=1e-6, atol=1e-7)
    np.testing.assert_allclose(values, wanted, rtol=1e-5, atol=1e-6)
    assert (values[:, 1] >= 0.25).all()
    assert (values[:, 1] == np.float32(0.25)).any()


def test_what_has_no_gradient_stays_and_nothing_is_no_error() -> None:
    values = np.full((3, 1), 0.5, np.float32)
    none = np.zeros_like(values)
    adam_step(values, none, none.copy(), none.copy(), np.ones(1), np.zeros(1), 1)
    np.testing.assert_array_equal(values, np.float32(0.5))
    assert TINY > 0
    empty = np.zeros((0, 2), np.float32)
    adam_step(empty, empty, empty.copy(), empty.copy(), np.ones(2), np.zeros(2), 1)
