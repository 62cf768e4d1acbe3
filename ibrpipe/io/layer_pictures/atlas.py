"""All layers of a texture in one picture, so that a codec learns from all of them and its head is paid once."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from ibrpipe.io.layer_pictures.avif import LONGEST
from ibrpipe.io.layer_pictures.planes import Plane
from ibrpipe.types import Array

#: no atlas has more texels
MOST_TEXELS = 2**28


def pack(sizes: Sequence[tuple[int, ...]]) -> tuple[list[tuple[int, int]], tuple[int, int]]:
    """Pack boxes (height, width) in rows of about a square, each row as high as its highest box.

    Returns
    -------
    corners : list of (row, column), of the boxes
    shape : (height, width) of the whole
    """
    area = sum(height * width for height, width in sizes)
    width = max([1, math.ceil(math.sqrt(area)), *(size[1] for size in sizes)])
    corners: list[tuple[int, int]] = []
    x, y, row = 0, 0, 0
    for high, wide in sizes:
        if x + wide > width:
            x, y, row = 0, y + row, 0
        corners.append((y, x))
        x, row = x + wide, max(row, high)
    return corners, (max(y + row, 1), width)


def fits(shape: tuple[int, int]) -> bool:
    """Say whether codecs take a picture as large."""
    return max(shape) <= LONGEST and shape[0] * shape[1] <= MOST_TEXELS


class Atlas:
    """Where the boxes of the layers lie in a picture: in rows, each as high as its highest box.

    Several numbers of a sample lie beside each other: all layers with the first, then all with the second.

    Attributes
    ----------
    shape : (height, width)
    fits : bool
        Whether codecs take a picture as large.
    """

    def __init__(self, planes: Sequence[Plane], numbers: int = 1) -> None:
        self._planes, self._numbers = planes, numbers
        sizes = [plane.there.shape for _ in range(numbers) for plane in planes]
        self._corners, self.shape = pack(sizes)
        self.fits = fits(self.shape)

    def spread(self, codes: Array) -> Array:
        """Return the picture (h, w, 3) of colours (S, 3), or (h, w) of numbers (S, numbers), all uint8.

        Texels without a sample carry smoothly continued codes.
        """
        from ibrpipe.io.residuals import continue_smoothly

        colored = self._numbers == 1 and codes.shape[1] == 3
        picture, there = np.zeros((*self.shape, 3), np.uint8), np.zeros(self.shape, bool)
        for number, plane, window in self._windows():
            picture[window][plane.there] = codes[plane.samples] if colored else codes[plane.samples, number, None]
            there[window] = plane.there
        full = continue_smoothly(picture, there)
        return full if colored else full[:, :, 0]

    def gather(self, picture: Array) -> Array:
        """Return the codes (S, 3) or (S, numbers) uint8 of all samples in a picture that `spread` made."""
        count = sum(len(plane.samples) for plane in self._planes)
        codes = np.zeros((count, 3 if picture.ndim == 3 else self._numbers), np.uint8)
        for number, plane, window in self._windows():
            part = picture[window][plane.there]
            if picture.ndim == 3:
                codes[plane.samples] = part
            else:
                codes[plane.samples, number] = part
        return codes

    def _windows(self) -> Iterator[tuple[int, Plane, tuple[slice, slice]]]:
        """Yield which number, which layer, and where they lie."""
        for box, (y, x) in enumerate(self._corners):
            number, layer = divmod(box, len(self._planes))
            plane = self._planes[layer]
            height, width = plane.there.shape
            yield number, plane, (slice(y, y + height), slice(x, x + width))
