"""The range of colours around a pixel: against the twin, with holes and borders; a shifted picture lies within."""

from __future__ import annotations

import numpy as np
import pytest
import shift_range_twin
from kernel_runs import on_all_thread_counts

from ibrpipe.core.appearance.shift_range import range_around


def ranges(picture, radius):
    rows, columns = (axis.ravel() for axis in np.indices(picture.shape[:2]))
    low, high = np.empty((len(rows), 3), np.float32), np.empty((len(rows), 3), np.float32)
    range_around(picture, rows, columns, radius, low, high)
    return low.reshape(picture.shape), high.reshape(picture.shape)


@pytest.mark.parametrize("radius", [0.0, 0.4, 1.0])
def test_as_twin_whatever_the_threads(radius):
    rng = np.random.default_rng(5)
    picture = rng.random((6, 7, 3)).astype(np.float32)
    picture[rng.random((6, 7)) < 0.15] = np.nan
    low, high = on_all_thread_counts(lambda: ranges(picture, radius))
    for row in range(6):
        for column in range(7):
            wanted = shift_range_twin.range_around(picture.astype(float), row, column, radius)
            np.testing.assert_allclose((low[row, column], high[row, column]), wanted, atol=1e-6)


def test_a_picture_shifted_by_less_lies_within_and_a_brighter_one_does_not():
    x, y = np.meshgrid(np.arange(24.0), np.arange(20.0))
    wave = lambda dx, dy: 0.5 + 0.3 * np.sin((x + dx) / 2.5) * np.cos((y + dy) / 3)  # noqa: E731
    picture = np.repeat(wave(0, 0)[:, :, None], 3, axis=2).astype(np.float32)
    low, high = ranges(picture, 1.0)
    inner = np.s_[2:-2, 2:-2]
    shifted = wave(0.5, -0.4)[:, :, None]
    beyond = shifted - np.clip(shifted, low, high)
    assert np.abs(beyond[inner]).max() < 0.2 * np.abs(shifted - picture)[inner].max()
    brighter = picture + 0.2
    assert (brighter - np.clip(brighter, low, high))[inner].mean() > 0.1


def test_no_pixels():
    low = np.empty((0, 3), np.float32)
    range_around(np.zeros((3, 3, 3), np.float32), np.zeros(0, np.int64), np.zeros(0, np.int64), 1.0, low, low.copy())
