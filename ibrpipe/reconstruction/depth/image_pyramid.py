"""Photos as matching sees them: grey in display code, valid pixels, at several sizes.

Prepared pictures are kept in a cache of at most `CACHE_BYTES`; the least recently used ones go first.
"""

from __future__ import annotations

import threading
from collections import OrderedDict
from dataclasses import dataclass

import numpy as np

from ibrpipe.core.color import luminance, srgb_encode
from ibrpipe.io.views import View, load_view
from ibrpipe.types import Array, Camera

CACHE_BYTES = 512 << 20
#: brightest share of a photo's valid pixels that may exceed full scale, percent
CLIPPED = 0.1


@dataclass(frozen=True, eq=False)
class Picture:
    """A photo ready for matching.

    Attributes
    ----------
    camera : Camera
        At the picture's size.
    grey : (H, W) float32
        0..255, display code, the photo's own range stretched to full scale.
    valid : (H, W) uint8
        1 where the photo's mask is at least one half.
    words : (H * W,) uint32
        Bytes of a pixel and its right, lower, and lower right neighbour, from low to high.
    """

    camera: Camera
    grey: Array
    valid: Array
    words: Array

    @property
    def lens(self) -> Array:
        """fx, fy, cx, cy, (4,) float64."""
        K = self.camera.K
        return np.array([K[0, 0], K[1, 1], K[0, 2], K[1, 2]])

    @property
    def nbytes(self) -> int:
        """Bytes of the arrays."""
        return self.grey.nbytes + self.valid.nbytes + self.words.nbytes


_LOCK = threading.Lock()
_CACHE: OrderedDict[tuple[object, ...], Picture] = OrderedDict()


def picture_of(view: View, width: int, height: int) -> Picture:
    """Return the picture of a view at a size, from the cache or prepared now."""
    status = view.image.stat()
    key = (str(view.image), status.st_mtime_ns, status.st_size, str(view.mask), *view.factors.tolist(), width, height)
    with _LOCK:
        if key in _CACHE:
            _CACHE.move_to_end(key)
            return _CACHE[key]
    made = _prepared(view, width, height)
    with _LOCK:
        _CACHE[key] = made
        while sum(each.nbytes for each in _CACHE.values()) > CACHE_BYTES and len(_CACHE) > 1:
            _CACHE.popitem(last=False)
    return made


def forget_pictures() -> None:
    """Empty the cache."""
    with _LOCK:
        _CACHE.clear()


def _prepared(view: View, width: int, height: int) -> Picture:
    colour, mask = load_view(view)
    grey = srgb_encode(luminance(colour), np.inf)
    if mask.shape != (height, width):
        import cv2

        grey = cv2.resize(grey, (width, height), interpolation=cv2.INTER_AREA)
        mask = cv2.resize(mask, (width, height), interpolation=cv2.INTER_AREA)
    valid = (mask >= 0.5).astype(np.uint8)
    top = np.percentile(grey[valid > 0], 100 - CLIPPED) if valid.any() else 1.0
    grey = np.clip(grey * np.float32(255.0 / max(top, 1e-6)), 0.0, 255.0).astype(np.float32)
    return Picture(view.camera.resized(width, height), grey, valid, packed(grey))


def packed(grey: Array) -> Array:
    """Pack grey (H, W) 0..255 to words (H * W,) uint32 of a pixel and its three neighbours right and below."""
    codes = np.pad(np.rint(grey).astype(np.uint32), ((0, 1), (0, 1)), mode="edge")
    words = codes[:-1, :-1] | codes[:-1, 1:] << 8 | codes[1:, :-1] << 16 | codes[1:, 1:] << 24
    return words.astype(np.uint32).ravel()
