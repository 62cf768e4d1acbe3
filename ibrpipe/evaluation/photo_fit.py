"""How well an asset shows photos: PSNR in their masks, or where it covers them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ibrpipe.core.psnr import psnr
from ibrpipe.evaluation.image_scores import to_srgb8
from ibrpipe.io.views import View, load_view
from ibrpipe.renderers.api import prepare, render
from ibrpipe.types import Array, Asset

#: pixels around what an asset covers that count, too
AROUND = 2


class PhotoFit:
    """Photos that assets are held against; they are read once.

    Masks say which pixels count. Of a photo without a mask those do that one asset covers: what it never shows, such as
    a sky or a wall behind it, would else outweigh all that coding can lose. Few pixels around them count, too, but are
    held against that asset's picture instead of the photo: rims that coding moves cost, whichever way they move.
    """

    def __init__(self, views: Sequence[View], asset: Asset) -> None:
        self.views, prepared = list(views), prepare(asset.predicting(), "ldi")
        self._codes = []
        for view in self.views:
            color, mask = load_view(view)
            codes, counted = to_srgb8(color), mask >= 0.5
            if not view.masked:
                frame = render(prepared, view.camera)
                covered = np.asarray(frame.alpha) >= 0.5
                codes = np.where(covered[..., None], codes, to_srgb8(np.asarray(frame.color)))
                counted &= _widened(covered)
            self._codes.append((codes, counted))

    def each(self, asset: Asset, every: int = 1) -> list[float | None]:
        """Return the PSNR of every so manieth photo, dB; None = it shows nothing.

        Rendered by `ldi`, with view dependence; a photo that the asset keeps does not show itself.
        """
        prepared = prepare(asset.predicting(), "ldi")
        return [
            psnr(codes, to_srgb8(np.asarray(render(prepared, view.camera).color)), mask)
            for view, (codes, mask) in zip(self.views[::every], self._codes[::every], strict=True)
        ]

    def psnr(self, asset: Asset, every: int = 1) -> float | None:
        """Return the mean PSNR over every so manieth photo, dB; None = there is nothing to compare."""
        return mean_of(self.each(asset, every))


def _widened(covered: Array) -> Array:
    """Return covered pixels (H, W) and those around: rims that coding moves count alike, whichever way they move."""
    import cv2

    square = np.ones((2 * AROUND + 1, 2 * AROUND + 1), np.uint8)
    return np.asarray(cv2.dilate(covered.astype(np.uint8), square)) > 0


def mean_of(values: Sequence[float | None]) -> float | None:
    """Return the mean of what is known; None = nothing is."""
    known = [value for value in values if value is not None]
    return float(np.mean(known)) if known else None
