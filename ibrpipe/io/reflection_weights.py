"""Weights of a reflection's tables as one AVIF picture a texture, laid out like its layers' colours."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ibrpipe.errors import FormatError, MissingFileError, ResourceError
from ibrpipe.io.layer_pictures.atlas import Atlas
from ibrpipe.io.layer_pictures.avif import decode_avif, encode_avif
from ibrpipe.io.layer_pictures.planes import planes_of
from ibrpipe.types import Array, LayeredDepthImage

NAME = "reflection_weights.avif"


def write_weights(
    weights: Array, layers: LayeredDepthImage, path: Path, quality: int, speed: int
) -> list[float] | None:
    """Write weights (S, L) of the samples of `layers`.

    Returns
    -------
    list of float or None
        What code 255 stands for, table by table; None = too large for a picture, nothing is written.

    Raises
    ------
    ResourceError
        The file cannot be written.
    """
    atlas = Atlas(planes_of(layers.offsets), weights.shape[1])
    if not atlas.fits:
        return None
    tops = [float(top) or 1.0 for top in weights.max(axis=0, initial=0.0)]
    codes = np.round(weights * (255.0 / np.array(tops))).astype(np.uint8)
    try:
        path.write_bytes(encode_avif(atlas.spread(codes), quality, speed))
    except OSError as error:
        raise ResourceError(f"{path}: cannot write: {error.strerror or error}") from error
    return tops


def read_weights(path: Path, layers: LayeredDepthImage, tops: Sequence[float]) -> Array:
    """Read weights (S, L) float32 that `write_weights` wrote.

    Raises
    ------
    MissingFileError, FormatError
        There is no such file, or it is damaged.
    """
    atlas = Atlas(planes_of(layers.offsets), len(tops))
    try:
        codes = atlas.gather(decode_avif(path.read_bytes(), atlas.shape))
    except FileNotFoundError as error:
        raise MissingFileError(f"{path}: no such file; it should hold the weights of a reflection") from error
    except (OSError, FormatError) as error:
        raise FormatError(f"{path}: {error}; copy the asset again") from error
    return codes * (np.array(tops, np.float32) / np.float32(255.0))
