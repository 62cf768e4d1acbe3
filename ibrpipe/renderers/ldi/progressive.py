"""Frames of the `ldi` renderer as they become better. Source: gong-yang, sec. 5.1, "progressive"."""

from __future__ import annotations

from collections.abc import Iterator

from ibrpipe.renderers.api import Prepared, Source, prepare
from ibrpipe.renderers.ldi.options import LdiOptions
from ibrpipe.renderers.ldi.renderer import passes
from ibrpipe.types import Camera, Frame


def render_progressive(source: Source, camera: Camera, threads: int = 0) -> Iterator[Frame]:
    """Yield the view-independent frame, then (where the source has view dependence) the complete one.

    The first frame is complete before view dependence is added.
    """
    prepared = source if isinstance(source, Prepared) else prepare(source, "ldi")
    scene = prepare(prepared, "ldi").data
    for frame in passes(scene, camera, ("color", "depth", "alpha"), LdiOptions(threads=threads)):
        color = None if frame.color is None else frame.color.copy()
        yield Frame(color, frame.depth, frame.alpha, frame.stats)
