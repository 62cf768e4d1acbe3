"""Slopes against least squares by NumPy, sample by sample."""

from __future__ import annotations

import os
import subprocess
import sys

import numpy as np
import pytest
from kernel_runs import on_all_thread_counts

from ibrpipe.core.coding.slopes import REACH, fit_slopes, slopes


def twin(values, there, steepest, relative):
    found = np.zeros((*there.shape, 2))
    for i, j in np.argwhere(there):
        limit = steepest * (values[i, j] if relative else 1.0)
        rows = [
            (x - j, y - i, values[y, x] - values[i, j])
            for y, x in np.argwhere(there)
            if max(abs(y - i), abs(x - j)) <= REACH
            and abs(values[y, x] - values[i, j]) <= limit * np.hypot(x - j, y - i)
        ]
        system = np.array(rows, float)
        if np.linalg.matrix_rank(system[:, :2]) == 2:
            found[i, j] = np.linalg.lstsq(system[:, :2], system[:, 2], rcond=None)[0]
    return found


@pytest.mark.parametrize("relative", [False, True])
@pytest.mark.parametrize("share", [0.3, 0.8, 1.0])
def test_slopes_are_the_twins(relative, share):
    rng = np.random.default_rng(12)
    there = rng.random((9, 11)) < share
    values = 2 + rng.random((9, 11)) + 5 * (rng.random((9, 11)) < 0.2)
    np.testing.assert_allclose(slopes(values, there, 0.7, relative), twin(values, there, 0.7, relative), atol=1e-9)


def test_a_plane_gives_its_slopes_and_a_lone_sample_none():
    v, u = np.mgrid[:6, :7]
    there = np.ones((6, 7), bool)
    np.testing.assert_allclose(
        slopes(0.3 * u - 0.2 * v, there, 9, False), np.broadcast_to([0.3, -0.2], (6, 7, 2)), atol=1e-12
    )
    assert not slopes(np.ones((1, 1)), np.ones((1, 1), bool), 9, False).any()


@pytest.mark.parametrize("shape", [(0, 0), (0, 4), (1, 6), (7, 1), (12, 10)])
def test_the_kernel_fills_every_sample_with_holes_and_without(shape):
    rng = np.random.default_rng(4)
    there, values = rng.random(shape) < 0.6, 3 + rng.random(shape)
    values[~there] = np.nan

    def fill():
        out = np.full((*shape, 2), np.nan)
        fit_slopes(values, there, 0.7, False, out)
        return (out,)

    (found,) = on_all_thread_counts(fill)
    np.testing.assert_allclose(found, twin(values, there, 0.7, False), atol=1e-9)


THREADS = """
from concurrent.futures import ThreadPoolExecutor
import numpy as np
from ibrpipe.core.coding.slopes import slopes
v, u = np.mgrid[:200, :200]
whole = np.ones((200, 200), bool)
with ThreadPoolExecutor(4) as pool:
    found = list(pool.map(lambda k: slopes(k * u - v, whole, 99.0, False), np.arange(32.0)))
for k, each in enumerate(found):
    np.testing.assert_allclose(each, np.broadcast_to([k, -1], each.shape), atol=1e-9)
"""


def test_several_threads_may_ask_at_once_with_any_threading_layer():
    """Numba's own layer, the only one on some systems, aborts where threads enter loops of it side by side."""
    done = subprocess.run(
        [sys.executable, "-c", THREADS],
        env={**os.environ, "NUMBA_THREADING_LAYER": "workqueue"},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
