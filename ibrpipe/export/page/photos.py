"""Photos in pages: small, as their pinhole cameras see them, with what a run has measured of them."""

from __future__ import annotations

import io
import logging
import os
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np

from ibrpipe.core.color import srgb_encode, to_bytes
from ibrpipe.export.page.packing import Packer
from ibrpipe.export.whole_file import megabytes
from ibrpipe.io.views import View, load_view, shrink_view
from ibrpipe.progress import track
from ibrpipe.types import Array

logger = logging.getLogger(__name__)

#: pixels of all pictures of a page together, and of one, at most: some 8 MB, and as much as a laptop's window shows
PIXELS, PIXELS_EACH = 40_000_000, 800 * 600
#: quality of WebP pictures to look at, and of those that errors are taken against
QUALITY, QUALITY_MEASURED = 80, 94
#: mask coverage from which on a pixel belongs to the object
MASKED = 0.5


@dataclass(frozen=True, eq=False)
class Picture:
    """A photo at the size in which a page holds it.

    Attributes
    ----------
    view : View
        Its camera has the picture's size.
    color : (H, W, 3) uint8, sRGB
    mask : (H, W) bool, or None
        Which pixels show the object; None = all.
    """

    view: View
    color: Array
    mask: Array | None


def load_pictures(views: Sequence[View], most: int | None = None) -> list[Picture]:
    """Load photos so small that all of them together have at most `most` pixels; `PIXELS` unless given.

    Photos whose files are gone are left out, and told.

    Raises
    ------
    FormatError, CaptureError
        One is damaged, or has another size than its camera states.
    """
    there = [view for view in views if view.image.is_file()]
    if len(there) < len(views):
        gone = next(view.image for view in views if not view.image.is_file())
        logger.warning(f"{len(views) - len(there)} of {len(views)} photos are left out: {gone} does not exist")
    share = min(PIXELS_EACH, (PIXELS if most is None else most) // max(len(there), 1))
    with ThreadPoolExecutor(os.cpu_count()) as pool:  # decoding leaves Python to other threads
        loaded = pool.map(lambda view: _picture(shrink_view(view, max(share, 1))), there)
        return list(track(loaded, "photos", len(there)))


def _picture(view: View) -> Picture:
    color, coverage = load_view(view)
    return Picture(view, to_bytes(srgb_encode(color)), coverage >= MASKED if view.masked else None)


def pack_photos(
    pictures: Sequence[Picture], packer: Packer, measured: Mapping[str, float] | None = None
) -> list[dict[str, Any]]:
    """Pack pictures and return what the page's scripts need to know of each.

    Parameters
    ----------
    measured : mapping of name to float, optional
        PSNR of held-out views in dB, as far as a run has measured it; None = the photos are only looked at.
    """
    quality = QUALITY if measured is None else QUALITY_MEASURED
    known = measured or {}
    return [
        {
            "name": picture.view.name,
            "K": picture.view.camera.K.tolist(),
            "cam_from_world": picture.view.camera.cam_from_world.tolist(),
            "width": picture.view.camera.width,
            "height": picture.view.camera.height,
            "heldOut": picture.view.held_out,
            "psnr": known.get(picture.view.name) if picture.view.held_out else None,
            "picture": packer.add_bytes(webp(picture.color, quality)),
            "mask": None if picture.mask is None else packer.add(np.packbits(picture.mask)),
        }
        for picture in pictures
    ]


def webp(color: Array, quality: int = QUALITY) -> bytes:
    """Return a picture (H, W, 3 or 4) uint8 as WebP."""
    from PIL import Image

    out = io.BytesIO()
    Image.fromarray(color).save(out, "WEBP", quality=quality, method=4)
    return out.getvalue()


def told_size(pictures: Sequence[Picture], packed: Sequence[Mapping[str, Any]]) -> str:
    """Return how many photos are shown, how large, and their bytes, in words."""
    sizes = [(each["width"], each["height"]) for each in packed]
    width, height = max(sizes, default=(0, 0), key=lambda size: size[0] * size[1])
    size = megabytes(sum(each["picture"]["length"] for each in packed))
    shrunk = any(picture.view.full_size is not None for picture in pictures)
    return f"{len(packed)} photos, {'shrunk to ' if shrunk else ''}{width} x {height} pixels at most, {size}"
