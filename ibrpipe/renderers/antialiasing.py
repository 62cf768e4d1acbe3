"""Frames of several rays a pixel, everywhere or only where a pixel shows an edge; see ``docs/antialiasing.md``."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from math import isqrt
from typing import Any

import numpy as np

from ibrpipe.renderers.edges import MOST_RAYS, edge_pixels
from ibrpipe.renderers.frames import make_frame
from ibrpipe.types import Array, Camera, Frame

#: draws one frame of one ray a pixel
Draw = Callable[[Camera, tuple[str, ...]], Frame]
#: rays of an edge's pixel where a renderer has no way of its own to draw only some pixels
EDGE_SAMPLES = 4


def supersample(draw: Draw, camera: Camera, outputs: tuple[str, ...], samples: int) -> Frame:
    """Draw a frame of `samples` rays a pixel, in square order, in bands of rows of at most `MOST_RAYS` rays.

    Colour is the mean of what covers the pixel, alpha the share that is covered, depth that of the ray that is farther
    than just half of them. Figures of bands are added up.
    """
    needed = (*outputs, "alpha") if "color" in outputs and "alpha" not in outputs else outputs
    height, side = max(1, MOST_RAYS // (camera.width * samples)), isqrt(samples)
    bands, stats = [], []
    for top in range(0, camera.height, height):
        band = _rows(camera, top, min(top + height, camera.height), side)
        frame = draw(band, needed)
        stats.append({**frame.stats, "rays": _rays(frame, band)})
        bands.append(_means(frame, side))
    color, depth, alpha = (None if each[0] is None else np.concatenate(each) for each in zip(*bands, strict=True))
    return make_frame(outputs, depth, color, alpha, {**_sums(stats), "samples": samples})


def smooth_edges(draw: Draw, camera: Camera, outputs: tuple[str, ...]) -> Frame:
    """Draw a frame of one ray a pixel, and of several where it shows an edge; depth is that of the one ray."""
    one = draw(camera, ("color", "depth", "alpha"))
    color, depth, alpha = one.color, one.depth, one.alpha
    assert color is not None
    assert depth is not None
    assert alpha is not None
    edges = edge_pixels(depth, alpha) > 0
    stats = {**one.stats, "rays": _rays(one, camera), "edge_pixels": int(edges.sum())}
    if edges.any():
        several = supersample(draw, camera, ("color", "alpha"), EDGE_SAMPLES)
        assert several.color is not None
        assert several.alpha is not None
        color = np.where(edges[..., None], several.color, color)
        alpha = np.where(edges, several.alpha, alpha)
        stats |= {name: stats[name] + several.stats[name] for name in ("rays", "milliseconds") if name in several.stats}
    return make_frame(outputs, depth, color, alpha, stats)


def _rows(camera: Camera, top: int, bottom: int, side: int) -> Camera:
    """Return the camera of some rows of pixels, each of `side` times `side` rays."""
    large = camera.resized(camera.width * side, camera.height * side)
    K = large.K.copy()
    K[1, 2] -= top * side
    return replace(large, K=K, height=(bottom - top) * side)


def _means(frame: Frame, side: int) -> tuple[Array | None, Array | None, Array | None]:
    """Return colour, depth and alpha of pixels of `side` times `side` rays; None = the frame has none."""
    color, depth, alpha = frame.color, frame.depth, frame.alpha
    if color is not None and alpha is not None:
        weighted = _blocks(color * alpha[..., None], side).sum(axis=2)
        total = _blocks(alpha, side).sum(axis=2)[..., None]
        color = np.divide(weighted, total, out=np.zeros_like(weighted), where=total > 0)
    if alpha is not None:
        alpha = _blocks(alpha, side).mean(axis=2)
    if depth is not None:
        middle = (side * side - 1) // 2
        depth = np.partition(_blocks(depth, side), middle, axis=2)[:, :, middle]
    return color, depth, alpha


def _blocks(picture: Array, side: int) -> Array:
    """(H, W, side^2, ...) of (H side, W side, ...): the rays of every pixel, row by row."""
    rows, columns, *rest = picture.shape
    parts = picture.reshape(rows // side, side, columns // side, side, *rest)
    return np.moveaxis(parts, 1, 2).reshape(rows // side, columns // side, side * side, *rest)


def _rays(frame: Frame, camera: Camera) -> int:
    """Return the rays that a frame counts; one a pixel where it counts none."""
    return int(frame.stats.get("rays", camera.width * camera.height))


def _sums(stats: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Return figures of several frames added up; what is no number is that of the first."""
    return {
        name: sum(each[name] for each in stats) if isinstance(value, int | float) else value
        for name, value in stats[0].items()
    }
