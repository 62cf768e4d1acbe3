"""A digital negative, written from Adobe's DNG specification 1.4: one strip of 16-bit samples, RGGB."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np

#: the sensor's colours are those of Rec.709: camera from XYZ is sRGB's own matrix, so nothing is mixed
CAMERA_FROM_XYZ = (3.2405, -1.5371, -0.4985, -0.9693, 1.8760, 0.0416, 0.0556, -0.2040, 1.0572)
BLACK, WHITE = 1024, 17408
BYTES, TEXT, SHORT, LONG, RATIONAL, SIGNED = 1, 2, 3, 4, 5, 10
Entry = tuple[int, int, int, bytes]


def write_dng(path: Path, light: np.ndarray, neutral: tuple[float, float, float], orientation: int = 1) -> None:
    """Write linear light (H, W, 3), 0 to 1, as a sensor sees it that needs the gains 1 / `neutral`."""
    sensor = np.rint(light * np.array(neutral) * (WHITE - BLACK) + BLACK).astype("<u2")
    mosaic = sensor[:, :, 1].copy()
    mosaic[0::2, 0::2], mosaic[1::2, 1::2] = sensor[0::2, 0::2, 0], sensor[1::2, 1::2, 2]
    notes = [fraction(33434, 1, 50), fraction(33437, 4, 1), short(34855, 200), fraction(37386, 35, 1), short(41989, 52)]
    first = lambda strip, exif: [  # noqa: E731
        *(long(254, 0), long(256, mosaic.shape[1]), long(257, mosaic.shape[0]), short(258, 16), short(259, 1)),
        *(short(262, 32803), text(271, b"Maker"), text(272, b"Model"), long(273, strip), short(274, orientation)),
        *(short(277, 1), long(278, mosaic.shape[0]), long(279, mosaic.nbytes), (33421, SHORT, 2, b"\2\0\2\0")),
        *((33422, BYTES, 4, bytes([0, 1, 1, 2])), long(34665, exif), (50706, BYTES, 4, bytes([1, 4, 0, 0]))),
        *(text(50708, b"Maker Model"), long(50714, BLACK), long(50717, WHITE), signed(50721, CAMERA_FROM_XYZ)),
        *((50728, RATIONAL, 3, fractions(neutral, "<II")), short(50778, 21)),
    ]
    exif = 8 + len(folder(first(0, 0), 8))
    strip = exif + len(folder(notes, exif))
    content = b"II*\0" + struct.pack("<I", 8) + folder(first(strip, exif), 8) + folder(notes, exif) + mosaic.tobytes()
    path.write_bytes(content)


def folder(entries: list[Entry], start: int) -> bytes:
    """Return an image file directory that begins at `start`, its longer values behind it."""
    head, tail, place = struct.pack("<H", len(entries)), b"", start + 2 + 12 * len(entries) + 4
    for tag, kind, count, value in entries:
        head += struct.pack("<HHI", tag, kind, count)
        head += value.ljust(4, b"\0") if len(value) <= 4 else struct.pack("<I", place + len(tail))
        tail += b"" if len(value) <= 4 else value + b"\0" * (len(value) % 2)
    return head + struct.pack("<I", 0) + tail


def short(tag: int, value: int) -> Entry:
    return tag, SHORT, 1, struct.pack("<H", value)


def long(tag: int, value: int) -> Entry:
    return tag, LONG, 1, struct.pack("<I", value)


def text(tag: int, value: bytes) -> Entry:
    return tag, TEXT, len(value) + 1, value + b"\0"


def fraction(tag: int, over: int, under: int) -> Entry:
    return tag, RATIONAL, 1, struct.pack("<II", over, under)


def signed(tag: int, values: tuple[float, ...]) -> Entry:
    return tag, SIGNED, len(values), fractions(values, "<ii")


def fractions(values: tuple[float, ...], form: str) -> bytes:
    return b"".join(struct.pack(form, round(value * 10000), 10000) for value in values)
