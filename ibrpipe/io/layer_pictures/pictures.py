"""Colours of a layer as a picture: JPEG XL with full chroma, lossless or at a quality."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np

from ibrpipe.errors import FormatError, ResourceError
from ibrpipe.picture_files import one_line
from ibrpipe.types import Array

#: the reader looks at so many bytes before it believes that a file is JPEG XL, and tiny pictures have fewer
_LEAST = 256


def encode_picture(picture: Array, quality: int | None) -> bytes:
    """Return a picture (h, w, 3) uint8 as JPEG XL; quality 1 to 100, None = lossless.

    Raises
    ------
    ResourceError
        It cannot be written.
    """
    import OpenImageIO as oiio

    spec = oiio.ImageSpec(picture.shape[1], picture.shape[0], 3, oiio.UINT8)
    if quality is None:
        spec.attribute("jpegxl:distance", 0.0)
    else:
        spec.attribute("Compression", f"jpegxl:{quality}")
    with tempfile.TemporaryDirectory(prefix="ibrpipe-") as folder:
        path = Path(folder) / "picture.jxl"
        output = oiio.ImageOutput.create(str(path))
        data = np.ascontiguousarray(picture)
        if output is None or not (output.open(str(path), spec) and output.write_image(data) and output.close()):
            reason = one_line(output.geterror() if output else oiio.geterror())
            raise ResourceError(f"a JPEG XL picture cannot be written: {reason}")
        return path.read_bytes()


def decode_picture(data: bytes, shape: tuple[int, int]) -> Array:
    """Return the picture (h, w, 3) uint8 of that shape.

    Raises
    ------
    FormatError
        It is damaged or has another shape.
    """
    import OpenImageIO as oiio

    with tempfile.TemporaryDirectory(prefix="ibrpipe-") as folder:
        path = Path(folder) / "picture.jxl"
        path.write_bytes(data.ljust(_LEAST, b"\0"))
        image = oiio.ImageInput.open(str(path))
        if image is None:
            raise FormatError(f"a picture cannot be read: {one_line(oiio.geterror())}")
        spec = image.spec()
        if (spec.height, spec.width, spec.nchannels) != (*shape, 3):
            raise FormatError(f"a picture is {spec.width} x {spec.height}, {shape[1]} x {shape[0]} belong there")
        found = image.read_image(oiio.UINT8)
        image.close()
    if found is None:
        raise FormatError(f"a picture is damaged: {one_line(image.geterror())}")
    return np.asarray(found)
