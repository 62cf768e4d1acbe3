"""Frames of several rays a pixel, everywhere or only where a pixel shows an edge; see ``docs/antialiasing.md``."""

from __future__ import annotations

from collections.abc import Callable
from math import isqrt

import numpy as np

from ibrpipe.renderers.edges import edge_pixels
from ibrpipe.types import Array, Camera, Frame

#: draws one frame of one ray a pixel
Draw = Callable[[Camera, tuple[str, ...]], Frame]
#: rays of an edge's pixel where a renderer has no way of its own to draw only some pixels
EDGE_SAMPLES = 4


def supersample(draw: Draw, camera: Camera, outputs: tuple[str, ...], samples: int) -> Frame:
    """Draw a frame of `samples` rays a pixel, in square order.

    Colour is the mean of what covers the pixel, alpha the share that is covered, depth that of the ray that is farther
    than just half of them.
    """
    side = isqrt(samples)
    whole = draw(camera.resized(camera.width * side, camera.height * side), _needed(outputs))
    color, depth, alpha = whole.color, whole.depth, whole.alpha
    shape = (camera.height, side, camera.width, side)
    if color is not None and alpha is not None:
        weighted = (color * alpha[..., None]).reshape(*shape, 3).sum(axis=(1, 3))
        total = alpha.reshape(shape).sum(axis=(1, 3))[..., None]
        color = np.divide(weighted, total, out=np.zeros_like(weighted), where=total > 0)
    if alpha is not None:
        alpha = alpha.reshape(shape).mean(axis=(1, 3))
    if depth is not None:
        rays = np.moveaxis(depth.reshape(shape), 1, 2).reshape(camera.height, camera.width, samples)
        depth = np.partition(rays, (samples - 1) // 2, axis=2)[..., (samples - 1) // 2]
    return _frame(outputs, color, depth, alpha, {**whole.stats, "samples": samples})


def smooth_edges(draw: Draw, camera: Camera, outputs: tuple[str, ...]) -> Frame:
    """Draw a frame of one ray a pixel, and of several where it shows an edge; depth is that of the one ray."""
    one = draw(camera, ("color", "depth", "alpha"))
    color, depth, alpha = one.color, one.depth, one.alpha
    assert color is not None
    assert depth is not None
    assert alpha is not None
    edges = edge_pixels(depth, alpha) > 0
    if edges.any() and {"color", "alpha"} & set(outputs):
        several = supersample(draw, camera, ("color", "alpha"), EDGE_SAMPLES)
        assert several.color is not None
        assert several.alpha is not None
        color = np.where(edges[..., None], several.color, color)
        alpha = np.where(edges, several.alpha, alpha)
    return _frame(outputs, color, depth, alpha, {**one.stats, "edge_pixels": int(edges.sum())})


def _needed(outputs: tuple[str, ...]) -> tuple[str, ...]:
    """Colours are weighted by alpha."""
    return (*outputs, "alpha") if "color" in outputs and "alpha" not in outputs else outputs


def _frame(
    outputs: tuple[str, ...], color: Array | None, depth: Array | None, alpha: Array | None, stats: dict[str, object]
) -> Frame:
    return Frame(
        color if "color" in outputs else None,
        depth if "depth" in outputs else None,
        alpha if "alpha" in outputs else None,
        stats,
    )
