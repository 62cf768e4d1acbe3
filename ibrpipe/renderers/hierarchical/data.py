"""What the `hierarchical` renderer builds once of a scene."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ibrpipe.errors import RendererError
from ibrpipe.renderers.hierarchical.captured import CapturedThing, captured_things
from ibrpipe.renderers.hierarchical.coverage import make_slices
from ibrpipe.renderers.hierarchical.guide import Guide, build_guide, changed_part
from ibrpipe.renderers.hierarchical.nodes import Nodes, scene_nodes
from ibrpipe.renderers.hierarchical.orthogonal_views import RESOLUTION, orthogonal_views
from ibrpipe.renderers.hierarchical.prefiltering import Slicing, is_composed
from ibrpipe.renderers.hierarchical.shaded import ShadedSlices
from ibrpipe.renderers.hierarchical.shadows import ShadowMaps
from ibrpipe.types import Lighting, Scene
from ibrpipe.types.prerendered import OrthogonalViews, Prerendered, PrerenderedScene

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
    captured : tuple of CapturedThing
    alone : int or None
        Node that is drawn alone; None = the scene is drawn.
    """

    nodes: Nodes
    library: Prerendered
    guide: Guide
    lighting: Lighting
    captured: tuple[CapturedThing, ...] = ()
    alone: int | None = None

    @property
    def bytes(self) -> int:
        """Bytes held beyond the scene."""
        return (
            self.nodes.bytes
            + self.library.bytes
            + self.shaded.bytes
            + sum(each.bytes for each in self.partly_shaded.values())
            + sum(each.bytes for each in self.maps.values())
            + sum(each.prepared.bytes for each in self.captured)
        )

    @cached_property
    def shaded(self) -> ShadedSlices:
        """Slices that have been lit."""
        return self._unlit()

    @cached_property
    def partly_shaded(self) -> dict[int, ShadedSlices]:
        """Slices lit by some of the lights, by a number that stands for them; filled by what draws shadows."""
        return {}

    @cached_property
    def maps(self) -> dict[tuple[object, ...], ShadowMaps]:
        """What lights and the sky see, by what they were drawn with; kept as long as the scene."""
        return {}

    def shaded_by(self, part: int) -> ShadedSlices:
        """Slices lit by some of the lights: a cache for each number of `partly_shaded`."""
        if part not in self.partly_shaded:
            self.partly_shaded[part] = self._unlit()
        return self.partly_shaded[part]

    def _unlit(self) -> ShadedSlices:
        number = {name: node for node, name in enumerate(self.nodes.names)}
        materials = np.array([self.nodes.materials[number[name]] for name in self.library.names]).reshape(-1, 2)
        return ShadedSlices(self.library, materials)

    @cached_property
    def polygons_only(self) -> Guide:
        """The guide of a walk that takes everything apart."""
        return replace(self.guide, kinds=self.guide.kinds * (0, 1))

    @cached_property
    def views(self) -> OrthogonalViews:
        """Six views of every part, for the published method."""
        return self.library.views or orthogonal_views(self.nodes, self.library)

    @cached_property
    def published(self) -> Guide:
        """The guide of a walk that knows one resolution of every part."""
        kinds = self.guide.kinds.copy()
        kinds[[is_composed(self.nodes, node) for node in range(len(kinds))], 0] = 0
        return replace(
            self.guide, kinds=kinds, costs=np.zeros_like(self.guide.costs[:, :1]), resolutions=np.array([RESOLUTION])
        )

    @property
    def shown(self) -> int:
        """Node that is drawn."""
        return self.nodes.root if self.alone is None else self.alone

    @property
    def radius(self) -> float:
        """Radius of what is drawn."""
        return float(self.guide.spheres[self.shown, 3])


def prepare(sources: tuple[Scene | PrerenderedScene, ...]) -> HierarchicalData:
    """Lay out a scene; slices are made with the usual settings where none are brought.

    Raises
    ------
    RendererError
        Several scenes, more lights than can be told apart, slices of another scene, or captured things that are
        mirrored, sheared or stretched.
    """
    if len(sources) > 1:
        raise RendererError(f"renderer 'hierarchical' draws one scene at a time, got {len(sources)}; make one of them")
    scene = sources[0].scene if isinstance(sources[0], PrerenderedScene) else sources[0]
    if len(scene.lighting.lights) > MOST_LIGHTS:
        raise RendererError(
            f"the scene has {len(scene.lighting.lights)} lights; at most {MOST_LIGHTS} are drawn; "
            "join lights of nearly one direction, or count weak ones as ambient light"
        )
    nodes = scene_nodes(scene)
    if isinstance(sources[0], PrerenderedScene):
        library = sources[0].library
        foreign = sorted(set(library.names) - set(nodes.names))
        if foreign:
            raise RendererError(f"the slices are of another scene: it has no part {foreign[0]!r}; prerender this one")
        changed = changed_part(nodes, library)
        if changed is not None:
            raise RendererError(
                f"the slices are of another scene: part {changed!r} is larger, smaller or elsewhere in this one; "
                "prerender this one"
            )
    else:
        library = make_slices(nodes, Slicing())
    return HierarchicalData(nodes, library, build_guide(nodes, library), scene.lighting, captured_things(scene))
