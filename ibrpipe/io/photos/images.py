"""Image files to linear-light arrays and back, through OpenImageIO.

Inside, colour is linear light with Rec.709 primaries (float32). What a file declares (or its kind implies: integers are
sRGB, floats are linear) is converted on reading; alpha and masks are plain coverage and never converted.
"""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from ibrpipe.core.color import decode_table
from ibrpipe.errors import FormatError
from ibrpipe.io.photos.coverage import coverage_of
from ibrpipe.io.photos.icc import Profile, read_profile
from ibrpipe.io.photos.image_files import read_stored, turned
from ibrpipe.io.untrusted.arrays import load_npy
from ibrpipe.io.untrusted.boundary import reader
from ibrpipe.picture_files import LINEAR, SRGB, one_line
from ibrpipe.picture_files import write_exr as write_exr
from ibrpipe.picture_files import write_hdr as write_hdr
from ibrpipe.picture_files import write_png as write_png
from ibrpipe.types import Array

#: What renderers store in depth maps where nothing is: this or more, and the largest half float
NOWHERE, HALF_MAX = 1e9, 65504.0


@reader("export it again")
def read_image(path: Path, color_space: str | None = None, oriented: bool = True) -> Array:
    """Read an image as linear light.

    Parameters
    ----------
    path : Path
    color_space : str, optional
        Name of the space its colours are in (an OpenColorIO name such as ``srgb_rec709_scene``, ``lin_rec709_scene``,
        ``AdobeRGB``); by default what the file declares, else sRGB for integers and linear for floats.
    oriented : bool
        Obey the orientation tag, so that the picture stands upright.

    Returns
    -------
    (H, W, C) float32
        Linear Rec.709 colour, not premultiplied; C = 1 (grey), 2 (grey, alpha), 3 or 4 (with alpha).

    Raises
    ------
    MissingFileError, FormatError
        The file is missing, damaged, not an image, or in an unknown colour space.
    """
    pixels, header = read_stored(path)
    names = _colour_channels(header.channels)
    chosen = [header.channels.index(name) for name in names]
    pixels = np.ascontiguousarray(pixels[:, :, chosen])
    colours = len(names) - header.has_alpha
    profile = None if color_space or header.profile is None else _profile(header.profile, colours, path)
    linear = _linear(pixels, colours, LINEAR if profile else color_space or header.color_space, path)
    if profile is not None:
        linear[:, :, :colours] = profile.linear(linear[:, :, :colours])
    if header.has_alpha and not header.integer:
        _unpremultiply(linear)
    return turned(linear, header.orientation) if oriented else linear


@reader("export it again")
def read_coverage(path: Path, oriented: bool = True) -> Array:
    """Read a mask file as plain values in 0..1; see `coverage_of`."""
    pixels, header = read_stored(path)
    plane = coverage_of(pixels, header, lossy=path.suffix.lower() in (".jpg", ".jpeg", ".webp"))
    return np.ascontiguousarray(turned(plane, header.orientation) if oriented else plane)


@reader("export it again")
def read_depth(path: Path) -> Array:
    """Read a depth map (EXR or other float image, .npy, 16-bit PNG): (H, W) float32, scene units along camera z.

    16-bit files are those of RGB-D cameras: millimetres, of a scene in metres.

    Zero, negative, NaN and infinite entries mean "nothing there" and come back as +inf; so do what renderers write for
    it, 1e10 and, in half floats, the largest of them, 65504.
    """
    if path.suffix.lower() == ".npy":
        depth = load_npy(path)
    else:
        pixels, header = read_stored(path, "Z")
        depth = pixels[:, :, header.channels.index("Z") if "Z" in header.channels else 0]
        if "Z" not in header.channels and _in_colour(pixels, header.channels):
            raise FormatError(f"{path}: holds colours and no depth; expected a channel Z or V")
        if header.integer:
            if depth.dtype != np.uint16:
                raise FormatError(
                    f"{path}: depth is stored as {depth.dtype} integers; expected float EXR or .npy in scene units, or "
                    "16-bit PNG in millimetres"
                )
            depth = depth.astype(np.float32) / np.float32(1000.0)
    depth = np.squeeze(depth)
    if depth.ndim != 2 or not np.issubdtype(depth.dtype, np.floating):
        raise FormatError(f"{path}: depth must be a float array (H, W), got {depth.dtype} {depth.shape}")
    depth = depth.astype(np.float32)
    there = np.isfinite(depth) & (depth > 0) & (depth < NOWHERE) & (depth != HALF_MAX)
    return np.where(there, depth, np.float32(np.inf))


def _in_colour(pixels: Array, names: tuple[str, ...]) -> bool:
    """Whether R, G, B of a float file differ: such a file is no depth map."""
    if not {"R", "G", "B"} <= set(names) or np.issubdtype(pixels.dtype, np.integer):
        return False
    red, green, blue = (pixels[:, :, names.index(name)] for name in "RGB")
    return not (np.array_equal(red, green, equal_nan=True) and np.array_equal(red, blue, equal_nan=True))


def _colour_channels(names: tuple[str, ...]) -> list[str]:
    """Names of the grey or RGB channels, then A where present; the first channel if nothing is called so."""
    colours = ["R", "G", "B"] if {"R", "G", "B"} <= set(names) else [("Y" if "Y" in names else names[0])]
    return colours + (["A"] if "A" in names else [])


def _linear(pixels: Array, colours: int, space: str, path: Path) -> Array:
    """Convert the first `colours` channels to linear Rec.709 and the rest to 0..1; float32."""
    levels = np.iinfo(pixels.dtype).max + 1 if np.issubdtype(pixels.dtype, np.integer) else 0
    config = _color_config()
    if config.getColorSpaceIndex(space) < 0:
        raise FormatError(f"{path}: unknown colour space {space!r}; expected a name such as {SRGB}, {LINEAR}, AdobeRGB")
    if levels and config.equivalent(space, SRGB):
        linear = _table(levels)[pixels]
        linear[:, :, colours:] = pixels[:, :, colours:] / np.float32(levels - 1)
        return linear
    linear = pixels.astype(np.float32) / np.float32(levels - 1) if levels else pixels.astype(np.float32)
    if not config.equivalent(space, LINEAR):
        linear[:, :, :colours] = _converted(linear[:, :, :colours], space, path)
    return linear


def _profile(data: bytes, colours: int, path: Path) -> Profile | None:
    try:
        return read_profile(data, colours)
    except FormatError as error:
        raise FormatError(f"{path}: {error}") from error


@lru_cache(maxsize=1)
def _color_config() -> Any:
    """OpenColorIO's built-in config, whatever the environment says: results must not depend on it."""
    import OpenImageIO as oiio

    return oiio.ColorConfig("ocio://default")


@lru_cache(maxsize=2)
def _table(levels: int) -> Array:
    return decode_table(levels)


def _converted(colour: Array, space: str, path: Path) -> Array:
    """Convert (H, W, 1 or 3) from a named space to linear Rec.709 through OpenColorIO's built-in config."""
    import OpenImageIO as oiio

    buffer = oiio.ImageBuf(np.ascontiguousarray(np.broadcast_to(colour, (*colour.shape[:2], 3))))
    result = oiio.ImageBufAlgo.colorconvert(buffer, space, LINEAR, colorconfig="ocio://default")
    if result.has_error:
        raise FormatError(f"{path}: colours do not convert from {space!r} ({one_line(result.geterror())})")
    return np.asarray(result.get_pixels(oiio.FLOAT))[:, :, : colour.shape[2]]


def _unpremultiply(linear: Array) -> None:
    alpha = linear[:, :, -1:]
    np.divide(linear[:, :, :-1], alpha, out=linear[:, :, :-1], where=alpha > 0)
