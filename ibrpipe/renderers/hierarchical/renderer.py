"""What the `hierarchical` renderer does: choose, light, sort, composite. Source: max1999, sec. 2 and 3."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from time import perf_counter

import numpy as np

from ibrpipe.errors import RendererError
from ibrpipe.renderers.frames import limited_threads, make_frame
from ibrpipe.renderers.hierarchical import drawing
from ibrpipe.renderers.hierarchical.guide import Guide, build_guide
from ibrpipe.renderers.hierarchical.nodes import Nodes, scene_nodes
from ibrpipe.renderers.hierarchical.options import HierarchicalOptions
from ibrpipe.renderers.hierarchical.prefiltering import Slicing
from ibrpipe.renderers.hierarchical.prerendering import prerender_all
from ibrpipe.renderers.hierarchical.selection import select
from ibrpipe.renderers.hierarchical.shaded import ShadedSlices
from ibrpipe.renderers.hierarchical.view import view_of
from ibrpipe.types import Camera, Frame, Lighting, Scene
from ibrpipe.types.prerendered import Prerendered, PrerenderedScene

#: lights whose bins fit into the key of a shaded slice
MOST_LIGHTS = 4


@dataclass(frozen=True, eq=False)
class HierarchicalData:
    """A scene laid out for drawing.

    Attributes
    ----------
    nodes : Nodes
    library : Prerendered
    guide : Guide
    lighting : Lighting
    """

    nodes: Nodes
    library: Prerendered
    guide: Guide
    lighting: Lighting

    @property
    def bytes(self) -> int:
        """Bytes held beyond the scene."""
        return self.nodes.bytes + self.library.bytes + self.shaded.bytes

    @cached_property
    def shaded(self) -> ShadedSlices:
        """Slices that have been lit."""
        number = {name: node for node, name in enumerate(self.nodes.names)}
        materials = np.array([self.nodes.materials[number[name]] for name in self.library.names]).reshape(-1, 2)
        return ShadedSlices(self.library, materials)

    @cached_property
    def polygons_only(self) -> Guide:
        """The guide of a walk that takes everything apart."""
        return replace(self.guide, kinds=self.guide.kinds * (0, 1))

    @property
    def radius(self) -> float:
        """Radius of the scene."""
        return float(self.guide.spheres[self.nodes.root, 3])


def prepare(sources: tuple[Scene | PrerenderedScene, ...]) -> HierarchicalData:
    """Lay out a scene; slices are made with the usual settings where none are brought.

    Raises
    ------
    RendererError
        Several scenes, more lights than can be told apart, or slices of another scene.
    """
    if len(sources) > 1:
        raise RendererError(f"renderer 'hierarchical' draws one scene at a time, got {len(sources)}; make one of them")
    scene = sources[0].scene if isinstance(sources[0], PrerenderedScene) else sources[0]
    if len(scene.lighting.lights) > MOST_LIGHTS:
        raise RendererError(f"the scene has {len(scene.lighting.lights)} lights; at most {MOST_LIGHTS} are drawn")
    nodes = scene_nodes(scene)
    if isinstance(sources[0], PrerenderedScene):
        library = sources[0].library
        foreign = sorted(set(library.names) - set(nodes.names))
        if foreign:
            raise RendererError(f"the slices are of another scene: it has no part {foreign[0]!r}; prerender this one")
    else:
        library = prerender_all(nodes, Slicing())
    return HierarchicalData(nodes, library, build_guide(nodes, library), scene.lighting)


def draw(data: HierarchicalData, camera: Camera, outputs: tuple[str, ...], options: HierarchicalOptions) -> Frame:
    """Render one frame; see `ibrpipe.render`."""
    began = perf_counter()
    view = view_of(camera, data.lighting, options.near or 1e-6 * data.radius)
    guide = data.guide if options.mode == "slices" else data.polygons_only
    with limited_threads(options.threads):
        start = np.array([data.nodes.root], np.int32)
        chosen = select(data.nodes, guide, start, view.pose.reshape(1, 12), view.limits(options.pixel_error))
        slices = drawing.place(data.library, data.shaded, guide.rows, chosen, view)
        faces = drawing.set_up(data.nodes, guide.spheres, chosen, view)
        color, alpha, depth = drawing.draw(slices, faces, data.shaded.texels, view, "depth" in outputs)
    stats = {
        "milliseconds": 1e3 * (perf_counter() - began),
        "parts": len(chosen.slice_nodes),
        "slices": len(slices[2]),
        "triangles": len(faces[1]),
    }
    return make_frame(outputs, depth, color, alpha, stats)
