"""Makes the slices of a scene, with slabs that overlap where they would leak."""

from __future__ import annotations

from dataclasses import replace
from time import perf_counter

from ibrpipe.renderers.hierarchical.coverage import choose_coverage, measure_leaks
from ibrpipe.renderers.hierarchical.nodes import Nodes, scene_nodes
from ibrpipe.renderers.hierarchical.prefiltering import Slicing, prerender_nodes
from ibrpipe.types import Scene
from ibrpipe.types.prerendered import Prerendered, PrerenderedScene


def prerender(scene: Scene, slicing: Slicing | None = None) -> PrerenderedScene:
    """Slice every part that occurs more than once; `ibrpipe.render` takes the result as it takes the scene.

    Parameters
    ----------
    scene : Scene
    slicing : Slicing, optional
        Directions, thickness of slabs, rays, finest resolution.
    """
    return PrerenderedScene(scene, prerender_all(scene_nodes(scene), slicing or Slicing()))


def prerender_all(nodes: Nodes, slicing: Slicing) -> Prerendered:
    """The slices of nodes whose slabs overlap where they would leak."""
    began = perf_counter()
    choice = choose_coverage(nodes, slicing)
    library = prerender_nodes(nodes, slicing, choice.overlaps)
    leaks = {name: (leak, choice.leaks[name][1]) for name, leak in measure_leaks(nodes, library).items()}
    return replace(library, info={"seconds": perf_counter() - began, "leaks": leaks})
