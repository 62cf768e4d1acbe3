"""Arrays as the types keep them: checked once, on the way in."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ibrpipe.errors import ShapeError, ValueRangeError

Array = NDArray[Any]


def finite_array(name: str, value: ArrayLike, shape: tuple[int, ...], dtype: Any = np.float64) -> Array:
    """Return a read-only copy of `value`; every entry finite, shape as stated."""
    array = np.array(value, dtype=dtype)
    if array.shape != shape:
        raise ShapeError(f"{name} must have shape {shape}, got {array.shape}")
    if not np.isfinite(array).all():
        raise ValueRangeError(f"{name} holds NaN or infinity: {array.tolist()}; every entry must be finite")
    array.setflags(write=False)
    return array


def contiguous(name: str, value: ArrayLike, dtype: Any, ndim: int) -> Array:
    """Return `value` as a C-contiguous array without copying where possible."""
    array = np.ascontiguousarray(value, dtype=dtype)
    if array.ndim != ndim:
        raise ShapeError(f"{name} must have {ndim} axes, got shape {array.shape}")
    return array


def check_color(color: Array) -> None:
    """Raise `ValueRangeError` where light is negative, NaN or infinite."""
    if not np.isfinite(color).all():
        raise ValueRangeError("color holds NaN or infinity; repair the image before making a texture of it")
    if color.size and color.min() < 0:
        raise ValueRangeError(f"color holds negative light ({color.min():.4g}); clip it to 0")
