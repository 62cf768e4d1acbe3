"""Lossy pictures as AVIF: one or three channels of 8 bits, full chroma, tuned for the least squares of errors."""

from __future__ import annotations

import io
import warnings

import numpy as np

from ibrpipe.errors import FormatError, ResourceError
from ibrpipe.picture_files import one_line
from ibrpipe.types import Array

#: longest edge that decoders take
LONGEST = 32767
#: speeds of the encoder: of a trial, and of what is kept: 4 % to 15 % fewer bytes at the same error, five times slower
QUICK, THOROUGH = 6, 4
#: by default libaom serves the eye, at twice the bytes for the same squares of errors
_TUNED = {"tune": "psnr"}


def encode_avif(picture: Array, quality: int, speed: int = QUICK, half_chroma: bool = False) -> bytes:
    """Return a picture (h, w) or (h, w, 3) uint8 as AVIF, the same bytes on any machine with the same libraries.

    Parameters
    ----------
    quality : int
        0 to 100.
    speed : int
        0 (thorough) to 10.
    half_chroma : bool
        Keep chroma at half the resolution.

    Raises
    ------
    ResourceError
        Pillow was built without AVIF.
    """
    from PIL import Image

    buffer = io.BytesIO()
    chroma = "4:0:0" if picture.ndim == 2 else "4:2:0" if half_chroma else "4:4:4"
    options = {"quality": quality, "subsampling": chroma, "speed": speed, "max_threads": 1, "codec": "aom"}
    try:
        Image.fromarray(np.ascontiguousarray(picture)).save(buffer, "AVIF", **options, advanced=_TUNED)
    except (KeyError, OSError, ValueError) as error:
        raise ResourceError(
            f"an AVIF picture cannot be written: {one_line(str(error))}; install Pillow 11.3 or later from PyPI"
        ) from error
    return buffer.getvalue()


def decode_avif(data: bytes, shape: tuple[int, ...]) -> Array:
    """Return the picture uint8 of that shape, (h, w) or (h, w, 3).

    Raises
    ------
    FormatError
        It is damaged or has another shape.
    """
    from PIL import Image

    wanted = "L" if len(shape) == 2 else "RGB"
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)  # its size is checked here
            image = Image.open(io.BytesIO(data), formats=("AVIF",))
        if image.size != (shape[1], shape[0]) or image.mode != wanted:
            raise FormatError(
                f"a picture is {image.mode} {image.width} x {image.height}, "
                f"{wanted} {shape[1]} x {shape[0]} belongs there"
            )
        return np.asarray(image)
    except FormatError:
        raise
    except (OSError, SyntaxError, ValueError, Image.DecompressionBombError) as error:
        raise FormatError(f"a picture is damaged: {one_line(str(error))}") from error
