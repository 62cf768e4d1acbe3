"""Offsets of samples, and layered images of one depth per texel."""

from __future__ import annotations

import numpy as np
import pytest

from ibrpipe.errors import ShapeError, ValueRangeError
from ibrpipe.types import LayeredDepthImage, ParallelFrame
from ibrpipe.types.layers import offsets_of, single_layer


def test_offsets_run_on_from_row_to_row():
    assert offsets_of(np.array([[2, 0, 1], [0, 3, 1]])).tolist() == [[0, 2, 2, 3], [3, 3, 6, 7]]


def test_texels_without_depth_hold_no_sample():
    frame = ParallelFrame(np.zeros(3), np.array([1.0, 0, 0]), np.array([0, 1.0, 0]), np.array([0, 0, 1.0]))
    depth = np.array([[1.0, np.nan], [np.inf, 4.0]])
    color = np.arange(12.0).reshape(2, 2, 3)
    plain, seen = (single_layer(frame, depth, color, observed=observed) for observed in (False, True))
    assert plain.depth.tolist() == [1.0, 4.0]
    assert np.diff(plain.offsets, axis=1).tolist() == [[1, 0], [0, 1]]
    np.testing.assert_array_equal(plain.color, color[[0, 1], [0, 1]])
    assert np.isnan(plain.normal).all()
    assert plain.observers is None
    assert seen.observers.tolist() == [1, 1]


@pytest.mark.parametrize(
    ("coverage", "error", "match"),
    [([1.0], ShapeError, "coverage must be \\(2,\\)"), ([0.0, 1.0], ValueRangeError, "not above 0 and up to 1")],
)
def test_coverage_is_one_share_a_sample(coverage, error, match):
    frame = ParallelFrame(np.zeros(3), np.array([1.0, 0, 0]), np.array([0, 1.0, 0]), np.array([0, 0, 1.0]))
    one = np.ones((2, 3), np.float32)
    with pytest.raises(error, match=match):
        LayeredDepthImage(frame, np.array([[0, 2]]), np.ones(2), one, one, None, np.array(coverage))
