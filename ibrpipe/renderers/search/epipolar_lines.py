"""Maps of the line-coherent search: a field with bounds of its blocks, swept and cast along whole epipolar lines.

Used by the `epipolar` renderer, and by `ldi` for height fields. Source: schaufler1999; ``docs/renderers/epipolar.md``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np

from ibrpipe.core.epipolar import bounds, cast, lines, sweep
from ibrpipe.core.epipolar import patches as epipolar_patches
from ibrpipe.core.ldi import patches
from ibrpipe.core.ldi.quadtree import STEPS, plan_levels
from ibrpipe.renderers.background_compile import BackgroundCompile, Kernel
from ibrpipe.renderers.buffers import borrow
from ibrpipe.renderers.fields import Field, HeightField, PatchField
from ibrpipe.types import Array, Camera

#: greatest width of a line in the picture (pixels), least in the reference (cells), blocks per width of a line
SPACING, FINEST, COARSENESS = 3.0, 0.75, 0.75
#: depth that still belongs to the eye itself, where it touches a surface; share of a field's size
EYE = 1e-9

#: what a second process compiles at the first call
BACKGROUND = BackgroundCompile(
    (
        Kernel(
            "epipolar.cast", "cast_heights",
            "(Tuple((float32[::1], int64)), Tuple((uint32[::1], int64[:,::1], float64[::1])), "
            "Tuple((float64[::1], float64[:,::1])), float64[::1], float64, Tuple((float64[:,::1], float32[::1])), "
            "int64, int64, float32[:,::1], uint32[:,::1])",
        ),
    ),
    meanwhile=(  # colours of `ldi` and `epipolar`, then of `relief`
        Kernel(
            "ldi.shade", "shade_heights",
            "(float32[:,::1], uint32[:,::1], UniTuple(float64[:,::1], 2), int64, float64[::1], float64[:,::1], "
            "float32[:,:,::1], float32[:,:,::1], float32[:,::1])",
        ),
        Kernel(
            "relief.shade", "place_hits",
            "(float32[:,::1], uint32[:,::1], uint32, float64[::1], float64[:,::1], float64[:,:,::1])",
        ),
        Kernel(
            "relief.shade", "color_heights",
            "(boolean[:,::1], float64[:,:,::1], float32[:,:,::1], float32[:,:,::1], float32[:,::1])",
        ),
    ),
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class Map:
    """One field with the bounds of its blocks of cells.

    Attributes
    ----------
    field : HeightField or PatchField
    base : int
        Number of its first cell or patch.
    box : (4,) float64
        Columns and rows of cells, least and greatest depth.
    grid : (2,) float64
        Lowest depth of the bounds, depth per step.
    nodes, meta : see :mod:`ibrpipe.core.epipolar.bounds`
    starts : (cells + 1,) int64
        First patch of every cell; empty for height fields.
    """

    field: Field
    base: int
    box: Array
    grid: Array
    nodes: Array
    meta: Array
    starts: Array

    @property
    def bytes(self) -> int:
        """Bytes held beyond the field."""
        return self.nodes.nbytes + self.starts.nbytes


def height_map(field: HeightField, base: int) -> Map | None:
    """Bound the blocks of a height field whose first cell is number `base`; None where it holds nothing."""
    rows, columns = field.height.shape[0] - 1, field.height.shape[1] - 1
    low, high = float(np.fmin.reduce(field.low, axis=None)), float(np.fmax.reduce(field.high, axis=None))
    if not low <= high:
        return None
    BACKGROUND.begin()
    meta, grid, nodes = _empty_bounds(rows, columns, low, high, field.pose.slack)
    bounds.bound_heights(field.height, grid[0], 1.0 / grid[1], meta, nodes)
    bounds.bound_above(nodes, meta)
    pad = max(1e-6 * (high - low), 1e-9 * field.reach, field.pose.slack)  # rays that end on the surface end beyond it
    return Map(field, base, np.array([columns, rows, low - pad, high + pad]), grid, nodes, meta, np.empty(0, np.int64))


def patch_map(field: PatchField, base: int) -> Map | None:
    """Bound the blocks of a layered image's field whose first patch is number `base`; None where it holds nothing."""
    if len(field.corners) == 0:
        return None
    columns, rows = (int(n) + 1 for n in field.cells.max(axis=0))
    near, far = np.empty(len(field.corners)), np.empty(len(field.corners))
    patches.measure_patches(field.corners, field.masks, near, far)
    low, high = float(near.min()), float(far.max())
    counts = np.bincount(field.cells[:, 1].astype(np.int64) * columns + field.cells[:, 0], minlength=rows * columns)
    starts = np.concatenate([[0], np.cumsum(counts)])
    meta, grid, nodes = _empty_bounds(rows, columns, low, high, field.pose.slack)
    bounds.bound_patches(starts, near, far, grid[0], 1.0 / grid[1], meta, nodes)
    bounds.bound_above(nodes, meta)
    pad = max(1e-6 * (high - low), 1e-9 * max(abs(low), abs(high)), field.pose.slack)
    below, above = field.pose.limited(low, high, pad)
    return Map(field, base, np.array([columns, rows, below, above]), grid, nodes, meta, starts)


def _empty_bounds(rows: int, columns: int, low: float, high: float, slack: float) -> tuple[Array, Array, Array]:
    """Return meta, grid and unfilled nodes for a field of `rows` x `columns` cells, at least `slack` thick."""
    meta = plan_levels(rows, columns)
    pad = max(1e-6 * (high - low), 1e-9 * max(abs(low), abs(high)), slack, 1e-290)
    grid = np.array([low - pad, (high - low + 2.0 * pad) / STEPS])
    return meta, grid, np.empty(int(meta[-1, 0]) + 1, np.uint32)


def sweep_map(
    one: Map, camera: Camera, spacing: float = SPACING, finest: float = FINEST, coarseness: float = COARSENESS
) -> tuple[Array, Array]:
    """Lay the epipolar lines of one map and sweep them: (sectors, table) of :mod:`ibrpipe.core.epipolar.sweep`.

    The table is valid until the same thread sweeps another map.
    """
    start, directions = one.field.pose.field_from_pixel(camera)
    sectors, edges, entries = lines.lay_lines(
        start, directions, one.field.pose.pixel_from_field(camera), (one.box[0], one.box[1]),
        (camera.width, camera.height), spacing, finest, coarseness, (one.box[2], one.box[3]),
    )  # fmt: skip
    table = borrow("epipolar table", entries, np.float32, np.inf)
    table[0] = -np.inf
    groups = np.zeros(5, np.int64)
    groups[1:] = np.cumsum(-(-sectors[:, lines.LINES].astype(np.int64) // sweep.GROUP))
    if groups[4]:
        sweep.sweep_lines(
            sectors, edges, one.nodes, one.meta, one.grid, groups, numba.get_num_threads(), table
        )  # fmt: skip
    return sectors, table


def cast_map(one: Map, camera: Camera, depth: Array, ids: Array) -> int:
    """Lower `depth` and `ids` where one map is hit nearer; return how many lines were swept."""
    field, parts = one.field, numba.get_num_threads()
    pyramid, view, swept = (one.nodes, one.meta, one.grid), field.pose.field_from_pixel(camera), sweep_map(one, camera)
    eye = EYE * field.reach
    if isinstance(field, HeightField):
        BACKGROUND.wait()
        heights = (field.height.ravel(), field.height.shape[1])
        cast.cast_heights(heights, pyramid, view, one.box, eye, swept, one.base, parts, depth, ids)
    else:
        listed = (one.starts, field.corners, field.masks)
        epipolar_patches.cast_patches(listed, pyramid, view, one.box, eye, swept, one.base, parts, depth, ids)
    return int(swept[0][:, lines.LINES].sum())
