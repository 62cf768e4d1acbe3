"""Pre-warping one relief texture into one face: what is needed of it, in what order, by which method."""

from __future__ import annotations

import threading
from dataclasses import dataclass

import numpy as np

from ibrpipe.core.prewarp import area as prewarp_area
from ibrpipe.core.prewarp import columns as prewarp_columns
from ibrpipe.core.prewarp import pipelined
from ibrpipe.core.prewarp import rows as prewarp
from ibrpipe.core.prewarp.rows import PAD
from ibrpipe.errors import RendererError
from ibrpipe.renderers.background_compile import BackgroundCompile, Kernel
from ibrpipe.renderers.prewarp.faces import MOST, Face, Sight, source_range
from ibrpipe.renderers.prewarp.source import Relief
from ibrpipe.types import Array

#: magnification above which texels count as near the eye's plane
CAREFUL = 1e3

#: rows between blocks of columns, so that these do not fall on one place of the cache
ODD = 5

_NONE8, _NONE = np.empty((0, 0), np.uint8), np.empty(0, np.float32)


_MEMORY = threading.local()


def scratch(name: str, shape: tuple[int, ...], kind: type = np.float32) -> Array:
    """Return working memory of a shape that this thread's next call with the same name takes over."""
    size = int(np.prod(shape))
    if len(getattr(_MEMORY, name, ())) < size:
        setattr(_MEMORY, name, np.empty(size, kind))
    memory: Array = getattr(_MEMORY, name)
    return memory[:size].reshape(shape)


#: what a second process compiles at the first call of `two-pass`
BACKGROUND = BackgroundCompile(
    (
        Kernel(
            "prewarp.columns", "warp_columns",
            "(float32[:,:,::1], uint8[:,::1], float32[:,::1], boolean, float64, float64, int64[:,::1], int64, "
            "float32[:,::1])",
        ),
        Kernel(
            "prewarp.view", "view_color",
            "(float32[:,::1], float32[:,::1], uint8[:,::1], int64, float64[:,::1], float64[::1], float32[:,::1], "
            "int64[::1], float32[:,:,::1], float32[:,::1])",
        ),
    ),
    meanwhile=(
        Kernel(
            "prewarp.view", "view_depth",
            "(float32[::1], int64, float64[:,::1], float64[::1], float64, boolean, float32[:,::1])",
        ),
    ),
)  # fmt: skip


@dataclass(frozen=True)
class Settings:
    """How textures are warped: method "two-pass" or "pipelined", heights as 8 bits or 32, sampled or averaged."""

    method: str = "two-pass"
    depth_bits: int = 32
    area: bool = False


@dataclass(frozen=True, eq=False)
class Plan:
    """What of a texture reaches a face, and in what order.

    Attributes
    ----------
    rows, texels : (first, last) that can reach the window
    lines : (3, H) float32
        A row's second coordinate is lines[0] + lines[1] * (what the first pass carries); its shift lines[2] (wall).
    shifts : (H,) float32 or empty
        Shift of every row of a wall.
    eye : (3,) float64: e_u, h from the plane, depth of the plane
    most : float
        Greatest magnification.
    order : int
        1: rows ascend toward the eye, -1: they descend, 0: from both sides toward the foot.
    """

    rows: tuple[int, int]
    texels: tuple[int, int]
    lines: Array
    shifts: Array
    eye: Array
    least: float
    most: float
    order: int


def warp_face(
    relief: Relief, view: Sight, face: Face, settings: Settings = Settings()
) -> tuple[Array, int, int, int] | None:
    """Pre-warp a relief texture into one face.

    Returns
    -------
    shifts : (rows, stride) float32
        g of every pixel of the face's window; NaN = nothing. Working memory: the next call overwrites it.
    left, top, columns : int
        Face pixel of the first one's outer corner, and how many columns are filled; None where nothing is in view.

    Raises
    ------
    RendererError
        The picture would be larger than the working memory of a line.
    """
    laid = _lay_out(relief, view, face)
    if laid is None:
        return None
    plan, (left, top, count, height) = laid
    stride = -(-count // prewarp.LANES) * prewarp.LANES + 16
    out = scratch("out", (height + 2 * PAD, stride))
    warp = _pipelined if settings.method == "pipelined" else _two_pass
    warp(relief, view, face, plan, settings, (left, top, count), out)
    return out[PAD : PAD + height], left, top, count


def _lay_out(relief: Relief, view: Sight, face: Face) -> tuple[Plan, tuple[int, int, int, int]] | None:
    """Plan the warp, and (left, top, columns, rows) of its picture; None where nothing is in view."""
    x0, x1, y0, y1 = face.window
    left, top = int(np.floor(x0 - 0.5)), int(np.floor(y0 - 0.5))
    count, height = max(int(np.ceil(x1 + 0.5)) - left, 2), max(int(np.ceil(y1 + 0.5)) - top, 2)
    if max(count, height) > prewarp.SPAN:
        raise RendererError(f"the pre-warped picture would be {count} x {height} pixels; {prewarp.SPAN} is the most")
    plan = _wall_plan(relief, view, face) if face.wall else _plane_plan(relief, view, face)
    if plan.rows[1] <= plan.rows[0] or plan.texels[1] <= plan.texels[0]:
        return None
    return plan, (left, top, count, height)


def warp_face_by_area(
    relief: Relief, view: Sight, face: Face, settings: Settings
) -> tuple[Array, int, int, int] | None:
    """As `warp_face`, with colours and averaged: (rows, columns, 4) float32 colour and shift, NaN = nothing."""
    laid = _lay_out(relief, view, face)
    if laid is None:
        return None
    plan, (left, top, count, height) = laid
    rows, columns = relief.height.shape
    positions, axis = scratch("positions", (3, rows, columns)), np.array([face.zoom, face.shift[0]])
    window = np.array([plan.rows[0], plan.rows[1] + 1, *plan.texels])
    field = _field(relief, face, plan, settings)
    pipelined.place_texels(*field, plan.eye, plan.shifts, plan.lines, window, axis, positions)
    breaks = relief.breaks if relief.broken else _NONE8
    out = np.empty((height + 2 * PAD, count, 4), np.float32)
    if settings.method == "pipelined":
        ranges, feet = _stripes(view, face, plan, (left, count), relief.height.shape, prewarp_area.STRIPE)
        window = np.array([*plan.rows, count, left, top, plan.order])
        same = relief.jump(face, view)
        prewarp_area.area_cells(positions, relief.color, breaks, ranges, feet, window, same, out)
        return out[PAD : PAD + height], left, top, count
    both = np.empty((2, rows, columns), np.float32)
    both[0] = positions[0] - np.float32(left + 0.5)
    both[1] = relief.height if face.wall else positions[2]
    if face.wall and settings.depth_bits == 8:
        both[1] = relief.codes[1][relief.codes[0]]
    values = np.empty((rows, count, 4), np.float32)
    foot = face.zoom * view.eye[0] + face.shift[0] - left - 0.5
    sides, foot = _halves(view.eye[0], plan.texels, foot, count) if not face.wall else (
        np.array([[*plan.texels, 1, 1, 1], [*plan.texels, 1, 1, 0]]), count)  # fmt: skip
    prewarp_area.area_rows(both, relief.color, breaks, sides, foot, window[:2], values)
    lines = plan.lines.copy()
    lines[0] -= np.float32(top + 0.5)
    if face.wall:
        start, end = plan.rows if plan.order > 0 else plan.rows[::-1]
        side = [start, end, plan.order, -1 if plan.eye[1] > np.mean(relief.range) else 1]
        sides, foot = np.array([[*side, 1], [*side, 0]]), height
    else:
        foot = face.zoom * view.eye[1] + face.shift[1] - top - 0.5
        sides, foot = _halves(view.eye[1], plan.rows, foot, height)
    prewarp_area.area_columns(values, lines, face.wall, plan.eye[1], relief.gap, sides, foot, out)
    return out[PAD : PAD + height], left, top, count


def _halves(eye: float, texels: tuple[int, int], foot: float, count: int) -> tuple[Array, float]:
    """The two sides of a line toward the eye's foot: (2, 5) first, last, step, sign, used; and where they meet."""
    first, last = texels
    middle = prewarp.last_before(eye, last + 1)
    to, off = min(middle + 1, last), max(middle, first)
    sides = [[first, to, 1, 1, int(to > first and foot > -0.5)],
             [last, off, -1, -1, int(off < last and foot < count - 0.5)]]  # fmt: skip
    return np.array(sides), min(max(foot, -0.5), count - 0.5)


def _field(relief: Relief, face: Face, plan: Plan, settings: Settings) -> tuple[Array, Array, Array]:
    """Heights, codes and table for the kernels: floats, or codes with a table of shifts (wall: depths)."""
    if settings.depth_bits == 32:
        return relief.height, _NONE8, _NONE
    codes, depths = relief.codes
    if face.wall:
        return relief.height, codes, depths
    d = depths.astype(np.float64) - plan.eye[2]
    away = plan.eye[1] - d
    if len(_flat(relief, face)):  # what does not move is not rounded away from the plane
        d[np.argmin(np.abs(d[:255]))] = 0.0
    tiny = 1e-6 * abs(plan.eye[1])
    return relief.height, codes, (d / np.where(np.abs(away) > tiny, away, -tiny)).astype(np.float32)


def _flat(relief: Relief, face: Face) -> Array:
    """Which chunks of texels lie in the face's plane; empty = none is known to."""
    return relief.flat_chunks if not face.wall and face.at == relief.flat else _NONE8


def _two_pass(
    relief: Relief, view: Sight, face: Face, plan: Plan, settings: Settings, span: tuple[int, int, int], out: Array
) -> None:
    left, top, count = span
    (first, last), height = plan.rows, len(out) - 2 * PAD
    blocks, lanes = -(-count // prewarp.LANES), prewarp.LANES
    values, marks = scratch("values", (blocks, relief.height.shape[0] + ODD, lanes)), _NONE8
    breaks = relief.breaks if relief.broken else _NONE8
    field, axis = _field(relief, face, plan, settings), np.array([face.zoom, face.shift[0] - (left + 0.5)])
    window = np.array([first, last + 1, *plan.texels, count, plan.most > CAREFUL])
    if face.wall:
        prewarp_columns.scale_rows(*field, breaks, plan.eye[0], axis, plan.shifts, window, values)
        start, end = (first, last) if plan.order > 0 else (last, first)
        sign = -1 if plan.eye[1] > np.mean(relief.range) else 1
        sides = np.array([[start, end, plan.order, sign, 0, height], [start, end, plan.order, sign, height, height]])
    else:
        marks = scratch("marks", values.shape[:2], np.uint8)
        prewarp.warp_rows(*field, breaks, _flat(relief, face), plan.eye, axis, window, values, marks)
        foot = prewarp.last_before(view.eye[1], relief.height.shape[0])
        split = prewarp.first_pixel(face.zoom * view.eye[1] + face.shift[1], top, height)
        ends = min(foot + 1, last), max(foot, first)
        sides = np.array([[first, ends[0], 1, 1, 0, split], [last, ends[1], -1, -1, split, height]])
        sides[:, 5] = np.where((sides[:, 1] - sides[:, 0]) * sides[:, 2] > 0, sides[:, 5], sides[:, 4])
    lines = plan.lines.copy()
    lines[0] -= np.float32(top + 0.5)
    BACKGROUND.wait()
    prewarp_columns.warp_columns(values, marks, lines, face.wall, plan.eye[1], relief.gap, sides, count, out)


def _pipelined(
    relief: Relief, view: Sight, face: Face, plan: Plan, settings: Settings, span: tuple[int, int, int], out: Array
) -> None:
    left, top, count = span
    rows, columns = relief.height.shape
    positions = scratch("positions", (3, rows, columns))
    window = np.array([plan.rows[0], plan.rows[1] + 1, *plan.texels])
    axis = np.array([face.zoom, face.shift[0]])
    pipelined.place_texels(
        *_field(relief, face, plan, settings), plan.eye, plan.shifts, plan.lines, window, axis, positions
    )
    ranges, feet = _stripes(view, face, plan, (left, count), relief.height.shape, pipelined.STRIPE)
    breaks = relief.breaks if relief.broken else _NONE8
    window = np.array([*plan.rows, count, left, top, plan.order])
    pipelined.pipeline(positions, breaks, _flat(relief, face), ranges, feet, window, out[PAD : len(out) - PAD])


def _stripes(
    view: Sight, face: Face, plan: Plan, span: tuple[int, int], shape: tuple[int, ...], width: int
) -> tuple[Array, Array]:
    """First and last texel that can reach each stripe of columns, and the last texel and row not beyond the foot."""
    left, count = span
    rows, columns = shape
    borders = [(x, x + width) for x in range(left, left + count, width)]
    ranges = np.array(
        [source_range(view.eye[0], _texels(face, 0, border), plan.least, plan.most, columns) for border in borders]
    )
    ranges = np.stack([np.maximum(ranges[:, 0], plan.texels[0]), np.minimum(ranges[:, 1], plan.texels[1])], axis=1)
    feet = np.array([prewarp.last_before(view.eye[0], columns), prewarp.last_before(view.eye[1], rows)])
    return ranges, feet


def _texels(face: Face, axis: int, pixels: tuple[float, float]) -> tuple[float, float]:
    """Two points in a face's picture, in texels."""
    a, b = ((x - face.shift[axis]) / face.zoom for x in pixels)
    return a, b


def _magnification(low: float, high: float, at: float, h: float) -> tuple[float, float]:
    """Least and greatest magnification (h - at) / (h - d) over the depths; MOST where texels reach the eye's plane."""
    ratios = [(h - at) / (h - d) if h != d else MOST for d in (low, high)]
    most = max(ratios) if min(ratios) > 0 else MOST
    return min(min((r for r in ratios if r > 0), default=1.0), MOST), min(most, MOST)


def _plane_plan(relief: Relief, view: Sight, face: Face) -> Plan:
    e_u, e_v, h = view.eye
    rows, columns = relief.height.shape
    least, most = _magnification(*relief.range, face.at, h)
    x0, x1, y0, y1 = face.window
    v = np.arange(rows) + 0.5
    return Plan(
        source_range(e_v, _texels(face, 1, (y0 - 1, y1 + 1)), least, most, rows),
        source_range(e_u, _texels(face, 0, (x0 - 1, x1 + 1)), least, most, columns),
        np.stack([face.zoom * v + face.shift[1], face.zoom * (v - e_v), np.zeros(rows)]).astype(np.float32),
        _NONE,
        np.array([e_u, h - face.at, face.at]),
        least,
        most,
        0,
    )


def _wall_plan(relief: Relief, view: Sight, face: Face) -> Plan:
    e_u, e_v, h = view.eye
    rows, columns = relief.height.shape
    low, high = relief.range
    x0, x1, y0, y1 = face.window
    ahead = face.at > e_v
    depths = (face.low + y0 * face.pitch, face.low + y1 * face.pitch)
    ratios = [(h - z) / (h - d) if h != d else MOST for z in depths for d in (low, high)]
    most = min(max(max(ratios), 1.0), MOST) if min(ratios) > 0 else MOST
    if (e_v - 0.5) * (e_v - (rows - 0.5)) > 0:  # the foot is not between the rows
        near = 0.5 if ahead else rows - 0.5
        most = min(most, max((face.at - e_v) / (near - e_v), 1.0) * (1.0 + 1e-6))
    least = 1.0
    if face.near:
        most, least = 1.0, (face.at - e_v) / ((rows - 0.5 if ahead else 0.5) - e_v)
    nearest = e_v + (face.at - e_v) / most
    edge = (max(nearest, e_v + 1e-4), face.at) if ahead else (face.at, min(nearest, e_v - 1e-4))
    first, last = max(int(np.ceil(edge[0] - 0.5)) - 1, 0), min(int(np.floor(edge[1] - 0.5)) + 1, rows - 1)
    if face.near:
        first, last = 0, rows - 1
    v = np.arange(rows) + 0.5
    away = (v - e_v) if ahead else (e_v - v)
    while first <= last and away[first if ahead else last] < 1e-4:
        first, last = (first + 1, last) if ahead else (first, last - 1)
    g = np.where(away > 0, (face.at - v) / np.where(away > 0, v - e_v, 1.0), 0.0)
    lines = np.stack([-(h * g + face.low) / face.pitch, (1.0 + g) / face.pitch, g]).astype(np.float32)
    texels = source_range(e_u, _texels(face, 0, (x0 - 1, x1 + 1)), least, most, columns)
    eye = np.array([e_u, h, 0.0])
    return Plan((first, last), texels, lines, g.astype(np.float32), eye, least, most, -1 if ahead else 1)
