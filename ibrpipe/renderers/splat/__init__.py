"""The `splat` renderer: forward warp of reference samples, the baseline. Source: schaufler1999, sec. 3."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ibrpipe.renderers.renderer import Renderer
from ibrpipe.renderers.splat.options import SplatOptions
from ibrpipe.types import Asset, Camera, DepthImage, Frame, LayeredDepthImage, ReliefTexture, SpiralTexture, Texture
from ibrpipe.types.renderable import GridSource

if TYPE_CHECKING:
    from ibrpipe.renderers.epipolar.renderer import Maps


class SplatRenderer(Renderer["Maps", SplatOptions]):
    """Samples that cover the pixels of their footprints."""

    name = "splat"
    summary = "Forward warp of reference samples with footprints: the baseline beside the inverse warp."
    paper = "schaufler1999, sec. 3"
    limits = "First layer; holes where a surface is turned away from the reference; depth constant over a footprint."
    accepts = (ReliefTexture, DepthImage, LayeredDepthImage, SpiralTexture, Texture, Asset)
    Options = SplatOptions

    def prepare(self, sources: tuple[GridSource, ...]) -> Maps:
        """Lay out the first layers of all sources."""
        from ibrpipe.renderers.epipolar.renderer import prepare

        return prepare(sources)

    def draw(self, data: Maps, camera: Camera, outputs: tuple[str, ...], options: SplatOptions) -> Frame:
        """Project all samples, nearest first."""
        from ibrpipe.renderers.splat.renderer import draw

        return draw(data, camera, outputs, options)
