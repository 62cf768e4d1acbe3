"""How well an asset shows photos: PSNR in their masks."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ibrpipe.evaluation.image_scores import psnr, to_srgb8
from ibrpipe.io.views import View, load_view
from ibrpipe.renderers.api import prepare, render
from ibrpipe.types import Asset


class PhotoFit:
    """Photos that assets are held against; they are read once."""

    def __init__(self, views: Sequence[View]) -> None:
        self.views = list(views)
        self._codes = [(to_srgb8(color), mask >= 0.5) for color, mask in map(load_view, self.views)]

    def psnr(self, asset: Asset) -> float | None:
        """Return the mean PSNR over the photos, dB; None = there is nothing to compare.

        Rendered by `ldi`, with view dependence.
        """
        prepared = prepare(asset, "ldi")
        found = []
        for view, (codes, mask) in zip(self.views, self._codes, strict=True):
            value = psnr(codes, to_srgb8(np.asarray(render(prepared, view.camera).color)), mask)
            found += [] if value is None else [value]
        return float(np.mean(found)) if found else None
