"""Pre-warped textures as pictures of their own: what planar texture mapping then puts onto quadrilaterals.

Source: oliveira2000, sec. 3.2 (fig. 9: after the rows, after both passes), 4.1 (fig. 17: the quadrilaterals of a box).
Where a shift g was left at the point P of a plane, the surface lies at ``E + (P - E) / (1 + g)``; its colour is read
from the texture there, bilinearly.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from ibrpipe.core.prewarp.rows import LANES
from ibrpipe.errors import RendererError
from ibrpipe.renderers.api import Source, prepare
from ibrpipe.renderers.option_check import checked_options
from ibrpipe.renderers.prewarp.box import NOTHING, find_box, warp_quad
from ibrpipe.renderers.prewarp.faces import Face, sight
from ibrpipe.renderers.prewarp.options import PrewarpOptions
from ibrpipe.renderers.prewarp.passes import ODD, Settings, scratch, warp_face
from ibrpipe.renderers.prewarp.renderer import Scene, leveled, visible_faces
from ibrpipe.renderers.prewarp.source import Relief
from ibrpipe.renderers.registry import find_renderer
from ibrpipe.types import Array, Camera, ParallelFrame

Stage = Literal["rows", "both"]


@dataclass(frozen=True, eq=False)
class PrewarpedTexture:
    """An ordinary texture that looks like the relief from one point, mapped onto a rectangle.

    Attributes
    ----------
    color : (H, W, 3) float32, linear
    alpha : (H, W) float32, 1 where there is surface
    shift : (H, W) float32
        g of each pixel: the surface's camera depth is that of the rectangle over 1 + g; NaN = nothing.
    corner, across, down : (3,) float64, world
        Outer corner of pixel (0, 0), and the rectangle's edges along columns and rows.
    """

    color: Array
    alpha: Array
    shift: Array
    corner: Array
    across: Array
    down: Array

    def __repr__(self) -> str:
        """Return the size."""
        return f"PrewarpedTexture({self.alpha.shape[1]} x {self.alpha.shape[0]})"


def prewarp(source: Source, camera: Camera, stage: Stage = "both", **options: Any) -> tuple[PrewarpedTexture, ...]:
    """Return the pre-warped textures of relief textures, without the view of them.

    Parameters
    ----------
    source : as renderer `prewarp` takes it
    camera : Camera
        Its centre is the eye; what lies outside of its picture may be left out.
    stage : {"both", "rows"}
        After both passes, or after the first one, of planes alone: side walls only scale their rows there.
    **options
        Those of `prewarp`, but no ``filter="area"``.

    Returns
    -------
    tuple of PrewarpedTexture
        One for each rectangle that is drawn; none where an eye is on the plane or too near, as then nothing is warped.

    Raises
    ------
    RendererError
        The source or an option cannot be what it is.
    """
    checked = checked_options(find_renderer("prewarp"), options)
    assert isinstance(checked, PrewarpOptions)
    if checked.filter == "area":
        raise RendererError("filter 'area' averages colours as it warps; take filter 'point' for the warped texture")
    if stage not in ("rows", "both"):
        raise RendererError(f"stage is {stage!r}; choose rows or both")
    scene = prepare(source, "prewarp").data
    if not isinstance(scene, Scene):
        raise RendererError("a Scene has no pre-warped textures of its own; give its relief textures")
    settings = Settings("two-pass" if stage == "rows" else checked.method, checked.depth_bits)
    reliefs = tuple(leveled(relief, camera, checked) for relief in scene.reliefs)
    if stage == "both" and checked.quads == "auto" and (quads := list(_quads(reliefs, camera, settings))):
        return tuple(quads)
    return tuple(each for relief in reliefs for each in _faces(relief, camera, stage, settings))


def _quads(reliefs: tuple[Relief, ...], camera: Camera, settings: Settings) -> Iterator[PrewarpedTexture]:
    box = find_box(reliefs)
    for axis, at in box.quads(camera) if box is not None else ():
        quad = warp_quad(box, camera, axis, at, settings) if box is not None else None
        if quad is None:
            continue
        frame, (left, _, top, _) = quad.frame, quad.window
        corner = frame.origin + left * frame.a + top * frame.b
        points = _surface(quad.shifts, corner, frame.a, frame.b, camera.center)
        color = np.zeros((*quad.shifts.shape, 3), np.float32)
        for number, relief in enumerate(reliefs):
            own = (quad.owners == number) & (quad.owners != NOTHING)
            color[own] = _read(relief, points[own])
        yield _texture(color, quad.shifts, corner, frame.a, frame.b)


def _faces(relief: Relief, camera: Camera, stage: Stage, settings: Settings) -> Iterator[PrewarpedTexture]:
    view = sight(relief.frame, camera)
    for face, swapped in visible_faces(relief, view):
        oriented, seen = (relief.swapped, view.swapped()) if swapped else (relief, view)
        picture = warp_face(oriented, seen, face, settings)
        if picture is None or (stage == "rows" and face.wall):
            continue
        shifts, left, top, columns = picture
        if stage == "rows":
            yield _after_rows(oriented, seen.eye, face, left, columns)
            continue
        shifts = shifts[:, :columns].copy()
        corner, across, down = _rectangle(oriented.frame, face, left, top)
        points = _surface(shifts, corner, across, down, camera.center)
        color = np.zeros((*shifts.shape, 3), np.float32)
        there = np.isfinite(shifts)
        color[there] = _read(oriented, points[there])
        yield _texture(color, shifts, corner, across, down)


def _rectangle(frame: ParallelFrame, face: Face, left: int, top: int) -> tuple[Array, Array, Array]:
    """Corner and steps of pixels of a face's picture, world."""
    across = frame.a / face.zoom
    start = frame.origin + (left - face.shift[0]) * across
    if face.wall:
        down = face.pitch * frame.f
        return start + face.at * frame.b + face.low * frame.f + top * down, across, down
    down = frame.b / face.zoom
    return start + (top - face.shift[1]) * down + face.at * frame.f, across, down


def _surface(shifts: Array, corner: Array, across: Array, down: Array, eye: Array) -> Array:
    """(rows, columns, 3) world points of the surface behind each pixel; NaN where there is none."""
    row, column = np.indices(shifts.shape) + 0.5
    plane = corner + column[..., None] * across + row[..., None] * down
    points: Array = eye + (plane - eye) / (1.0 + shifts[..., None].astype(np.float64))
    return points


def _read(relief: Relief, points: Array) -> Array:
    """Colours (N, 3) at world points (N, 3), bilinear between texel centres."""
    local = (points - relief.frame.origin) @ relief.frame.local_from_world.T
    return _bilinear(relief.color, local[:, 0], local[:, 1])


def _bilinear(color: Array, u: Array, v: Array) -> Array:
    rows, columns = color.shape[:2]
    x, y = np.clip(u - 0.5, 0, columns - 1), np.clip(v - 0.5, 0, rows - 1)
    i, j = np.minimum(x.astype(int), max(columns - 2, 0)), np.minimum(y.astype(int), max(rows - 2, 0))
    p, q = (x - i)[:, None], (y - j)[:, None]
    beside, below = np.minimum(i + 1, columns - 1), np.minimum(j + 1, rows - 1)
    upper = (1 - p) * color[j, i] + p * color[j, beside]
    mixed: Array = (1 - q) * upper + q * ((1 - p) * color[below, i] + p * color[below, beside])
    return mixed


def _after_rows(relief: Relief, eye: Array, face: Face, left: int, columns: int) -> PrewarpedTexture:
    """What the first pass of the last `warp_face` has left, each row of the texture where it was."""
    rows, blocks = relief.height.shape[0], -(-columns // LANES)
    values, marks = scratch("values", (blocks, rows + ODD, LANES)), scratch("marks", (blocks, rows + ODD), np.uint8)
    filled = np.where((marks == 1)[..., None], np.float32(0), values)
    shifts = filled[:, :rows].transpose(1, 0, 2).reshape(rows, -1)[:, :columns].copy()
    row, column = np.nonzero(np.isfinite(shifts))
    plane = (left + column + 0.5 - face.shift[0]) / face.zoom
    color = np.zeros((*shifts.shape, 3), np.float32)
    color[row, column] = _bilinear(relief.color, eye[0] + (plane - eye[0]) / (1.0 + shifts[row, column]), row + 0.5)
    frame = relief.frame
    corner = frame.origin + (left - face.shift[0]) * frame.a / face.zoom + face.at * frame.f
    return _texture(color, shifts, corner, frame.a / face.zoom, frame.b)


def _texture(color: Array, shifts: Array, corner: Array, across: Array, down: Array) -> PrewarpedTexture:
    rows, columns = shifts.shape
    alpha = np.isfinite(shifts).astype(np.float32)
    return PrewarpedTexture(color, alpha, shifts, corner, columns * across, rows * down)
