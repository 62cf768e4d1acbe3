"""Objects of relief textures on the faces of a box: at most three quadrilaterals are shown. Source: oliveira2000, 4.1.

The box's faces that the eye is in front of are one, two or three: their pictures are the quadrilaterals. Every texture
is pre-warped into the plane of each: its own face by columns and rows, those at right angles with displacement and row
(or column) swapped. In one plane, seen from one eye, the greatest shift is the nearest surface, so pictures are merged
by a maximum, without any depth.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ibrpipe.core.prewarp import rows as prewarp
from ibrpipe.core.prewarp import view as prewarp_view
from ibrpipe.renderers.prewarp.faces import Face, Sight, rectangle_face, sight
from ibrpipe.renderers.prewarp.passes import Settings, warp_face
from ibrpipe.renderers.prewarp.source import Relief
from ibrpipe.types import Array, Camera, ParallelFrame

#: greatest number of pixels of a quadrilateral's picture per texel, along a side
FINEST = 2.0
#: share of a side by which a texture may miss the box's face
SLACK = 0.03
NOTHING = 255


@dataclass(frozen=True, eq=False)
class Placed:
    """A relief texture in the box's coordinates.

    Attributes
    ----------
    relief : Relief
    axes : (columns, rows, depth): axis 0, 1 or 2 of the box that each runs along
    signs : (3,) float64: +1 along it, -1 against it
    origin : (3,) float64, box coordinates
    texel : float, scene units
    """

    relief: Relief
    axes: tuple[int, int, int]
    signs: Array
    origin: Array
    texel: float

    def swapped(self) -> Placed:
        """Return the same with rows and columns swapped."""
        order = [1, 0, 2]
        u, v, d = self.axes
        return Placed(self.relief.swapped, (v, u, d), self.signs[order], self.origin, self.texel)


@dataclass(frozen=True, eq=False)
class Box:
    """Relief textures on the faces of one box.

    Attributes
    ----------
    origin : (3,) float64, world
    axes : (3, 3) float64, rows are the box's unit axes in the world
    low, high : (3,) float64, box coordinates
    placed : the textures
    """

    origin: Array
    axes: Array
    low: Array
    high: Array
    placed: tuple[Placed, ...]

    def quads(self, camera: Camera) -> list[tuple[int, float]]:
        """Return the faces that the eye is in front of: (axis, where along it); three at most, none from within."""
        eye = self.axes @ (camera.center - self.origin)
        found = [(k, float(self.low[k])) for k in range(3) if eye[k] < self.low[k]]
        return found + [(k, float(self.high[k])) for k in range(3) if eye[k] > self.high[k]]


def find_box(reliefs: tuple[Relief, ...]) -> Box | None:
    """Return the box whose faces carry these textures, or None where they do not make one."""
    if not 2 <= len(reliefs) <= 6:
        return None
    first = reliefs[0].frame
    sides = np.stack([first.a, first.b, first.f])
    axes = sides / np.linalg.norm(sides, axis=1)[:, None]
    if np.abs(axes @ axes.T - np.eye(3)).max() > 1e-6:
        return None
    placed = [_place(relief, first.origin, axes) for relief in reliefs]
    good = [each for each in placed if each is not None]
    faces = {(each.axes[2], float(each.signs[2])) for each in good}
    if len(good) < len(placed) or len(faces) < len(placed) or len({axis for axis, _ in faces}) < 2:
        return None
    corners = np.array([corner for each in good for corner in _corners(each)])
    low, high = corners.min(axis=0), corners.max(axis=0)
    fits = all(_fits(each, low, high) for each in good)
    return Box(first.origin, axes, low, high, tuple(good)) if fits else None


def _place(relief: Relief, origin: Array, axes: Array) -> Placed | None:
    frame = relief.frame
    in_box = axes @ np.stack([frame.a, frame.b, frame.f], axis=1)
    size = np.linalg.norm(in_box, axis=0)
    which = np.abs(in_box).argmax(axis=0)
    signs = np.sign(in_box[which, range(3)])
    exact = np.abs(in_box - np.eye(3)[:, which] * signs * size).max() <= 1e-6 * size.max()
    if not exact or len(set(which.tolist())) < 3 or abs(size[0] - size[1]) > 1e-6 * size[0]:
        return None
    u, v, d = (int(k) for k in which)
    return Placed(relief, (u, v, d), signs, axes @ (frame.origin - origin), float(size[0]))


def _corners(each: Placed) -> Iterator[Array]:
    rows, columns = each.relief.height.shape
    for u, v, d in ((0.0, 0.0, each.relief.range[0]), (columns, rows, each.relief.range[1])):
        corner = each.origin.copy()
        for axis, sign, along in zip(each.axes, each.signs, (u * each.texel, v * each.texel, d), strict=True):
            corner[axis] += sign * (along if np.isfinite(along) else 0.0)
        yield corner


def _fits(each: Placed, low: Array, high: Array) -> bool:
    """Whether a texture covers a face of the box, but for a little."""
    if not np.isfinite(each.relief.height).any():
        return True
    own = np.array(list(_corners(each)))
    slack = SLACK * (high - low).max()
    within = [np.abs([own[:, k].min() - low[k], own[:, k].max() - high[k]]).max() <= slack for k in each.axes[:2]]
    return bool(all(within))


def draw_box(box: Box, camera: Camera, settings: Settings, depth: Array, owner: Array) -> int:
    """Lower `depth` (h, w), all written, and name in `owner` (h, w) uint8 the texture seen; return how many quads."""
    quads = box.quads(camera)
    for axis, at in quads:
        _draw_quad(box, camera, axis, at, settings, depth, owner)
    return len(quads)


@dataclass(frozen=True, eq=False)
class Quad:
    """All textures of a box pre-warped into one of its faces.

    Attributes
    ----------
    view : Sight
        The camera in pixels of the quadrilateral, whose frame is `frame`.
    face : Face
    frame : ParallelFrame
    window : (left, right, top, bottom) int, pixels of the quadrilateral that were drawn
    shifts : (rows, columns) float32, NaN = nothing
    owners : (rows, columns) uint8, number of the texture seen
    """

    view: Sight
    face: Face
    frame: ParallelFrame
    window: tuple[int, int, int, int]
    shifts: Array
    owners: Array


def warp_quad(box: Box, camera: Camera, axis: int, at: float, settings: Settings) -> Quad | None:
    """Pre-warp all textures into the face `axis` = `at`, as fine as the frame; None where it is not in view."""
    i, j = (k for k in range(3) if k != axis)
    pitch = min(each.texel for each in box.placed)
    _, _, face = _quad_face(box, camera, (axis, i, j), at, pitch)
    if face is None:
        return None
    x0, x1, y0, y1 = face.window
    finer = (camera.width * camera.height / max((x1 - x0) * (y1 - y0), 1.0)) ** 0.5
    largest = (prewarp.SPAN - 4) * pitch / max(float(box.high[i] - box.low[i]), float(box.high[j] - box.low[j]))
    pitch /= min(max(finer, 1.0), FINEST, max(largest, 1.0))  # as fine as the frame, so far as the textures are
    frame, view, face = _quad_face(box, camera, (axis, i, j), at, pitch)
    if face is None:
        return None
    x0, x1, y0, y1 = face.window
    window = (int(np.floor(x0 - 0.5)), int(np.ceil(x1 + 0.5)), int(np.floor(y0 - 0.5)), int(np.ceil(y1 + 0.5)))
    return Quad(view, face, frame, window, *_merge(box, camera, (axis, i, j), at, pitch, window, settings))


def _draw_quad(box: Box, camera: Camera, axis: int, at: float, settings: Settings, depth: Array, owner: Array) -> None:
    quad = warp_quad(box, camera, axis, at, settings)
    if quad is None:
        return
    face, window, merged = quad.face, quad.window, quad.shifts
    x0, x1, y0, y1 = face.window
    homography = np.zeros((4, 3))
    homography[:3] = face.homography
    homography[0] -= window[0] * face.homography[2]
    homography[1] -= window[2] * face.homography[2]
    homography[3, 2] = face.far
    bounds = np.array([x0 - window[0], x1 - window[0], y0 - window[2], y1 - window[2], *merged.shape[::-1]])
    jump = box.placed[0].relief.jump(face, quad.view)
    prewarp_view.view_depth(merged.ravel(), merged.shape[1], homography, bounds, jump, False, depth)
    prewarp_view.view_owner(quad.owners, homography, bounds, owner)


def _quad_face(
    box: Box, camera: Camera, axes: tuple[int, int, int], at: float, pitch: float
) -> tuple[ParallelFrame, Sight, Face | None]:
    """The frame of a quadrilateral, the camera in its pixels, and its part in view."""
    axis, i, j = axes
    corner = box.low.copy()
    corner[axis] = at
    frame = ParallelFrame(box.origin + corner @ box.axes, pitch * box.axes[i], pitch * box.axes[j], box.axes[axis])
    view = sight(frame, camera)
    size = (box.high - box.low) / pitch
    return frame, view, rectangle_face(view, (0.0, float(size[i]), 0.0, float(size[j])))


def _merge(
    box: Box,
    camera: Camera,
    axes: tuple[int, int, int],
    at: float,
    pitch: float,
    window: tuple[int, int, int, int],
    settings: Settings,
) -> tuple[Array, Array]:
    """Pre-warp all textures into one plane -> shifts (rows, columns) float32, and whose they are."""
    axis, i, j = axes
    shape = (max(window[3] - window[2], 2), max(window[1] - window[0], 2))
    merged, owners = np.full(shape, np.nan, np.float32), np.full(shape, NOTHING, np.uint8)
    for number, each in enumerate(box.placed):
        oriented = each.swapped() if axis == each.axes[0] else each
        view = sight(oriented.relief.frame, camera)
        low, high = oriented.relief.range
        if not low <= high or (oriented.relief.front_only and view.eye[2] >= high):
            continue
        face = _face_in(oriented, box, axis, at, pitch, {i: window[:2], j: window[2:]})
        picture = warp_face(oriented.relief, view, face, settings)
        if picture is None:
            continue
        across, down = oriented.axes[0], oriented.axes[2] if face.wall else oriented.axes[1]
        shifts = picture[0][:, : picture[3]]
        shifts = shifts[:: int(oriented.signs[oriented.axes.index(down)]), :: int(oriented.signs[0])]
        shifts = shifts if across == i else shifts.T
        nearer = ~(shifts <= merged) & (shifts == shifts)
        merged[nearer], owners[nearer] = shifts[nearer], number
    return merged, owners


def _face_in(each: Placed, box: Box, axis: int, at: float, pitch: float, window: dict[int, tuple[int, int]]) -> Face:
    """The plane `axis` = `at` of the box as a face of a texture, its pixels those of the quadrilateral."""
    wall = axis != each.axes[2]
    across, down = each.axes[0], each.axes[2] if wall else each.axes[1]
    limits: list[float] = []
    for k in (across, down):
        first, end = window[k]
        end = max(end, first + 2)
        sign = each.signs[each.axes.index(k)]
        limits += [first + 0.6, end - 0.6] if sign > 0 else [-end + 0.6, -first - 0.6]
    offset = each.origin - box.low
    zoom = each.texel / pitch
    index = each.axes.index(axis)
    where = (at - each.origin[axis]) * each.signs[index] / (each.texel if wall else 1.0)
    shift = tuple(float(each.signs[each.axes.index(k)] * offset[k] / pitch) for k in (across, down))
    return Face(
        wall, float(where), pitch, -shift[1] * pitch, np.eye(3), 1.0, (limits[0], limits[1], limits[2], limits[3]),
        zoom, (shift[0], 0.0 if wall else shift[1]), near=True,
    )  # fmt: skip
