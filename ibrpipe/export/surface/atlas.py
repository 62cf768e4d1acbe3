"""Where charts lie in one picture, and the pictures of what their samples hold."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ibrpipe.core.color import srgb_encode, to_bytes
from ibrpipe.export.surface.charts import Chart
from ibrpipe.io.layer_pictures.atlas import pack
from ibrpipe.types import Array

#: texels around every chart that carry its colours on, so that filters meet no others
PADDING = 2


class Atlas:
    """Charts in rows of one picture.

    Attributes
    ----------
    shape : (height, width)
    """

    def __init__(self, charts: Sequence[Chart]) -> None:
        self._charts = charts
        sizes = [(chart.box[3] + 2 * PADDING, chart.box[2] + 2 * PADDING) for chart in charts]
        order = sorted(range(len(sizes)), key=lambda index: (-sizes[index][0], -sizes[index][1], index))
        corners, self.shape = pack([sizes[index] for index in order])
        self._corners = dict(zip(order, corners, strict=True))

    def coordinates(self, index: int, texels: Array) -> Array:
        """Texture coordinates (V, 2) of places (V, 2) in the image of a chart; 0 to 1, v downward."""
        height, width = self.shape
        return (self._shifted(index, texels) + 0.5) / (width, height)

    def spread(self, values: Sequence[Array]) -> tuple[Array, Array]:
        """Return the picture (h, w, C) of every chart's values (S, C) per sample, and where it has any, (h, w) bool."""
        picture = np.zeros((*self.shape, values[0].shape[1]), values[0].dtype)
        there = np.zeros(self.shape, bool)
        for index, (chart, own) in enumerate(zip(self._charts, values, strict=True)):
            column, row = self._shifted(index, chart.places).T
            picture[row, column], there[row, column] = own, True
        return picture, there

    def _shifted(self, index: int, texels: Array) -> Array:
        row, column = self._corners[index]
        left, top = self._charts[index].box[:2]
        return texels - (left, top) + (column + PADDING, row + PADDING)


def color_picture(atlas: Atlas, colors: Sequence[Array], shown: Sequence[Array]) -> Array:
    """Return the picture (h, w, 4) uint8, sRGB and alpha, of linear colours (S, 3) of the samples that are shown."""
    from ibrpipe.io.residuals import continue_smoothly

    coded = [np.column_stack([to_bytes(srgb_encode(color)), seen]) for color, seen in zip(colors, shown, strict=True)]
    picture, there = atlas.spread(coded)
    known = there & (picture[..., 3] > 0)
    alpha = known | (there & _beside(known))
    filled = continue_smoothly(np.ascontiguousarray(picture[..., :3]), known)
    return np.dstack([filled, np.where(alpha, 255, 0).astype(np.uint8)])


def _beside(known: Array) -> Array:
    """(h, w) bool: texels with a known one among the eight around them."""
    padded = np.pad(known, 1)
    rows, columns = known.shape
    shifts = [(y, x) for y in range(3) for x in range(3)]
    return np.any([padded[y : y + rows, x : x + columns] for y, x in shifts], axis=0)
