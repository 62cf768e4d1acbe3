"""Walks a scene's hierarchy and decides what is drawn from slices and what as polygons."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ibrpipe.core.hierarchy import traverse
from ibrpipe.errors import RendererError
from ibrpipe.renderers.frames import limited_threads
from ibrpipe.renderers.hierarchical.guide import Guide
from ibrpipe.renderers.hierarchical.nodes import Nodes
from ibrpipe.types import Array


@dataclass(frozen=True, eq=False)
class Selection:
    """What is drawn, in a fixed order: nodes (N,) int32, poses (N, 12) float64, and of slices the choice (N,) int32."""

    slice_nodes: Array
    slice_poses: Array
    choices: Array
    polygon_nodes: Array
    polygon_poses: Array


#: copies that are looked at on one thread: waiting for others costs more
FEW = 20_000
#: most copies of one level: about 2 GB
MOST = 1 << 24


def select(nodes: Nodes, guide: Guide, here: Array, poses: Array, limits: Array) -> Selection:
    """Decide for every copy in view of the nodes `here` (N,) int32 at `poses` (N, 12) float64."""
    slices, polygons = [], []
    while len(here):
        action, choice = np.empty(len(here), np.int8), np.empty(len(here), np.int32)
        with limited_threads(0 if len(here) > FEW else 1):
            traverse.classify(
                here, poses, guide.spheres, guide.kinds, guide.costs, guide.resolutions, guide.lookup, limits, action,
                choice,
            )  # fmt: skip
        drawn, flat, apart = (np.flatnonzero(action == n) for n in (traverse.SLICES, traverse.POLYGONS, traverse.PARTS))
        slices.append((here[drawn], poses[drawn], choice[drawn]))
        polygons.append((here[flat], poses[flat]))
        here, poses = copies_of(nodes, here, poses, apart)
    return Selection(
        *(np.concatenate(each) for each in zip(*slices)), *(np.concatenate(each) for each in zip(*polygons))
    )


def copies_of(nodes: Nodes, here: Array, poses: Array, apart: Array) -> tuple[Array, Array]:
    """Nodes (M,) int32 and poses (M, 12) of the copies that `here[apart]` (N,) hold; `poses` are those of `here`.

    Raises
    ------
    RendererError
        There are too many.
    """
    firsts = nodes.copies[here[apart]]
    counts = nodes.copies[here[apart] + 1] - firsts
    if counts.sum() > MOST:
        raise RendererError(
            f"a level of the hierarchy has {counts.sum():,} copies in view; at most {MOST:,}: put copies into parts, "
            "which are drawn from slices where they are small, or raise pixel_error"
        )
    parents = np.repeat(apart, counts)
    copies = np.arange(len(parents)) + np.repeat(firsts - np.cumsum(counts) + counts, counts)
    inner, moved = np.empty(len(parents), np.int32), np.empty((len(parents), 12))
    with limited_threads(0 if len(parents) > FEW else 1):
        traverse.expand(parents, copies, poses, nodes.children, nodes.matrices, inner, moved)
    return inner, moved
