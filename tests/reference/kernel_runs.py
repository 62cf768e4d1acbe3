"""Run something on one thread and on several and see that no byte differs."""

from __future__ import annotations

import numba
import numpy as np


def on_all_thread_counts(compute):
    """Return what `compute()` returns (a tuple of arrays), having found the same bytes with 1 and with 2 threads."""
    before, results = numba.get_num_threads(), []
    try:
        for threads in (1, min(2, numba.config.NUMBA_NUM_THREADS)):
            numba.set_num_threads(threads)
            results.append(compute())
    finally:
        numba.set_num_threads(before)
    for one, other in zip(*results, strict=True):
        assert np.asarray(one).tobytes() == np.asarray(other).tobytes()
    return results[0]
