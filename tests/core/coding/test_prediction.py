"""Prediction against its twin, and back."""

from __future__ import annotations

import numpy as np
import prediction_twin
import pytest

from ibrpipe.core.coding import prediction


@pytest.mark.parametrize("way", [prediction.PLANE, prediction.MEDIAN])
@pytest.mark.parametrize("shape", [(1, 1), (1, 9), (9, 1), (7, 8), (0, 3)])
@pytest.mark.parametrize("share", [0.0, 0.5, 1.0])
def test_differences_are_the_twins_and_lead_back(way, shape, share):
    rng = np.random.default_rng(3)
    there = rng.random(shape) < share
    values = np.where(there, rng.integers(-(2**39), 2**39, shape), 77)
    folded = np.zeros(int(there.sum()), np.uint64)
    prediction.take_differences(values, there, way, folded)
    wanted = prediction_twin.differences(values, there, way == prediction.MEDIAN)
    assert [int(n) for n in folded] == [2 * n if n >= 0 else -2 * n - 1 for n in wanted]
    back = np.zeros(shape, np.int64)
    prediction.add_differences(folded, there, way, back)
    np.testing.assert_array_equal(back[there], values[there])


def test_a_slope_costs_nothing_but_its_rim():
    values = np.add.outer(3 * np.arange(6), 5 * np.arange(7))
    folded = np.zeros(values.size, np.uint64)
    prediction.take_differences(values, np.ones(values.shape, bool), prediction.PLANE, folded)
    assert not folded.reshape(values.shape)[1:, 1:].any()
