"""The `epipolar` renderer: inverse warping along whole epipolar lines. Source: schaufler1999."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ibrpipe.renderers.epipolar.options import EpipolarOptions
from ibrpipe.renderers.renderer import Renderer
from ibrpipe.types import Asset, Camera, DepthImage, Frame, LayeredDepthImage, ReliefTexture, SpiralTexture, Texture
from ibrpipe.types.renderable import GridSource

if TYPE_CHECKING:
    from ibrpipe.renderers.epipolar.renderer import Maps


class EpipolarRenderer(Renderer["Maps", EpipolarOptions]):
    """Searches that are carried on from pixel to pixel of an epipolar line."""

    name = "epipolar"
    summary = "Inverse warp along whole epipolar lines, exact or with nearest or interpolated reference samples."
    paper = "schaufler1999"
    limits = "Pinhole cameras; nearest and linear searches use the first layer."
    accepts = (ReliefTexture, DepthImage, LayeredDepthImage, SpiralTexture, Texture, Asset)
    Options = EpipolarOptions

    def prepare(self, sources: tuple[GridSource, ...]) -> Maps:
        """Build the fields of all sources and the bounds of their blocks."""
        from ibrpipe.renderers.epipolar.renderer import prepare

        return prepare(sources)

    def draw(self, data: Maps, camera: Camera, outputs: tuple[str, ...], options: EpipolarOptions) -> Frame:
        """Cast all maps, then shade the hits."""
        from ibrpipe.renderers.epipolar.renderer import draw

        return draw(data, camera, outputs, options)
