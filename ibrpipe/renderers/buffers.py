"""Working memory that a thread keeps from frame to frame: fresh pages cost more than what is written to them."""

from __future__ import annotations

import threading

import numpy as np

from ibrpipe.types import Array

#: most bytes that are kept for one purpose
MOST = 1 << 26

_kept = threading.local()


def borrow(purpose: str, count: int, dtype: type, value: float) -> Array:
    """Return (count,) of `dtype` filled with `value`, valid until the same thread borrows for the same purpose."""
    if count * np.dtype(dtype).itemsize > MOST:
        return np.full(count, value, dtype)
    key = f"{purpose} {np.dtype(dtype)}"
    held = getattr(_kept, key, None)
    if held is None or len(held) < count:
        held = np.empty(count, dtype)
        setattr(_kept, key, held)
    part: Array = held[:count]
    part.fill(value)
    return part
