"""ICC profiles made of curves and a matrix, or of a grey curve, as the way to linear Rec.709.

Format: ICC.1:2010, sec. 7 (header, tag table), 10.5 and 10.16 (curveType, parametricCurveType), 10.31 (XYZType).
Colorants of a profile are relative to D50, whatever white its colours had; Bradford's matrix leads on to D65.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ibrpipe.errors import FormatError
from ibrpipe.types import Array

#: Linear Rec.709 from XYZ relative to D50 (sRGB's own matrix after Bradford's adaptation to D65)
REC709_FROM_XYZ_D50 = np.array(
    [
        [3.1338561, -1.6168667, -0.4906146],
        [-0.9787684, 1.9161415, 0.0334540],
        [0.0719453, -0.2289914, 1.4052427],
    ]
)
_Curve = Callable[[Array], Array]
#: Which parameters of a parametric curve there are, by its type; the rest are 0 (d: the curve bends nowhere)
_PARAMETERS = {0: "g", 1: "gab", 2: "gabc", 3: "gabcd", 4: "gabcdef"}


@dataclass(frozen=True, eq=False)
class Profile:
    """How stored values become light.

    Attributes
    ----------
    curves : tuple of callable
        For each of three channels, or for grey alone: 0..1 as stored to 0..1 linear.
    matrix : (3, 3) float64 or None
        Linear Rec.709 from the linear channels; None = grey.
    """

    curves: tuple[_Curve, ...]
    matrix: Array | None

    def linear(self, colour: Array) -> Array:
        """Convert (H, W, 1 or 3), stored values as 0..1, to linear Rec.709, float32."""
        pixels = np.asarray(colour, np.float64)
        if self.matrix is None or pixels.shape[2] == 1:
            return self.curves[0](pixels).astype(np.float32)
        planes = [curve(pixels[:, :, n]) for n, curve in enumerate(self.curves)]
        return (np.stack(planes, axis=2) @ self.matrix.T).astype(np.float32)


def read_profile(data: bytes, channels: int) -> Profile | None:
    """Read a profile; None where it is one of another kind of colours than the file's channels.

    Parameters
    ----------
    data : bytes
    channels : int
        Colour channels of the picture, 1 or 3.

    Raises
    ------
    FormatError
        It is damaged, made of tables alone, or of other colours than RGB and grey.
    """
    kind = data[16:20]
    if kind not in (b"GRAY", b"RGB "):
        name = kind.decode("ascii", "replace").strip()
        raise FormatError(f"its ICC profile is of {name} colours, expected RGB or grey: convert the photo to sRGB")
    try:
        tags = _tags(data)
        if kind == b"GRAY" and channels == 1:
            return Profile((_curve(data, *tags[b"kTRC"]),), None)
        if kind != b"RGB " or channels != 3:
            return None
        curves = tuple(_curve(data, *tags[name + b"TRC"]) for name in (b"r", b"g", b"b"))
        colorants = np.stack([_xyz(data, *tags[name + b"XYZ"]) for name in (b"r", b"g", b"b")], axis=1)
    except KeyError as error:
        raise FormatError(
            "its ICC profile is made of tables, expected one of curves and a matrix: convert the photo to sRGB, or set "
            "ingest.color_space"
        ) from error
    except (struct.error, IndexError, ValueError) as error:
        raise FormatError("its ICC profile is damaged: save the photo as sRGB, or set ingest.color_space") from error
    return Profile(curves, REC709_FROM_XYZ_D50 @ colorants)


def _tags(data: bytes) -> dict[bytes, tuple[int, int]]:
    (count,) = struct.unpack_from(">I", data, 128)
    if count > 1000:
        raise ValueError(count)
    rows = (struct.unpack_from(">4sII", data, 132 + 12 * n) for n in range(count))
    return {name: (start, size) for name, start, size in rows}


def _fixed(data: bytes, start: int, count: int) -> list[float]:
    return [value / 65536.0 for value in struct.unpack_from(f">{count}i", data, start)]


def _xyz(data: bytes, start: int, size: int) -> Array:
    return np.array(_fixed(data, start + 8, 3))


def _curve(data: bytes, start: int, size: int) -> _Curve:
    kind = data[start : start + 4]
    if kind == b"para":
        (number,) = struct.unpack_from(">H", data, start + 8)
        names = _PARAMETERS[number]
        return _parametric(number, dict(zip(names, _fixed(data, start + 12, len(names)))))
    if kind != b"curv":
        raise ValueError(kind)
    (count,) = struct.unpack_from(">I", data, start + 8)
    table = np.array(struct.unpack_from(f">{count}H", data, start + 12), np.float64)
    if count == 0:
        return lambda x: x
    if count == 1:
        gamma = table[0] / 256.0
        return lambda x: np.maximum(x, 0.0) ** gamma
    return lambda x: np.interp(x, np.linspace(0.0, 1.0, count), table / 65535.0)


def _parametric(kind: int, given: dict[str, float]) -> _Curve:
    """Y = (a X + b)^g + e from X = d on, c X + f below; types 1 and 2 bend at -b / a."""
    g, a, b = given["g"], given.get("a", 1.0), given.get("b", 0.0)
    c, d, e, f = (given.get(name, 0.0) for name in "cdef")
    if kind in (1, 2):
        d, e, f, c = -b / a, c, c, 0.0
    if kind == 0:
        d = -np.inf

    def curve(x: Array) -> Array:
        above = np.maximum(a * x + b, 0.0) ** g + e
        return np.where(x >= d, above, c * x + f)

    return curve
