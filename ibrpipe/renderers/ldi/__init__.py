"""The `ldi` renderer: nearest hit over all fields, then colour, then residuals. Source: gong-yang, sec. 5."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ibrpipe.renderers.ldi.options import LdiOptions
from ibrpipe.renderers.renderer import Renderer
from ibrpipe.types import Asset, Camera, DepthImage, Frame, LayeredDepthImage, ReliefTexture, SpiralTexture, Texture
from ibrpipe.types.renderable import GridSource

if TYPE_CHECKING:
    from ibrpipe.renderers.scene import Scene


class LdiRenderer(Renderer["Scene", LdiOptions]):
    """Exact nearest hits and depth-corrected residuals."""

    name = "ldi"
    summary = "Exact nearest hit by projected patches or a quadtree; depth-corrected spiral residuals."
    paper = "gong-yang, sec. 5"
    limits = "Pinhole cameras; no transparency but for rims that fill their texels in part."
    accepts = (ReliefTexture, DepthImage, LayeredDepthImage, SpiralTexture, Texture, Asset)
    Options = LdiOptions

    def prepare(self, sources: tuple[GridSource, ...]) -> Scene:
        """Build the fields of all sources, and the tables of their residuals."""
        from ibrpipe.renderers.scene import prepare
        from ibrpipe.renderers.search.projection import BACKGROUND

        if _matt_layers(sources):  # else a second process has view dependence to compile
            BACKGROUND.begin()
        return prepare(sources)

    def draw(self, data: Scene, camera: Camera, outputs: tuple[str, ...], options: LdiOptions) -> Frame:
        """Find the hits, shade them, add residuals."""
        from ibrpipe.renderers.ldi.renderer import draw

        return draw(data, camera, outputs, options)

    def draw_adaptive(self, data: Scene, camera: Camera, outputs: tuple[str, ...], options: LdiOptions) -> Frame:
        """Trace several rays only through pixels that show an edge of layered images."""
        from ibrpipe.renderers.ldi.renderer import draw_adaptive, traces_edges

        if not traces_edges(data, camera, options):
            return super().draw_adaptive(data, camera, outputs, options)
        return draw_adaptive(data, camera, outputs, options)


def _matt_layers(sources: tuple[GridSource, ...]) -> bool:
    """Whether there are layered images, and none of the sources has view dependence."""
    parted = any(isinstance(each, Texture) and each.components for each in sources)
    return not parted and any(isinstance(each, LayeredDepthImage | Texture) for each in sources)
