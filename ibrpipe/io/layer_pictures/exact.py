"""Single floats as whole numbers that give back every bit."""

from __future__ import annotations

import numpy as np

from ibrpipe.types import Array

#: numbers below this size keep their bits as float32 times a power of two
_MOST = 2.0**31


def common_step(values: Array) -> float | None:
    """Return the greatest power of two of which float32 values (N,) are multiples below 2^31; None = there is none."""
    used = values[values != 0].astype(np.float64)
    if not np.isfinite(used).all() or np.signbit(values[values == 0]).any():
        return None
    if not len(used):
        return 1.0
    mantissa, exponent = np.frexp(used)
    whole = np.abs(mantissa * 2.0**24).astype(np.int64)
    step = float(np.ldexp((whole & -whole).astype(float), exponent - 24).min())
    return step if np.abs(used).max() < _MOST * step else None


def numbers_of(values: Array, step: float | None) -> Array:
    """Return whole numbers (N,) int64 of float32 values: multiples of `step`, or their bits in ascending order."""
    if step is not None:
        return np.round(values.astype(np.float64) / step).astype(np.int64)
    bits = np.ascontiguousarray(values, np.float32).view(np.int32).astype(np.int64)
    return np.where(bits < 0, -(bits & 0x7FFFFFFF) - 1, bits)


def values_of(numbers: Array, step: float | None) -> Array:
    """Return the float32 values of `numbers_of`."""
    if step is not None:
        with np.errstate(over="ignore"):
            return (numbers * step).astype(np.float32)
    bits = np.where(numbers < 0, (-numbers - 1) | 0x80000000, numbers)
    return (bits & 0xFFFFFFFF).astype(np.uint32).view(np.float32)
