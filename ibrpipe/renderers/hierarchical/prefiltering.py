"""Makes the prefiltered slices of a scene's parts."""

from __future__ import annotations

from dataclasses import dataclass
from time import perf_counter

import numpy as np

from ibrpipe.core.hierarchy import prefilter as kernels
from ibrpipe.renderers.hierarchical.nodes import Nodes
from ibrpipe.types import Array
from ibrpipe.types.prerendered import Prerendered, view_axes

#: texels across a part, in steps of about 1.4
RESOLUTIONS = (2, 3, 4, 6, 8, 11, 16, 23, 32, 45, 64)
#: polygons above which a part is not flattened
MOST_POLYGONS = 4_000_000


@dataclass(frozen=True)
class Slicing:
    """How parts are sliced: directions, texels per slab, rays along a side of a texel."""

    directions: int = 128
    slab_texels: float = 6.0
    rays: int = 4
    finest: int = 32


def prerender_nodes(nodes: Nodes, slicing: Slicing, overlaps: dict[str, float] | None = None) -> Prerendered:
    """Slice every node that occurs more than once.

    Parameters
    ----------
    nodes : Nodes
    slicing : Slicing
    overlaps : by name, what share of a slab the slab in front of it holds, too; 0 where not named
    """
    began = perf_counter()
    chosen = [
        node for node in range(len(nodes.names)) if nodes.uses[node] > 1 and 0 < nodes.triangles[node] <= MOST_POLYGONS
    ]
    axes = view_axes(slicing.directions)
    resolutions = [each for each in RESOLUTIONS if each <= slicing.finest]
    flat = {node: nodes.flattened(node) for node in chosen}
    scale = max([1e-6, *(float(paints.max()) for _, paints in flat.values())])
    rule = overlaps or {}
    parts = [
        _slice_node(*flat[node], axes, resolutions, slicing, scale, rule.get(nodes.names[node], 0.0), number)
        for number, node in enumerate(chosen)
    ]
    joined = _join([stack for part in parts for stack in part[1]], len(axes))
    return Prerendered(
        tuple(nodes.names[node] for node in chosen),
        np.array([part[0] for part in parts]).reshape(-1, 4),
        np.array(resolutions, np.int64),
        axes,
        *joined,
        scale,
        np.array([rule.get(nodes.names[node], 0.0) for node in chosen]),
        {"seconds": perf_counter() - began},
    )


@dataclass(frozen=True)
class _Stacks:
    """Slices of one part at one resolution: boxes (D, K, 4), heights (D, K), means (D, K, 12), texels (N, 12)."""

    part: int
    boxes: Array
    heights: Array
    means: Array
    texels: Array


def bounding_sphere(corners: Array) -> Array:
    """(4,) float64: centre of the box around (F, 3, 3) corners, and how far they reach from it."""
    points = corners.reshape(-1, 3)
    center = 0.5 * (points.min(axis=0) + points.max(axis=0))
    return np.append(center, np.linalg.norm(points - center, axis=1).max() * (1 + 1e-6))


def face_normals_of(corners: Array) -> Array:
    """Unit normals (F, 3) float32 of triangles given by (F, 3, 3) corners; 0 where they have no area."""
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    return (normals / np.where(lengths > 0, lengths, 1.0)).astype(np.float32)


def _slice_node(
    corners: Array,
    paints: Array,
    axes: Array,
    resolutions: list[int],
    slicing: Slicing,
    scale: float,
    overlap: float,
    part: int,
) -> tuple[Array, list[_Stacks]]:
    sphere = bounding_sphere(corners)
    normals, tops = face_normals_of(corners), np.empty((0, 0, 0, 0), np.float32)
    local, paints = (corners - sphere[:3]).astype(np.float32), np.ascontiguousarray(paints, np.float32)
    found = []
    for resolution in resolutions:
        slabs = max(1, round(resolution / slicing.slab_texels))
        rays = slicing.rays if resolution > 8 else 2 * slicing.rays
        dense = np.zeros((len(axes), slabs, resolution, resolution, kernels.TEXEL), np.uint8)
        heights = np.empty((len(axes), slabs), np.float32)
        kernels.prefilter(local, paints, normals, axes, sphere[3], rays, 1.0 / scale, overlap, dense, heights, tops)
        boxes = np.empty((len(axes), slabs, 4), np.int32)
        kernels.trim(dense, boxes)
        sizes = boxes[..., 2].astype(np.int64) * boxes[..., 3]
        offsets = (np.cumsum(sizes) - sizes.ravel()).reshape(sizes.shape)
        texels, means = np.empty((int(sizes.sum()), kernels.TEXEL), np.uint8), np.empty((*sizes.shape, 12), np.float32)
        kernels.pack(dense, boxes, offsets, texels, means)
        found.append(_Stacks(part, boxes, heights, means, texels))
    return sphere, found


def _join(stacks: list[_Stacks], directions: int) -> tuple[Array, Array, Array, Array, Array]:
    """Stacks of all parts, by part, resolution, direction -> first slabs, slabs, heights, means, texels."""
    counts, slabs, heights, means = [np.zeros(1, np.int64)], [], [], []
    base = 0
    for each in stacks:
        kept = each.boxes[..., 2] > 0
        sizes = each.boxes[..., 2].astype(np.int64) * each.boxes[..., 3]
        firsts = base + np.cumsum(sizes) - sizes.ravel()
        bordered = np.where(kept, (each.boxes[..., 2] + 2) * (each.boxes[..., 3] + 2), 0).astype(np.int64)
        within = np.cumsum(bordered, axis=1) - bordered
        rows = np.concatenate(
            [
                each.boxes.reshape(-1, 4),
                firsts[:, None],
                within.reshape(-1, 1),
                np.full((sizes.size, 1), each.part),
            ],
            axis=1,
        )
        counts.append(kept.sum(axis=1))
        slabs.append(rows[kept.ravel()])
        heights.append(each.heights[kept])
        means.append(each.means[kept])
        base += len(each.texels)
    texels = [each.texels for each in stacks]
    return (
        np.cumsum(np.concatenate(counts), dtype=np.int64),
        np.concatenate([np.zeros((0, 7), np.int64), *slabs]).astype(np.int64),
        np.concatenate([np.zeros(0, np.float32), *heights]),
        np.concatenate([np.zeros((0, 12), np.float32), *means]),
        np.concatenate([np.zeros((0, 12), np.uint8), *texels]),
    )
