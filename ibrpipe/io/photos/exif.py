"""What a camera wrote into a photo file about its lens and its position."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ibrpipe.io.photos.exif_tags import attributes_of
from ibrpipe.io.photos.extra_formats import extra_format
from ibrpipe.types import Array

#: Diagonal of a 36 x 24 mm frame, to which "35 mm equivalent" focal lengths refer
_FULL_FRAME = math.hypot(36.0, 24.0)
_MILLIMETRES = {2: 25.4, 3: 10.0, 4: 1.0, 5: 1e-3}
#: tags that are whole numbers
_WHOLE = ("Exif:FocalPlaneResolutionUnit", "Exif:PixelXDimension", "GPS:AltitudeRef")
#: WGS 84: equatorial radius in metres, first eccentricity squared
_RADIUS, _ECCENTRICITY = 6378137.0, 6.69437999014e-3


@dataclass(frozen=True)
class Exif:
    """Lens and GPS position.

    Attributes
    ----------
    focal : float or None
        Focal length in pixels of the file; None = not stated.
    lens : str
        Text that is the same for photos of the same camera at the same focal length; empty = not stated.
    gps : (latitude, longitude, altitude) or None
        Degrees, degrees, metres.
    """

    focal: float | None = None
    lens: str = ""
    gps: tuple[float, float, float] | None = None


def read_exif(path: Path) -> Exif:
    """Read lens and GPS position from a photo's tags; what is missing or nonsense is left out."""
    import OpenImageIO as oiio

    extra = extra_format(path)
    if extra is not None:
        header = extra.header(path)
        spec = oiio.ImageSpec(header.width, header.height, 3, oiio.UINT8)
        for name, value in attributes_of(extra.tags(path)).items():
            _put(spec, name, value)
    else:
        source = oiio.ImageInput.open(str(path))
        if source is None:
            oiio.geterror()  # else it is told when the process ends
            return Exif()
        spec = source.spec()
        source.close()
    words = [spec.get_string_attribute(name, "").strip() for name in ("Make", "Model")]
    millimetres = _number(spec, "Exif:FocalLength")
    equivalent = _number(spec, "Exif:FocalLengthIn35mmFilm")
    stated = [*words, f"{millimetres:g}" if millimetres else "", f"{equivalent:g}" if equivalent else ""]
    lens = " ".join(word for word in stated if word)
    return Exif(_focal_pixels(spec, millimetres, equivalent), lens, _gps(spec))


def _put(spec: Any, name: str, value: Any) -> None:
    """Set an attribute under the type that OpenImageIO itself reads it as."""
    if isinstance(value, tuple):
        spec.attribute(name, f"float[{len(value)}]", value)
    elif name in _WHOLE:
        spec.attribute(name, int(value))
    else:
        spec.attribute(name, value)


def local_metres(positions: Array) -> Array:
    """Turn latitude, longitude, altitude into metres east, north and up of the first position.

    Parameters
    ----------
    positions : (N, 3) float64
        Degrees, degrees, metres above the ellipsoid.

    Returns
    -------
    (N, 3) float64
    """
    latitude, longitude = np.radians(positions[:, 0]), np.radians(positions[:, 1])
    across = _RADIUS / np.sqrt(1.0 - _ECCENTRICITY * np.sin(latitude) ** 2)
    flat = (across + positions[:, 2]) * np.cos(latitude)
    height = (across * (1.0 - _ECCENTRICITY) + positions[:, 2]) * np.sin(latitude)
    earth = np.stack([flat * np.cos(longitude), flat * np.sin(longitude), height], axis=1)
    sin_lat, cos_lat = np.sin(latitude[0]), np.cos(latitude[0])
    sin_lon, cos_lon = np.sin(longitude[0]), np.cos(longitude[0])
    axes = np.array(
        [
            [-sin_lon, cos_lon, 0.0],
            [-sin_lat * cos_lon, -sin_lat * sin_lon, cos_lat],
            [cos_lat * cos_lon, cos_lat * sin_lon, sin_lat],
        ]
    )
    moved: Array = (earth - earth[0]) @ axes.T
    return moved


def _focal_pixels(spec: Any, millimetres: float | None, equivalent: float | None) -> float | None:
    """Return the focal length in pixels from its 35 mm equivalent, else from the density of the sensor's pixels."""
    width, height = spec.full_width or spec.width, spec.full_height or spec.height
    if equivalent is not None:
        return equivalent / _FULL_FRAME * math.hypot(width, height)
    density = _number(spec, "Exif:FocalPlaneXResolution")
    unit = _MILLIMETRES.get(spec.get_int_attribute("Exif:FocalPlaneResolutionUnit", 2))
    if millimetres is None or density is None or unit is None:
        return None
    focal = millimetres * density / unit
    full = spec.get_int_attribute("Exif:PixelXDimension", 0)  # the photo may have been shrunk since
    return focal * max(width, height) / full if full > 0 else focal


def _number(spec: Any, name: str) -> float | None:
    value = spec.get_float_attribute(name, 0.0)
    return float(value) if math.isfinite(value) and value > 0 else None


def _gps(spec: Any) -> tuple[float, float, float] | None:
    latitude = _degrees(spec, "GPS:Latitude", "S")
    longitude = _degrees(spec, "GPS:Longitude", "W")
    if latitude is None or longitude is None:
        return None
    altitude = spec.get_float_attribute("GPS:Altitude", 0.0)
    below = spec.get_int_attribute("GPS:AltitudeRef", 0) == 1
    return latitude, longitude, -altitude if below else altitude


def _degrees(spec: Any, name: str, negative: str) -> float | None:
    parts = spec.getattribute(name)
    if not isinstance(parts, (tuple, list)) or len(parts) != 3:
        return None
    value = float(parts[0]) + float(parts[1]) / 60.0 + float(parts[2]) / 3600.0
    if not math.isfinite(value):
        return None
    return -value if spec.get_string_attribute(f"{name}Ref", "").upper().startswith(negative) else value
