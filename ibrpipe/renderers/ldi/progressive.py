"""Frames of the `ldi` renderer as they become better. Source: gong-yang, sec. 5.1, "progressive"."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

from ibrpipe.errors import RendererError
from ibrpipe.renderers.api import OUTPUTS, Prepared, Source, prepare, render
from ibrpipe.renderers.ldi.options import LdiOptions
from ibrpipe.renderers.ldi.renderer import passes
from ibrpipe.renderers.option_check import checked_options
from ibrpipe.renderers.registry import find_renderer
from ibrpipe.renderers.scene import Scene as FieldScene
from ibrpipe.types import Camera, Frame


def render_progressive(
    source: Source, camera: Camera, outputs: Iterable[str] = OUTPUTS, **options: Any
) -> Iterator[Frame]:
    """Yield frames of the renderer `ldi`, each better than the one before; each is complete in itself.

    Parameters
    ----------
    source : as `ibrpipe.render` takes it, but no Scene
    camera : Camera
    outputs : names among "color", "depth", "alpha"
    **options
        Those of `ldi`.

    Yields
    ------
    Frame
        The view-independent one; where the source has view dependence, the one with it; where `samples` asks for more
        than one ray a pixel, that one. Each array is its own, and the last frame is that of `ibrpipe.render`.

    Raises
    ------
    RendererError
        An option or the source cannot be what it is.
    """
    checked = checked_options(find_renderer("ldi"), options)
    prepared = source if isinstance(source, Prepared) else prepare(source, "ldi")
    scene, wanted = prepare(prepared, "ldi").data, tuple(outputs)
    if not isinstance(scene, FieldScene):
        raise RendererError("a Scene has no first picture of its own; give its assets as a list")
    assert isinstance(checked, LdiOptions)
    for frame in passes(scene, camera, wanted, checked):
        color = None if frame.color is None else frame.color.copy()
        yield Frame(color, frame.depth, frame.alpha, dict(frame.stats))
    if checked.samples != 1 and {"color", "alpha"} & set(wanted):
        yield render(prepared, camera, "ldi", wanted, **options)
