"""The `relief` renderer: height fields and relief-mapped meshes searched ray by ray. Source: policarpo2005."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ibrpipe.renderers.relief.options import ReliefOptions
from ibrpipe.renderers.renderer import Renderer
from ibrpipe.types import Asset, Camera, Frame, LayeredDepthImage, ReliefTexture, SpiralTexture, Texture
from ibrpipe.types.relief_mesh import ReliefMesh
from ibrpipe.types.renderable import Renderable

if TYPE_CHECKING:
    from ibrpipe.renderers.relief.renderer import Scene


class ReliefRenderer(Renderer["Scene", ReliefOptions]):
    """Relief mapping by an exact or the published search."""

    name = "relief"
    summary = "Relief mapping of height fields and textured meshes, exactly or by linear and binary steps."
    paper = "policarpo2005"
    limits = "Parallel frames, first layer; search='linear-binary' steps over thin features."
    accepts = (ReliefTexture, LayeredDepthImage, SpiralTexture, Texture, Asset, ReliefMesh)
    Options = ReliefOptions

    def prepare(self, sources: tuple[Renderable, ...]) -> Scene:
        """Build the pyramids of all sources."""
        from ibrpipe.renderers.relief.renderer import prepare

        return prepare(sources)

    def draw(self, data: Scene, camera: Camera, outputs: tuple[str, ...], options: ReliefOptions) -> Frame:
        """Search the rays of all sources, shade what is hit."""
        from ibrpipe.renderers.relief.renderer import draw

        return draw(data, camera, outputs, options)
