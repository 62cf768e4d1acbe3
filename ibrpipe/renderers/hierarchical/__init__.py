"""The `hierarchical` renderer: scenes of many copies, drawn from images of their parts. Source: max1999."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ibrpipe.renderers.hierarchical.options import HierarchicalOptions
from ibrpipe.renderers.renderer import Renderer
from ibrpipe.types import Camera, Frame, Scene
from ibrpipe.types.prerendered import PrerenderedScene

if TYPE_CHECKING:
    from ibrpipe.renderers.hierarchical.data import HierarchicalData


class HierarchicalRenderer(Renderer["HierarchicalData", HierarchicalOptions]):
    """Parts as prefiltered slices where they are small in the picture, as polygons where they are large."""

    name = "hierarchical"
    summary = "Scenes of many copies of few parts, each drawn from images made beforehand, as finely as the view needs."
    paper = "max1999"
    limits = "One scene at a time; captured things unstretched, in their own light; at most four lights at infinity."
    accepts = (Scene, PrerenderedScene)
    Options = HierarchicalOptions

    def prepare(self, sources: tuple[Scene | PrerenderedScene, ...]) -> HierarchicalData:
        """Lay out the scene; slices are made where none are brought."""
        from ibrpipe.renderers.hierarchical.data import prepare

        return prepare(sources)

    def draw(
        self, data: HierarchicalData, camera: Camera, outputs: tuple[str, ...], options: HierarchicalOptions
    ) -> Frame:
        """Choose, light, sort and composite."""
        from ibrpipe.renderers.hierarchical.renderer import draw

        return draw(data, camera, outputs, options)
