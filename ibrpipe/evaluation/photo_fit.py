"""How well an asset shows photos: PSNR in their masks."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ibrpipe.core.psnr import psnr
from ibrpipe.evaluation.image_scores import to_srgb8
from ibrpipe.io.views import View, load_view
from ibrpipe.renderers.api import prepare, render
from ibrpipe.types import Asset


class PhotoFit:
    """Photos that assets are held against; they are read once."""

    def __init__(self, views: Sequence[View]) -> None:
        self.views = list(views)
        self._codes = [(to_srgb8(color), mask >= 0.5) for color, mask in map(load_view, self.views)]

    def each(self, asset: Asset, every: int = 1) -> list[float | None]:
        """Return the PSNR of every so manieth photo, dB; None = it shows nothing.

        Rendered by `ldi`, with view dependence.
        """
        prepared = prepare(asset, "ldi")
        return [
            psnr(codes, to_srgb8(np.asarray(render(prepared, view.camera).color)), mask)
            for view, (codes, mask) in zip(self.views[::every], self._codes[::every], strict=True)
        ]

    def psnr(self, asset: Asset, every: int = 1) -> float | None:
        """Return the mean PSNR over every so manieth photo, dB; None = there is nothing to compare."""
        return mean_of(self.each(asset, every))


def mean_of(values: Sequence[float | None]) -> float | None:
    """Return the mean of what is known; None = nothing is."""
    known = [value for value in values if value is not None]
    return float(np.mean(known)) if known else None
