"""Frames of several renderers in one picture: per pixel the nearest wins (policarpo2005, fig. 18)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ibrpipe.errors import RendererError, ShapeError
from ibrpipe.types import Frame


def composite(frames: Sequence[Frame]) -> Frame:
    """Put frames of one camera together by depth; of equally near ones the first wins.

    Parameters
    ----------
    frames : sequence of Frame
        Each with depth, and all with the same of colour and alpha.

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
    nearest = np.argmin(np.stack(depths), axis=0)
    parts: dict[str, np.ndarray | None] = {}
    for name in ("color", "depth", "alpha"):
        held = [getattr(frame, name) for frame in frames]
        if any(each is None for each in held) and not all(each is None for each in held):
            raise RendererError(f"some frames hold {name} and some do not; ask for the same outputs")
        parts[name] = None if held[0] is None else _picked(held, nearest)
    return Frame(parts["color"], parts["depth"], parts["alpha"], {"frames": len(frames)})


def _picked(held: Sequence[np.ndarray], nearest: np.ndarray) -> np.ndarray:
    out = held[0].copy()
    for number in range(1, len(held)):
        out[nearest == number] = held[number][nearest == number]
    return out
