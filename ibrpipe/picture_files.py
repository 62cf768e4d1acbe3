"""Linear-light arrays as image files, through OpenImageIO; see :mod:`ibrpipe.io.photos.images` for reading."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ibrpipe.core.color import srgb_encode, to_bytes
from ibrpipe.errors import FormatError, ResourceError, ShapeError

Array = NDArray[Any]
#: names of colour spaces in OpenColorIO's built-in config
LINEAR, SRGB = "lin_rec709_scene", "srgb_rec709_scene"
#: OpenImageIO stamps the time of writing into EXR files unless one is given; equal input must give equal bytes
FIXED_DATE = "2000:01:01 00:00:00"


def write_png(path: Path, linear: Array, alpha: Array | None = None) -> None:
    """Write linear Rec.709 colour as an 8-bit sRGB PNG.

    Parameters
    ----------
    path : Path
    linear : (H, W, 3) or (H, W) float
        Clipped to 0..1.
    alpha : (H, W) float, optional
        Coverage 0..1, written as straight (not premultiplied) alpha.
    """
    _check_picture(linear)
    planes = [to_bytes(srgb_encode(_three_axes(linear)))]
    if alpha is not None:
        planes.append(to_bytes(alpha)[:, :, None])
    _write(path, np.concatenate(planes, axis=2), {"oiio:ColorSpace": SRGB, "oiio:UnassociatedAlpha": 1})


def write_exr(path: Path, channels: Mapping[str, Array] | Array, half: bool = False) -> None:
    """Write float channels as a ZIP-compressed OpenEXR file, linear Rec.709.

    Parameters
    ----------
    path : Path
    channels : mapping of name to (H, W) float, or (H, W[, C]) float
        An array of 1, 2, 3, 4 channels is named Y, YA, RGB, RGBA. Alpha is taken as premultiplied, as EXR defines it.
    half : bool
        Store 16-bit floats.
    """
    if not isinstance(channels, Mapping):
        _check_picture(channels)
        picture = _three_axes(channels)
        names = {1: "Y", 2: "YA", 3: "RGB", 4: "RGBA"}.get(picture.shape[2])
        if names is None:
            raise ShapeError(f"an array of {picture.shape[2]} channels needs names; pass a mapping of name to array")
        channels = {name: picture[:, :, i] for i, name in enumerate(names)}
    shapes = {np.shape(plane) for plane in channels.values()}
    if len(shapes) != 1 or len(next(iter(shapes))) != 2:
        raise ShapeError(f"channels must all be (H, W) of one size, got {sorted(shapes)}")
    stack = np.stack([np.asarray(plane, np.float32) for plane in channels.values()], axis=2)
    attributes = {"oiio:ColorSpace": LINEAR, "compression": "zip", "DateTime": FIXED_DATE}
    _write(path, stack, attributes, list(channels), "half" if half else "float")


def write_hdr(path: Path, linear: Array) -> None:
    """Write linear Rec.709 light (H, W, 3) as a Radiance HDR file.

    Parameters
    ----------
    path : Path
        Ends in .hdr.
    linear : (H, W, 3) float
        0 and more.
    """
    _check_picture(linear)
    _write(path, np.asarray(linear, np.float32), {"oiio:ColorSpace": LINEAR}, ["R", "G", "B"], "float")


def _check_picture(picture: Array) -> None:
    if np.ndim(picture) not in (2, 3) or np.size(picture) == 0:
        raise ShapeError(f"a picture must be (H, W) or (H, W, C) and not empty, got {np.shape(picture)}")


def _three_axes(picture: Array) -> Array:
    array = np.asarray(picture)
    return array[:, :, None] if array.ndim == 2 else array


def _write(
    path: Path, pixels: Array, attributes: Mapping[str, Any], names: list[str] | None = None, kind: str | None = None
) -> None:
    import OpenImageIO as oiio

    height, width, channels = pixels.shape
    spec = oiio.ImageSpec(width, height, channels, kind or str(pixels.dtype))
    if names:
        spec.channelnames = tuple(names)
    elif channels in (2, 4):
        spec.alpha_channel = channels - 1
    for key, value in attributes.items():
        spec.attribute(key, value)
    target = oiio.ImageOutput.create(str(path))
    if target is None:
        raise FormatError(f"{path}: no writer for this kind of file ({one_line(oiio.geterror())})")
    written = target.open(str(path), spec) and target.write_image(np.ascontiguousarray(pixels)) and target.close()
    if not written:
        raise ResourceError(f"{path}: cannot be written ({one_line(target.geterror())}); check the disk and the folder")


def one_line(text: str) -> str:
    """Join the lines of a library's message."""
    return "; ".join(line.strip() for line in text.splitlines() if line.strip())
