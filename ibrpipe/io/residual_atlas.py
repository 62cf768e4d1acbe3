"""Residual images of one texture as one AVIF picture: all directions in rows, continued where they see nothing.

Where an image sees nothing, nothing is kept: a reader takes the continued residual as if it had been seen. Which texels
were valid would take more bytes than the residuals themselves, and buys nothing.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ibrpipe.io.layer_pictures.atlas import fits, pack
from ibrpipe.io.layer_pictures.avif import decode_avif, encode_avif
from ibrpipe.types import Array

#: these pictures are coded by so much faster than others, because they are so many times larger
FASTER = 2


def pack_images(texels: Array, valid: Array, sizes: Array, zero: int, quality: int, speed: int) -> bytes | None:
    """Return images of sizes (n, 2), texels (T, 3) uint8 and valid (T,), as one picture; None = too large."""
    from ibrpipe.io.residuals import continue_smoothly

    shape = pack(_shapes(sizes))[1]
    if not fits(shape):
        return None
    picture = np.full((*shape, 3), zero, np.uint8)
    for own, window in _windows(sizes):
        size = picture[window].shape[:2]
        there = valid[own].reshape(size)
        if there.any():
            picture[window] = continue_smoothly(texels[own].reshape(*size, 3), there)
    return encode_avif(picture, quality, min(speed + FASTER, 10))


def unpack_images(data: bytes, sizes: Array) -> Array:
    """Return the texels (T, 3) uint8 of images of sizes (n, 2), one after another.

    Raises
    ------
    FormatError
        The picture is damaged or belongs to other images.
    """
    picture = decode_avif(data, (*pack(_shapes(sizes))[1], 3))
    texels = np.empty((int(sizes.astype(np.int64).prod(axis=1).sum()), 3), np.uint8)
    for own, window in _windows(sizes):
        texels[own] = picture[window].reshape(-1, 3)
    return texels


def _shapes(sizes: Array) -> list[tuple[int, ...]]:
    return [(int(height), int(width)) for height, width in sizes]


def _windows(sizes: Array) -> Iterator[tuple[slice, tuple[slice, slice]]]:
    """Yield the texels of every image and where they lie in the picture."""
    shapes, end = _shapes(sizes), 0
    for (y, x), (height, width) in zip(pack(shapes)[0], shapes, strict=True):
        yield slice(end, end + height * width), (slice(y, y + height), slice(x, x + width))
        end += height * width
