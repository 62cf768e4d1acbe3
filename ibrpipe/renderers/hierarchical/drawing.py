"""Draws what was selected: slices placed and lit, triangles set up, all composited tile by tile."""

from __future__ import annotations

import numba
import numpy as np

from ibrpipe.core.hierarchy import composite, order, slices, triangles
from ibrpipe.errors import RendererError
from ibrpipe.renderers.frames import limited_threads
from ibrpipe.renderers.hierarchical.nodes import Nodes
from ibrpipe.renderers.hierarchical.selection import Selection
from ibrpipe.renderers.hierarchical.shaded import ShadedSlices
from ibrpipe.renderers.hierarchical.view import View
from ibrpipe.types import Array, Frame
from ibrpipe.types.prerendered import Prerendered

#: slices and triangles that are set up on one thread: waiting for others costs more
FEW = 2_000
#: most triangles of a picture: 8 GB
MOST_TRIANGLES = 1 << 26

#: numbers, pixels and depths of slices
SliceList = tuple[Array, Array, Array]


def place(library: Prerendered, shaded: ShadedSlices, rows: Array, chosen: Selection, view: View) -> SliceList:
    """Return numbers (J, 14), pixels (J, 8), depths (J,) of all slices; `rows` (P,): nodes as the library's parts."""
    parts = rows[chosen.slice_nodes]
    levels, directions = len(library.resolutions), len(library.axes)
    keys = np.empty((len(parts), 2), np.int64)
    with limited_threads(0 if len(parts) > 10 * FEW else 1):
        slices.find_keys(parts, chosen.choices, chosen.slice_poses, view.lights, levels, directions, keys)
    firsts, peaks = shaded.find(keys, view.lighting)
    begin = library.stacks[keys[:, 0]]
    counts = library.stacks[keys[:, 0] + 1] - begin
    total = int(counts.sum())
    draws = np.stack([parts, chosen.choices, begin, np.cumsum(counts) - counts, firsts, keys[:, 1]], axis=1)
    numbers, pixels = np.empty((total, 14)), np.empty((total, 8), np.int64)
    depths = np.empty(total, np.float32)
    tables = (library.spheres, library.axes, library.resolutions, peaks, counts)
    with limited_threads(0 if total > FEW else 1):
        slices.place_slices(
            draws.astype(np.int64), chosen.slice_poses, tables, library.slabs, library.heights, library.means,
            (view.calibration, np.array(view.size, np.float64)), view.lights, view.lighting, numbers, pixels, depths,
        )  # fmt: skip
    return numbers, pixels, depths


def set_up(nodes: Nodes, spheres: Array, chosen: Selection, view: View) -> tuple[Array, Array]:
    """Return numbers (T, 21) and boxes (T, 4) of all triangles.

    Raises
    ------
    RendererError
        There are too many.
    """
    drawn, poses = chosen.polygon_nodes, chosen.polygon_poses
    centers = spheres[drawn]
    depth = np.einsum("ni,ni->n", poses[:, 8:11], centers[:, :3]) + poses[:, 11]
    reach = centers[:, 3] * np.sqrt((poses.reshape(-1, 3, 4)[:, :, :3] ** 2).sum(axis=(1, 2)))
    steps = np.where(depth - reach <= view.near, 2, 1)
    faces = nodes.faces[drawn + 1] - nodes.faces[drawn]
    made = faces * steps
    if made.sum() > MOST_TRIANGLES:
        raise RendererError(
            f"{made.sum():,} triangles are in view; at most {MOST_TRIANGLES:,}: draw parts from slices, or raise "
            "pixel_error"
        )
    draws = np.stack([drawn, nodes.faces[drawn], faces, np.cumsum(made) - made, steps], axis=1)
    numbers, boxes = np.empty((int(made.sum()), 21), np.float32), np.empty((int(made.sum()), 4), np.int64)
    limits = np.array([*view.size, view.near])
    with limited_threads(0 if len(boxes) > FEW else 1):
        triangles.emit_triangles(
            draws.astype(np.int64), poses, nodes.corners, nodes.paints, nodes.materials, (view.calibration, limits),
            view.lights, view.lighting, numbers, boxes,
        )  # fmt: skip
    return numbers, boxes


def sort_into_tiles(sequence: Array, boxes: Array, size: tuple[int, int]) -> tuple[Array, Array]:
    """Return starts (T + 1,) and items (E,) int64 of the tiles of a picture, each in the order of `sequence`."""
    columns, rows = (-(-each // order.TILE) for each in size)
    starts = np.zeros(columns * rows + 1, np.int64)
    items = np.empty(order.count_tiles(sequence, boxes, columns, starts), np.int64)
    order.fill_tiles(sequence, boxes, columns, starts, items)
    return starts, items


def draw(
    slice_list: SliceList,
    faces: tuple[Array, Array],
    texels: Array,
    view: View,
    noted: bool,
    captured: Frame | None = None,
) -> tuple[Array, Array, Array]:
    """Return straight colour (H, W, 3), coverage (H, W) and, where `noted`, depth (H, W).

    `captured`: what other renderers drew of the same view; it is put among slices and polygons by its depth.
    """
    numbers, pixels, depths = slice_list
    width, height = view.size
    sequence = np.empty(len(depths), np.int64)
    order.sort_depths(depths, sequence)
    starts, items = sort_into_tiles(sequence, pixels, view.size)
    face_starts, face_items = sort_into_tiles(np.arange(len(faces[1])), faces[1], view.size)
    load = np.diff(starts) + np.diff(face_starts)
    tiles = np.argsort(-load, kind="stable")
    color, alpha = np.empty((height, width, 3), np.float32), np.empty((height, width), np.float32)
    depth = np.empty((height, width) if noted else (0, 0), np.float32)
    nothing = (np.empty((0, 0, 3), np.float32), np.empty((0, 0), np.float32), np.empty((0, 0), np.float32))
    between = nothing if captured is None else (captured.color, captured.alpha, captured.depth)
    composite.draw_tiles(
        tiles, numba.get_num_threads(), np.array([-(-width // order.TILE), width, height]),
        (starts, items, numbers, pixels, depths), texels, (face_starts, face_items, *faces), between, noted,
        color, alpha, depth,
    )  # fmt: skip
    return color, alpha, depth
