"""sRGB transfer function and relative luminance on arrays. Source: iec61966; primaries Rec.709."""

from __future__ import annotations

import numpy as np

#: Relative luminance of linear Rec.709 red, green, blue (ITU-R BT.709)
LUMINANCE = (0.2126, 0.7152, 0.0722)


def srgb_encode(linear, top=1.0):
    """Code linear light as sRGB.

    Parameters
    ----------
    linear : array_like of float
        Linear light; values outside 0..top are clipped first, NaN stays NaN.
    top : float
        1 for pictures; infinity carries the curve on above 1, for light that is not clipped.

    Returns
    -------
    ndarray
        Coded values, 0..1 where `top` is 1, same shape; float64 in, float64 out, all else float32.
    """
    x = np.clip(_floating(linear), 0.0, top)
    low = x * x.dtype.type(12.92)
    high = x.dtype.type(1.055) * np.power(np.maximum(x, x.dtype.type(0.0031308)), x.dtype.type(1.0 / 2.4))
    return np.where(x <= x.dtype.type(0.0031308), low, high - x.dtype.type(0.055))


def srgb_decode(coded):
    """Turn sRGB-coded values into linear light: the inverse of `srgb_encode` on 0..1.

    Parameters
    ----------
    coded : array_like of float
        Coded values; below 0 counts as 0, above 1 the curve is carried on, NaN stays NaN.

    Returns
    -------
    ndarray
        Linear light, same shape; float64 in, float64 out, all else float32.
    """
    x = np.maximum(_floating(coded), 0.0)
    low = x / x.dtype.type(12.92)
    high = np.power((x + x.dtype.type(0.055)) / x.dtype.type(1.055), x.dtype.type(2.4))
    return np.where(x <= x.dtype.type(0.04045), low, high)


def to_bytes(coded):
    """Quantise coded values in 0..1 to 8 bits, rounding half up; uint8, same shape."""
    x = np.clip(_floating(coded), 0.0, 1.0)
    return (x * x.dtype.type(255.0) + x.dtype.type(0.5)).astype(np.uint8)


def decode_table(levels):
    """Linear light of every code 0..levels-1 of an sRGB-coded integer image, (levels,) float32."""
    return srgb_decode(np.arange(levels, dtype=np.float64) / (levels - 1)).astype(np.float32)


def luminance(linear):
    """Relative luminance of (..., 3) linear Rec.709, (...) of the same dtype."""
    x = _floating(linear)
    return x @ np.asarray(LUMINANCE, dtype=x.dtype)


def _floating(values):
    array = np.asarray(values)
    return array if array.dtype == np.float64 else array.astype(np.float32, copy=False)
