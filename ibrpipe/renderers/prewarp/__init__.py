"""The `prewarp` renderer: 1-D pre-warp of relief textures, then planar texture mapping. Source: oliveira2000."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ibrpipe.renderers.prewarp.options import PrewarpOptions
from ibrpipe.renderers.renderer import Renderer
from ibrpipe.types import Asset, Camera, Frame, LayeredDepthImage, ReliefTexture, SpiralTexture, Texture

if TYPE_CHECKING:
    from ibrpipe.renderers.prewarp.renderer import Scene


class PrewarpRenderer(Renderer["Scene", PrewarpOptions]):
    """Relief textures resampled along rows and columns."""

    name = "prewarp"
    summary = "1-D pre-warp of relief textures along rows and columns, then planar texture mapping."
    paper = "oliveira2000"
    limits = "Parallel frames, first layer; sampled, so silhouettes are right to about a texel."
    accepts = (ReliefTexture, LayeredDepthImage, SpiralTexture, Texture, Asset)
    Options = PrewarpOptions

    def prepare(self, sources: tuple[ReliefTexture | LayeredDepthImage | Texture, ...]) -> Scene:
        """Take the first layer of every source."""
        from ibrpipe.renderers.prewarp.renderer import prepare

        return prepare(sources)

    def draw(self, data: Scene, camera: Camera, outputs: tuple[str, ...], options: PrewarpOptions) -> Frame:
        """Warp every texture into the faces that it is seen through, then map those."""
        from ibrpipe.renderers.prewarp.renderer import draw

        return draw(data, camera, outputs, options)
