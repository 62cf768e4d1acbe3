"""EXIF tags by name, of files that OpenImageIO does not read."""

from __future__ import annotations

from pathlib import Path
from typing import Any

_EXIF, _GPS = 0x8769, 0x8825
_NAMES = {
    0x010F: "Make",
    0x0110: "Model",
    0x829A: "ExposureTime",
    0x829D: "FNumber",
    0x8827: "PhotographicSensitivity",
    0x920A: "FocalLength",
    0xA405: "FocalLengthIn35mmFilm",
    0xA20E: "FocalPlaneXResolution",
    0xA210: "FocalPlaneResolutionUnit",
    0xA002: "PixelXDimension",
}
_GPS_NAMES = {1: "LatitudeRef", 2: "Latitude", 3: "LongitudeRef", 4: "Longitude", 5: "AltitudeRef", 6: "Altitude"}
#: names as OpenImageIO has them, where they are not ``Exif:`` and the name
_PLAIN = ("Make", "Model", "ExposureTime", "FNumber")


def tags_of_bytes(block: bytes) -> dict[str, Any]:
    """Return the tags of an EXIF block by name; empty where it is none."""
    from PIL import Image

    exif = Image.Exif()
    try:
        exif.load(block)
        return _named(exif)
    except Exception:  # a damaged block says nothing; the photo itself may be sound
        return {}


def tags_of_file(path: Path) -> dict[str, Any]:
    """Return the tags of a file that is laid out as TIFF, as most raw files are; empty for any other."""
    from PIL import Image

    exif = Image.Exif()
    try:
        with path.open("rb") as file:
            exif.load_from_fp(file)
            return _named(exif)
    except Exception:
        return {}


def exposure_of(tags: dict[str, Any]) -> dict[str, float]:
    """Return the figures of the exposure under the names that `ImageHeader` has for them."""
    names = {"ExposureTime": "ExposureTime", "FNumber": "FNumber"}
    names["PhotographicSensitivity"] = "Exif:PhotographicSensitivity"
    return {wanted: tags[name] for name, wanted in names.items() if name in tags}


def attributes_of(tags: dict[str, Any]) -> dict[str, Any]:
    """Return the tags under the names that OpenImageIO has for them."""
    return {name if name in _PLAIN or ":" in name else f"Exif:{name}": value for name, value in tags.items()}


def _named(exif: Any) -> dict[str, Any]:
    known = {**dict(exif), **exif.get_ifd(_EXIF)}
    tags = {name: _plain(known[number]) for number, name in _NAMES.items() if number in known}
    place = exif.get_ifd(_GPS)
    return tags | {f"GPS:{name}": _plain(place[number]) for number, name in _GPS_NAMES.items() if number in place}


def _plain(value: Any) -> Any:
    """Return text, a number or a tuple of numbers; rationals are divided."""
    if isinstance(value, bytes):
        return int.from_bytes(value, "little") if len(value) == 1 else value.decode("latin-1")
    if isinstance(value, tuple):
        return tuple(float(each) for each in value)
    return value if isinstance(value, str) else float(value)
