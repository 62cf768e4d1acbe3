"""Frames of several renderers in one picture: by depth, front to back (porter1984; policarpo2005, fig. 18)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from ibrpipe.errors import RendererError, ShapeError
from ibrpipe.types import Array, Frame


def composite(frames: Sequence[Frame]) -> Frame:
    """Put frames of one camera together by depth; of equally near ones the first is in front.

    A pixel that a frame covers in part lets what is behind show through by 1 - alpha. One that it does not cover at all
    is as if it had not hit anything. Where it covers something and has no depth, as at edges of several rays, the least
    depth beside is taken; without any it lies behind all.

    Parameters
    ----------
    frames : sequence of Frame
        Each with depth, and all with the same of colour (straight, not premultiplied) and alpha. Without alpha all
        that is hit is opaque.

    Returns
    -------
    Frame
        Colour straight; alpha of all together; depth where half of the pixel is covered, that of the farthest frame in
        it where less is.

    Raises
    ------
    RendererError, ShapeError
        There is no frame, one has no depth, or they differ in size or in what they hold.
    """
    if not frames or any(frame.depth is None for frame in frames):
        raise RendererError('compositing needs at least one frame, and depth in each: ask for outputs "depth"')
    depths = [frame.depth for frame in frames if frame.depth is not None]
    if len({depth.shape for depth in depths}) > 1:
        raise ShapeError(f"frames differ in size: {[depth.shape for depth in depths]}; use one camera")
    for name in ("color", "alpha"):
        held = [getattr(frame, name) is None for frame in frames]
        if any(held) and not all(held):
            raise RendererError(f"some frames hold {name} and some do not; ask for the same outputs")
    depth = np.stack(depths)
    cover = _cover(frames, depth)
    depth = np.stack([_filled(*each) for each in zip(depth, cover)])
    order = np.argsort(np.where(cover > 0, depth, np.inf), axis=0, kind="stable")
    cover, depth = (np.take_along_axis(each, order, axis=0) for each in (cover, depth))
    through = np.cumprod(np.concatenate([np.ones_like(cover[:1]), 1.0 - cover]), axis=0)  # before every frame, and last
    shown, total = through[:-1] * cover, 1.0 - through[-1]
    color = None
    if frames[0].color is not None:
        each = np.take_along_axis(np.stack([frame.color for frame in frames]), order[..., None], axis=0)  # type: ignore[misc]
        whole = (shown[..., None] * each).sum(axis=0)
        color = np.divide(whole, total[..., None], out=np.zeros_like(whole), where=total[..., None] > 0)
        color = np.where(cover[0][..., None] == 1.0, each[0], color)  # to the bit where one is opaque
    return Frame(
        None if color is None else color.astype(np.float32),
        _depth(depth, shown, through[1:]),
        None if frames[0].alpha is None else total.astype(np.float32),
        {"frames": len(frames)},
    )


def _cover(frames: Sequence[Frame], depth: Array) -> Array:
    """Share (N, H, W) float64 of each pixel that frames cover; without alpha all of what they hit."""
    if frames[0].alpha is None:
        return np.isfinite(depth).astype(np.float64)
    return np.stack([frame.alpha for frame in frames]).astype(np.float64)  # type: ignore[misc]


def _filled(depth: Array, cover: Array) -> Array:
    """Depth (H, W) with the least of the eight beside where there is cover without depth."""
    bare = (cover > 0) & ~np.isfinite(depth)
    if not bare.any():
        return depth
    around = sliding_window_view(np.pad(depth, 1, constant_values=np.inf), (3, 3))
    return np.where(bare, around.min(axis=(2, 3)), depth)


def _depth(depth: Array, shown: Array, through: Array) -> Array:
    """Depth (H, W) of the first frame by which half is covered, else of the last that covers anything."""
    half = through <= 0.5
    last = len(depth) - 1 - np.argmax(shown[::-1] > 0, axis=0)
    at = np.where(half.any(axis=0), half.argmax(axis=0), last)
    found = np.take_along_axis(depth, at[None], axis=0)[0]
    return np.where((shown > 0).any(axis=0), found, np.inf).astype(np.float32)
