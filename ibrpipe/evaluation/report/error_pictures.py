"""Pictures of the error that is to be expected of an asset's tiles, on the object."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ibrpipe.evaluation.report.pictures import PAPER, UNCOVERED, heat_colors, jpeg
from ibrpipe.evaluation.report.surface_pictures import confidence_colors
from ibrpipe.evaluation.texture_errors import Tiling, tiles_of_pixels
from ibrpipe.io.documents.texture_errors import TextureErrors
from ibrpipe.io.views import View
from ibrpipe.renderers.api import prepare
from ibrpipe.types import Array, Asset

#: colour error at which the ramp ends, 8-bit codes
WORST_CODES = 24.0


@dataclass(frozen=True)
class ErrorPictures:
    """One view of the tiles' expected error, as data URIs."""

    name: str
    width: int
    height: int
    color: str
    confidence: str


def draw_errors(
    asset: Asset, errors: Sequence[TextureErrors], views: Sequence[View], width: int
) -> list[ErrorPictures]:
    """Draw what the asset says of its own errors as some views see it.

    Parameters
    ----------
    errors : of every texture
    width : int
        Of the pictures in pixels, at most.
    """
    tiling, prepared = Tiling.of(asset), prepare(asset, "ldi")
    if any(one.rows * one.columns != int(shape.prod()) for one, shape in zip(errors, tiling.shapes, strict=True)):
        return []  # an asset that another version has cut into other tiles
    color = np.concatenate([_numbers(one.tiles.color_rms) for one in errors]) / WORST_CODES
    confidence = np.concatenate([_numbers(one.tiles.confidence) for one in errors])
    drawn = []
    for view in views:
        scale = min(1.0, width / view.camera.width)
        camera = view.camera.resized(round(view.camera.width * scale), round(view.camera.height * scale))
        tiles = tiles_of_pixels(prepared.data, camera, tiling)
        pictures = [
            jpeg(_painted(tiles, values, colors), width)
            for values, colors in ((color, heat_colors()), (confidence, confidence_colors()))
        ]
        drawn.append(ErrorPictures(view.name, camera.width, camera.height, *pictures))
    return drawn


def _numbers(values: Sequence[float | None]) -> Array:
    return np.array([np.nan if value is None else value for value in values], np.float64)


def _painted(tiles: Array, values: Array, colors: Array) -> Array:
    """(H, W, 3) uint8: values from 0 to 1 by colours (256, 3); paper where nothing is, grey where nothing is known."""
    picture = np.full((*tiles.shape, 3), PAPER, np.uint8)
    shown = tiles >= 0
    known = values[tiles[shown]]
    steps = np.nan_to_num(np.clip(known, 0.0, 1.0) * 255.0).astype(np.int64)
    picture[shown] = np.where(np.isnan(known)[:, None], np.array(UNCOVERED, np.uint8), colors[steps])
    return picture
