"""Makes the prefiltered slices of a scene's parts."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor, Future
from dataclasses import dataclass, replace
from time import perf_counter
from typing import Any

import numpy as np

from ibrpipe.core.hierarchy import prefilter as kernels
from ibrpipe.core.hierarchy.compose import compose
from ibrpipe.core.hierarchy.directions import nearest_table
from ibrpipe.errors import ValueRangeError
from ibrpipe.renderers.hierarchical.nodes import Nodes
from ibrpipe.renderers.hierarchical.stacks import Stacks, join_stacks, packed_stacks
from ibrpipe.types import Array
from ibrpipe.types.prerendered import Prerendered, view_axes

#: texels across a part, in steps of about 1.4
RESOLUTIONS = (2, 3, 4, 6, 8, 11, 16, 23, 32, 45, 64)
#: polygons above which a part's slices are made from those of its copies
MOST_POLYGONS = 250_000
#: texels of a copy per texel of what is made from it, and places along a side of such a texel
FINENESS, COMPOSED_RAYS = 1.4, 2
#: texels a slab of what is made from copies has at most: cells of trees are flat, and thick slabs keep the height that
#: they have in the picture from their direction, so that neighbours leave gaps or overlap from others
COMPOSED_SLAB = 2.0
#: texels across a part up to which there are more rays a texel: as many across the part as here
FINE_RAYS = 16
#: texels: what is thinner counts in one slab alone
THIN = 1.0
#: directions that choices of the traversal can name; texels of a library, and of a part at one resolution
MOST_DIRECTIONS, MOST_TEXELS = (1 << 16) - 1, 1 << 31


@dataclass(frozen=True)
class Slicing:
    """How parts are sliced: directions, texels per slab, rays along a side of a texel, finest resolution.

    Raises
    ------
    ValueRangeError
        A number that nothing can be sliced by, or more than 2^31 texels of one part.
    """

    directions: int = 128
    slab_texels: float = 6.0
    rays: int = 4
    finest: int = 32

    def __post_init__(self) -> None:
        bounds = {"directions": MOST_DIRECTIONS, "slab_texels": RESOLUTIONS[-1], "rays": 64, "finest": RESOLUTIONS[-1]}
        for name, most in bounds.items():
            least = {"slab_texels": 0.1, "finest": RESOLUTIONS[0]}.get(name, 1)
            if not least <= getattr(self, name) <= most:
                raise ValueRangeError(f"{name} of slices is {getattr(self, name)}; it may be {least} to {most}")
        dense = self.directions * self.slabs(self.finest) * self.finest**2
        if dense > MOST_TEXELS:
            raise ValueRangeError(
                f"{self.directions} directions of {self.finest}^2 texels in {self.slabs(self.finest)} slabs "
                f"are {dense:,} texels of one part; at most {MOST_TEXELS:,}: take fewer or coarser ones"
            )

    def slabs(self, resolution: int) -> int:
        """Number of slabs of a stack."""
        return max(1, round(resolution / self.slab_texels))


def prerender_nodes(
    nodes: Nodes,
    slicing: Slicing,
    overlaps: dict[str, float] | None = None,
    composed: bool = True,
    pool: Executor | None = None,
) -> Prerendered:
    """Slice every node that occurs more than once.

    Parameters
    ----------
    nodes : Nodes
    slicing : Slicing
    overlaps : by name, texels by which a slab goes on into the one behind it; 0 where not named
    composed : whether large nodes are sliced, too: from the slices of their copies
    pool : takes the parts that are sliced from polygons, one by one; without it they are sliced in turn
    """
    began = perf_counter()
    chosen = [
        node
        for node in range(len(nodes.names))
        if nodes.uses[node] > 1 and nodes.triangles[node] > 0 and (composed or not is_composed(nodes, node))
    ]
    axes = view_axes(slicing.directions)
    resolutions = [each for each in RESOLUTIONS if each <= slicing.finest]
    painted = [nodes.paints[nodes.faces[node] : nodes.faces[node + 1]].max(initial=0.0) for node in chosen]
    scale = float(max([1e-6, *painted]))
    rule, spheres = overlaps or {}, enclosing_spheres(nodes, chosen)
    submit = _in_turn if pool is None else pool.submit
    sliced = {
        node: submit(
            _slice_node, nodes.flattened(node), spheres[number], axes, resolutions, slicing, scale,
            rule.get(nodes.names[node], 0.0), number,
        )
        for number, node in enumerate(chosen)
        if not is_composed(nodes, node)
    }  # fmt: skip
    stacks: list[Stacks] = []
    for number, node in enumerate(chosen):
        if node in sliced:
            stacks += sliced.pop(node).result()
        else:
            library = (spheres, np.array(resolutions, np.int64), *join_stacks(stacks, len(axes)))
            stacks += _compose_node(_sliced_copies(nodes, node, chosen), axes, library, slicing, number)
        _check_total(stacks, len(chosen))
    return Prerendered(
        tuple(nodes.names[node] for node in chosen),
        spheres,
        np.array(resolutions, np.int64),
        axes,
        *join_stacks(stacks, len(axes)),
        scale,
        np.array([rule.get(nodes.names[node], 0.0) for node in chosen]),
        {"seconds": perf_counter() - began},
    )


def _in_turn(work: Callable[..., list[Stacks]], *given: Any) -> Future[list[Stacks]]:
    """A unit that is done at once, as an executor's that has finished."""
    done: Future[list[Stacks]] = Future()
    done.set_result(work(*given))
    return done


def _check_total(stacks: list[Stacks], parts: int) -> None:
    total = sum(len(each.texels) for each in stacks)
    if total > MOST_TEXELS:
        raise ValueRangeError(
            f"{stacks[-1].part + 1} of {parts} parts have {total:,} texels of slices; at most {MOST_TEXELS:,}: take "
            "fewer directions or a coarser finest resolution, or join parts"
        )


def is_composed(nodes: Nodes, node: int) -> bool:
    """Whether a node's slices are made from those of its copies."""
    return bool(nodes.triangles[node] > MOST_POLYGONS and nodes.copies[node + 1] > nodes.copies[node])


def _sliced_copies(nodes: Nodes, node: int, chosen: list[int]) -> tuple[Array, Array]:
    """Rows (C,) int64 among `chosen`, and matrices (C, 12), of a node's copies that have slices."""
    held = slice(nodes.copies[node], nodes.copies[node + 1])
    row_of = {child: row for row, child in enumerate(chosen)}
    rows = np.array([row_of.get(int(child), -1) for child in nodes.children[held]], np.int64)
    return rows[rows >= 0], nodes.matrices[held][rows >= 0]


def enclosing_spheres(nodes: Nodes, chosen: Sequence[int]) -> Array:
    """(N, 4) float64: spheres around nodes, children before parents; 0 where there is nothing.

    Those of large parts are around the boxes of their copies, whose nodes must be among `chosen`.
    """
    boxes: dict[int, Array] = {}
    spheres = np.zeros((len(chosen), 4))
    for row, node in enumerate(chosen):
        points = _copied_boxes(nodes, node, boxes) if is_composed(nodes, node) else nodes.flattened(node)[0]
        if points.size:
            spheres[row] = bounding_sphere(points)
            boxes[node] = np.stack([points.min(axis=(0, 1)), points.max(axis=(0, 1))])
    return spheres


def _copied_boxes(nodes: Nodes, node: int, boxes: dict[int, Array]) -> Array:
    """Corners (C, 8, 3) of the boxes (2, 3) of a node's copies, under their matrices."""
    held = [n for n in range(nodes.copies[node], nodes.copies[node + 1]) if int(nodes.children[n]) in boxes]
    which = np.array([[n >> 2 & 1, n >> 1 & 1, n & 1] for n in range(8)])
    inner = np.array([boxes[int(nodes.children[n])] for n in held]).reshape(-1, 2, 3)
    matrices = nodes.matrices[held].reshape(-1, 3, 4)
    corners = np.take_along_axis(inner, which[None], axis=1)
    return corners @ matrices[:, :, :3].transpose(0, 2, 1) + matrices[:, None, :, 3]


def _compose_node(
    copies: tuple[Array, Array], axes: Array, library: tuple[Array, ...], slicing: Slicing, part: int
) -> list[Stacks]:
    """Stacks of a part from those of its copies: their rows in the library so far, and matrices."""
    spheres, resolutions, stacks, slabs, heights, _, texels = library
    given, lookup, found = (spheres, resolutions, stacks, slabs, heights, texels), nearest_table(axes), []
    for resolution in resolutions:
        count = replace(slicing, slab_texels=min(slicing.slab_texels, COMPOSED_SLAB)).slabs(int(resolution))
        rays = COMPOSED_RAYS if resolution > 8 else 2 * COMPOSED_RAYS
        dense = np.zeros((len(axes), count, resolution, resolution, kernels.TEXEL), np.uint8)
        levels = np.empty((len(axes), count, 2), np.float32)
        compose(copies, spheres[part], axes, lookup, given, FINENESS, rays, dense, levels)
        found.append(packed_stacks(part, dense, levels))
    return found


def bounding_sphere(corners: Array) -> Array:
    """(4,) float64: centre of the box around (..., 3) corners, and how far they reach from it."""
    points = corners.reshape(-1, 3)
    center = 0.5 * (points.min(axis=0) + points.max(axis=0))
    return np.append(center, np.linalg.norm(points - center, axis=1).max() * (1 + 1e-6))


def face_normals_of(corners: Array) -> Array:
    """Unit normals (F, 3) float32 of triangles given by (F, 3, 3) corners; 0 where they have no area."""
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    return (normals / np.where(lengths > 0, lengths, 1.0)).astype(np.float32)


def _slice_node(
    mesh: tuple[Array, Array],
    sphere: Array,
    axes: Array,
    resolutions: list[int],
    slicing: Slicing,
    scale: float,
    overlap: float,
    part: int,
) -> list[Stacks]:
    """Stacks of a part from its polygons: corners and paints (F, 3, 3)."""
    corners, paints = mesh
    normals, tops = face_normals_of(corners), np.empty((0, 0, 0, 0), np.float32)
    local, paints = (corners - sphere[:3]).astype(np.float32), np.ascontiguousarray(paints, np.float32)
    found = []
    for resolution in resolutions:
        slabs, rays = slicing.slabs(resolution), max(slicing.rays, -(-FINE_RAYS * slicing.rays // resolution))
        dense = np.zeros((len(axes), slabs, resolution, resolution, kernels.TEXEL), np.uint8)
        heights = np.empty((len(axes), slabs, 2), np.float32)
        kernels.prefilter(
            local, paints, normals, axes, sphere[3], rays, 1.0 / scale, overlap, THIN, dense, heights, tops
        )
        found.append(packed_stacks(part, dense, heights))
    return found
