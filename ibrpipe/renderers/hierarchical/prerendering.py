"""Makes the slices of a scene, with slabs that overlap where they would leak."""

from __future__ import annotations

from concurrent.futures import Executor
from dataclasses import replace
from time import perf_counter

from ibrpipe.renderers.hierarchical.coverage import choose_coverage, measure_leaks
from ibrpipe.renderers.hierarchical.nodes import Nodes
from ibrpipe.renderers.hierarchical.prefiltering import Slicing, prerender_nodes
from ibrpipe.types.prerendered import Prerendered


def make_slices(nodes: Nodes, slicing: Slicing, pool: Executor | None = None) -> Prerendered:
    """The slices of nodes whose slabs overlap where they would leak; `pool` takes the parts one by one."""
    began = perf_counter()
    choice = choose_coverage(nodes, slicing)
    library = prerender_nodes(nodes, slicing, choice.overlaps, pool=pool)
    leaks = {name: (leak, choice.leaks[name][1]) for name, leak in measure_leaks(nodes, library).items()}
    return replace(library, info={"seconds": perf_counter() - began, "leaks": leaks})
