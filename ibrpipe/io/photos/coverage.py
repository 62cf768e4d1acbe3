"""What the pixels of a mask file say of coverage: greys, cut-outs with alpha, labels in colour or by number."""

from __future__ import annotations

import numpy as np

from ibrpipe.io.photos.image_files import ImageHeader
from ibrpipe.types import Array

#: Integer files of 0, 1, 2, ... up to at most this are labels and not coverage
LABELS = 31
#: Share of full scale by which lossy files miss 0 and 1, and by which their greys are not quite grey
LOSS = 24 / 255


def coverage_of(pixels: Array, header: ImageHeader, lossy: bool = False) -> Array:
    """Return the coverage that a mask file means.

    Parameters
    ----------
    pixels : (H, W, C)
        As stored.
    header : ImageHeader
    lossy : bool
        The file is a JPEG or the like, whose values are not exact.

    Returns
    -------
    (H, W) float32
        0..1: alpha where it is not the same everywhere (a cut-out), else the grey; colours are labels, all but black
        counts, and so are files of 0, 1, 2, ... up to at most `LABELS` without a gap, all but 0 counts.
    """
    alpha = pixels[:, :, header.channels.index("A")] if header.has_alpha else None
    colours = pixels[:, :, [n for n, name in enumerate(header.channels) if name != "A"]]
    constant = colours.shape[2] == 0 or bool((colours == colours[:1, :1]).all())
    if alpha is not None and (_varies(alpha) or (constant and alpha.flat[0] < _full_scale(alpha))):
        return _scaled(alpha, lossy)
    if colours.shape[2] == 0:
        return np.ones(pixels.shape[:2], np.float32)
    if colours.shape[2] >= 3 and _coloured(colours[:, :, :3], lossy):
        return (_scaled(colours[:, :, :3].max(axis=2), lossy) > 0).astype(np.float32)
    return _scaled(colours[:, :, 0], lossy)


def _varies(plane: Array) -> bool:
    return bool((plane != plane.flat[0]).any())


def _full_scale(plane: Array) -> float:
    """Stored value that means 1."""
    return float(np.iinfo(plane.dtype).max) if np.issubdtype(plane.dtype, np.integer) else 1.0


def _coloured(colours: Array, lossy: bool) -> bool:
    span = np.ptp(colours.astype(np.float32), axis=2) / _full_scale(colours)
    return bool((span > (2 * LOSS if lossy else 0)).any())


def _labels(plane: Array) -> bool:
    """Whether a plane holds 1, 2, ... up to at most `LABELS`, every one of them, and nothing else but 0."""
    most = int(plane.max())
    return 0 < most <= LABELS and set(range(1, most + 1)) <= set(np.unique(plane).tolist())


def _scaled(plane: Array, lossy: bool) -> Array:
    if np.issubdtype(plane.dtype, np.integer) and not lossy and _labels(plane):
        return (plane > 0).astype(np.float32)
    values = np.clip(plane.astype(np.float32) / np.float32(_full_scale(plane)), 0.0, 1.0)
    if lossy:
        values = np.where(values < LOSS, 0.0, np.where(values > 1 - LOSS, 1.0, values)).astype(np.float32)
    return values
