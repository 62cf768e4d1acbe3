"""Kernels run as plain Python, too: with ``NUMBA_DISABLE_JIT=1``."""

from __future__ import annotations

import numba
import numpy as np
import pytest


@pytest.fixture(autouse=True)
def quiet_as_compiled():
    """With the compiler off, let divisions by zero, infinities and NaN be as quiet as in compiled code."""
    with np.errstate(**({"all": "ignore"} if numba.config.DISABLE_JIT else {})):
        yield
