"""Walks a scene's hierarchy and decides what is drawn from slices and what as polygons."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ibrpipe.core.hierarchy import traverse
from ibrpipe.renderers.hierarchical.nodes import Nodes
from ibrpipe.types import Array


@dataclass(frozen=True, eq=False)
class Guide:
    """What the walk looks at: of every node its sphere, whether it has slices, and whether it has triangles.

    Attributes
    ----------
    spheres : (P, 4) float64
    kinds : (P, 2) int64
        Has slices; number of its own triangles.
    costs : (P, L) float32
        Time to draw its slices over the time to draw its triangles.
    resolutions : (L,) int64
    lookup : (CELLS, CELLS) int32
    """

    spheres: Array
    kinds: Array
    costs: Array
    resolutions: Array
    lookup: Array


@dataclass(frozen=True, eq=False)
class Selection:
    """What is drawn, in a fixed order: nodes (N,) int32, poses (N, 12) float64, and of slices the choice (N,) int32."""

    slice_nodes: Array
    slice_poses: Array
    choices: Array
    polygon_nodes: Array
    polygon_poses: Array


def select(nodes: Nodes, guide: Guide, pose: Array, limits: Array) -> Selection:
    """Decide for every copy in view; `pose` (12,) is that of the root."""
    here, poses = np.array([nodes.root], np.int32), pose.reshape(1, 12)
    slices, polygons = [], []
    while len(here):
        action, choice = np.empty(len(here), np.int8), np.empty(len(here), np.int32)
        traverse.classify(
            here, poses, guide.spheres, guide.kinds, guide.costs, guide.resolutions, guide.lookup, limits, action, choice
        )
        drawn, flat, apart = (np.flatnonzero(action == n) for n in (traverse.SLICES, traverse.POLYGONS, traverse.PARTS))
        slices.append((here[drawn], poses[drawn], choice[drawn]))
        polygons.append((here[flat], poses[flat]))
        firsts = nodes.copies[here[apart]]
        counts = nodes.copies[here[apart] + 1] - firsts
        parents = np.repeat(apart, counts)
        copies = np.arange(len(parents)) + np.repeat(firsts - np.cumsum(counts) + counts, counts)
        inner, moved = np.empty(len(parents), np.int32), np.empty((len(parents), 12))
        traverse.expand(parents, copies, poses, nodes.children, nodes.matrices, inner, moved)
        here, poses = inner, moved
    return Selection(
        *(np.concatenate(each) for each in zip(*slices)), *(np.concatenate(each) for each in zip(*polygons))
    )
