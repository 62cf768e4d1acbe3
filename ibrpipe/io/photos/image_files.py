"""Image files as they are stored: headers, and pixels without any conversion, through OpenImageIO."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import Any

import numpy as np

from ibrpipe.errors import FormatError, MissingFileError
from ibrpipe.io.photos.channel_names import best_part, plain_names
from ibrpipe.io.photos.extra_formats import extra_format
from ibrpipe.io.photos.image_header import ImageHeader as ImageHeader
from ibrpipe.io.untrusted.boundary import reader
from ibrpipe.picture_files import LINEAR, SRGB, one_line
from ibrpipe.types import Array

#: pixels of an image at the most; pixels that its display window may have for one that is stored, or in any case
MOST_PIXELS, MOST_EMPTY, LEAST_WINDOW = 1 << 29, 16, 1 << 24
#: Words in an ICC profile's description -> name of the colour space in OpenColorIO's built-in config
_PROFILES = {"adobe rgb": "AdobeRGB", "display p3": "srgb_p3d65_scene", "srgb": SRGB}
#: EXIF orientation -> quarter turns counter-clockwise, then mirrored left to right
_TURNS = {
    1: (0, False),
    2: (0, True),
    3: (2, False),
    4: (2, True),
    5: (3, True),
    6: (3, False),
    7: (1, True),
    8: (1, False),
}


@reader("export it again")
def read_header(path: Path) -> ImageHeader:
    """Read size, channels, orientation, colour space and exposure figures of an image file.

    Raises
    ------
    MissingFileError, FormatError
        The file does not exist, or is no image that can be read.
    ResourceError
        It takes a package that is not installed.
    """
    extra = extra_format(path)
    if extra is not None:
        _check_name(path)
        return extra.header(path)
    source = _open(path)
    _seek_part(source, "R")
    header = _header(path, source.spec())
    source.close()
    return header


@reader("export it again")
def read_stored(path: Path, wanted: str = "R") -> tuple[Array, ImageHeader]:
    """Read all channels as stored, on the display window, (H, W, C); of several parts the one with a wanted channel."""
    extra = extra_format(path)
    if extra is not None:
        _check_name(path)
        return extra.stored(path)
    source = _open(path)
    _seek_part(source, wanted)
    spec = source.spec()
    header = _header(path, spec)
    if spec.deep:
        raise FormatError(f"{path}: holds deep pixels; expected an ordinary image")
    pixels = source.read_image(source.current_subimage(), 0, 0, spec.nchannels, spec.format)
    problem = one_line(source.geterror())
    source.close()
    if pixels is None or problem:
        raise FormatError(f"{path}: the image is damaged ({problem or 'no pixels'}); copy or export it again")
    pixels = np.asarray(pixels).reshape(spec.height, spec.width, spec.nchannels)
    if (spec.x, spec.y, spec.width, spec.height) == (spec.full_x, spec.full_y, header.width, header.height):
        return pixels, header
    return _on_display_window(pixels, spec), header


def turned(picture: Array, orientation: int) -> Array:
    """Obey an EXIF orientation 1..8."""
    quarter_turns, mirrored = _TURNS[orientation]
    turned = np.rot90(picture, quarter_turns)
    return np.ascontiguousarray(turned[:, ::-1] if mirrored else turned)


def _open(path: Path) -> Any:
    import OpenImageIO as oiio

    _check_name(path)
    if not path.is_file():
        raise MissingFileError(f"{path}: the image does not exist")
    hints = oiio.ImageSpec()
    hints.attribute("oiio:UnassociatedAlpha", 1)
    hints.attribute("oiio:reorient", 0)
    source = oiio.ImageInput.open(str(path), hints)
    if source is None:
        reason = one_line(oiio.geterror())
        raise FormatError(f"{path}: cannot be read as an image ({reason}); export it again as JPEG, PNG, TIFF or EXR")
    return source


def _check_size(path: Path, spec: Any) -> None:
    """Refuse sizes that no photo has, and display windows that are all but empty, before memory is taken for them."""
    stored, shown = spec.width * spec.height, spec.full_width * spec.full_height
    if max(stored, shown) > MOST_PIXELS or shown > MOST_EMPTY * stored + LEAST_WINDOW:
        raise FormatError(
            f"{path}: claims {spec.full_width} x {spec.full_height} pixels and holds {spec.width} x {spec.height}; at "
            f"most {MOST_PIXELS >> 20} megapixels are read, and few empty ones: cut or export it again"
        )


def _seek_part(source: Any, wanted: str) -> None:
    """Go to the part of an OpenEXR file that holds the picture, or depth; the first one where none does.

    A part of the whole picture comes first (`best_part`); other files with several pictures stay at their first one.
    """
    if source.format_name() != "openexr" or source.spec().get_int_attribute("oiio:subimages", 1) < 2:
        return
    parts: list[tuple[str, tuple[str, ...]]] = []
    while source.seek_subimage(len(parts), 0):
        spec = source.spec()
        parts.append((spec.get_string_attribute("oiio:subimagename", ""), tuple(spec.channelnames)))
    source.geterror()  # the one of going beyond the last
    source.seek_subimage(best_part(parts, wanted), 0)


def _check_name(path: Path) -> None:
    """Refuse names that the libraries below cannot open, and that no text file could hold."""
    name, encoding = str(path), sys.getfilesystemencoding().lower()
    if name.isascii():
        return
    shown = os.fsencode(path).decode("utf-8", "backslashreplace")
    if encoding not in ("utf-8", "utf8"):
        raise FormatError(f"{shown}: Python takes file names as {encoding} here; set PYTHONUTF8=1, or rename the file")
    try:
        name.encode("utf-8")
    except UnicodeEncodeError as error:
        remedy = "rename it, for instance with `convmv -f latin1 -t utf8 --notest`"
        raise FormatError(f"{shown}: the name of the file or of a folder is not UTF-8; {remedy}") from error


def _header(path: Path, spec: Any) -> ImageHeader:
    _check_size(path, spec)
    integer = str(spec.format) not in ("half", "float", "double")
    metadata = {}
    for key in ("ExposureTime", "FNumber", "Exif:PhotographicSensitivity"):
        value = spec.get_float_attribute(key, float("nan"))
        if np.isfinite(value):
            metadata[key] = float(value)
    orientation = spec.get_int_attribute("Orientation", 1)
    return ImageHeader(
        spec.full_width or spec.width,
        spec.full_height or spec.height,
        plain_names(tuple(spec.channelnames)),
        integer,
        orientation if 1 <= orientation <= 8 else 1,
        *_declared(spec, integer, metadata),
    )


def _declared(spec: Any, integer: bool, metadata: dict[str, float]) -> tuple[str, dict[str, float], bytes | None]:
    """Name of the colour space; `metadata`; the ICC profile where no name says the same."""
    named = spec.get_string_attribute("oiio:ColorSpace", "") or (SRGB if integer else LINEAR)
    description = spec.get_string_attribute("ICCProfile:profile_description", "").lower()
    for words, name in _PROFILES.items():
        if words in description:
            return name, metadata, None
    stored = spec.getattribute("ICCProfile")
    return named, metadata, None if stored is None else np.asarray(stored, np.uint8).tobytes()


def _on_display_window(pixels: Array, spec: Any) -> Array:
    """Place the stored data window on the display window; zeros where nothing is stored."""
    full = np.zeros((spec.full_height, spec.full_width, pixels.shape[2]), pixels.dtype)
    top, left = spec.y - spec.full_y, spec.x - spec.full_x
    rows = slice(max(top, 0), min(top + spec.height, spec.full_height))
    columns = slice(max(left, 0), min(left + spec.width, spec.full_width))
    full[rows, columns] = pixels[rows.start - top : rows.stop - top, columns.start - left : columns.stop - left]
    return full
