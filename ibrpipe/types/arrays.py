"""Arrays as the types keep them: checked once, on the way in."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ibrpipe.errors import ShapeError, ValueRangeError

Array = NDArray[Any]
#: no position, length or depth is beyond this, in scene units: squares and products of it are finite
LARGEST = 1e15


def numbers_of(values: Array) -> str:
    """Return a few numbers as a person reads them."""
    return f"({', '.join(f'{value + 0.0:.4g}' for value in values)})"


def finite_array(name: str, value: ArrayLike, shape: tuple[int, ...], dtype: Any = np.float64) -> Array:
    """Return a read-only copy of `value`; every entry finite, shape as stated."""
    try:
        array = np.array(value, dtype=dtype)
    except (TypeError, ValueError, OverflowError) as error:
        raise ShapeError(f"{name} must hold numbers of shape {shape} ({error})") from error
    if array.shape != shape:
        raise ShapeError(f"{name} must have shape {shape}, got {array.shape}")
    if not np.isfinite(array).all():
        raise ValueRangeError(f"{name} holds NaN or infinity: {array.tolist()}; every entry must be finite")
    largest = np.abs(array).max(initial=0.0)
    if largest > LARGEST:
        raise ValueRangeError(f"{name} holds {largest:g}; no entry may be beyond {LARGEST:g}: scale the scene")
    array.setflags(write=False)
    return array


def contiguous(name: str, value: ArrayLike, dtype: Any, ndim: int) -> Array:
    """Return `value` as a C-contiguous array without copying where possible."""
    try:
        array = np.ascontiguousarray(value, dtype=dtype)
    except (TypeError, ValueError, OverflowError) as error:
        raise ShapeError(f"{name} must be an array of {np.dtype(dtype)} ({error})") from error
    if array.ndim != ndim:
        raise ShapeError(f"{name} must have {ndim} axes, got shape {array.shape}")
    return array


def check_depth(name: str, depth: Array) -> None:
    """Raise `ValueRangeError` where a depth or height is beyond `LARGEST`; NaN may stand."""
    if depth.size and np.fmax.reduce(np.abs(depth), axis=None) > LARGEST:
        raise ValueRangeError(f"{name} goes beyond {LARGEST:g} scene units; leave such samples out, or scale the scene")


def check_color(color: Array) -> None:
    """Raise `ValueRangeError` where light is negative, NaN or infinite."""
    if not np.isfinite(color).all():
        raise ValueRangeError("color holds NaN or infinity; repair the image before making a texture of it")
    if color.size and color.min() < 0:
        raise ValueRangeError(f"color holds negative light ({color.min():.4g}); clip it to 0")
