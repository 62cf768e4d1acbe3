"""Pictures of where errors sit: one colour scale, logarithmic, wrong pixels in red."""

from __future__ import annotations

import numpy as np

from ibrpipe.bench.report.template import picture
from ibrpipe.bench.speed_error.run import Shown
from ibrpipe.types import Array

#: errors in texels at the ends of the colour scale
LEAST, MOST = 1e-6, 1.0
WRONG = (200, 30, 45)
NOTHING = (250, 250, 248)
#: width of a picture on the page, pixels
WIDTH = 320


def scale_colors() -> Array:
    """Return the colours of errors from `LEAST` to `MOST`, (256, 3) uint8."""
    from matplotlib import colormaps

    return np.rint(255.0 * colormaps["YlGnBu"](np.linspace(0.05, 1.0, 256))[:, :3]).astype(np.uint8)


def draw_errors(shown: Shown) -> str:
    """Return the picture of one frame as a data URI; shrunk by taking the worst of each block."""
    texels, wrong = shown.texels, shown.wrong
    factor = max(1, texels.shape[1] // WIDTH)
    texels = _blocks(np.nan_to_num(texels, nan=-1.0), factor)
    wrong = _blocks(wrong.astype(np.float32), factor) > 0
    with np.errstate(divide="ignore", invalid="ignore"):
        level = np.log(np.maximum(texels, LEAST) / LEAST) / np.log(MOST / LEAST)
    colors = scale_colors()[np.clip(255 * level, 0, 255).astype(np.uint8)]
    colors = np.where((texels < 0)[..., None], np.array(NOTHING, np.uint8), colors)
    colors = np.where(wrong[..., None], np.array(WRONG, np.uint8), colors)
    return picture(colors, WIDTH)


def _blocks(values: Array, factor: int) -> Array:
    rows, columns = values.shape[0] // factor, values.shape[1] // factor
    cut = values[: rows * factor, : columns * factor].reshape(rows, factor, columns, factor)
    return cut.max(axis=(1, 3))


def gradient(stops: int = 16) -> str:
    """Return the colour scale as CSS stops."""
    return ", ".join("#{:02x}{:02x}{:02x}".format(*color) for color in scale_colors()[:: 255 // stops])
