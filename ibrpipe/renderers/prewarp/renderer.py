"""What the `prewarp` renderer does: 1-D pre-warp of relief textures, then planar texture mapping. Source: oliveira2000.

Departures from the paper stand in ``docs/renderers/prewarp.md``.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from time import perf_counter
from typing import Any

import numpy as np

from ibrpipe.core.prewarp import area as prewarp_area
from ibrpipe.core.prewarp import view as prewarp_view
from ibrpipe.renderers.frames import limited_threads, make_frame
from ibrpipe.renderers.ldi import renderer as ldi
from ibrpipe.renderers.ldi.options import LdiOptions
from ibrpipe.renderers.levels import level_of
from ibrpipe.renderers.prewarp.box import Box, draw_box, find_box
from ibrpipe.renderers.prewarp.faces import Face, Sight, plane_face, sight, wall_face, wide_plane, wide_wall
from ibrpipe.renderers.prewarp.options import PrewarpOptions
from ibrpipe.renderers.prewarp.passes import BACKGROUND, Settings, warp_face, warp_face_by_area
from ibrpipe.renderers.prewarp.source import Relief, build_relief
from ibrpipe.renderers.scene import prepare as prepare_exact
from ibrpipe.types import Array, Camera, Frame

_NO_DEPTH, _NO_OWNER = np.empty((0, 0), np.float32), np.empty((0, 0), np.uint8)

#: texels on a side below which a relief is searched exactly
FEWEST = 4
#: texels from a relief's box within which the eye is too near for a pre-warped picture
NEAR = 2.0
#: greatest magnification of texels on a plane that is drawn with its outliers, in place of side walls
WIDEST = 3.5
#: the same on a wall beyond all rows where the eye is as high as some texels
LEVEL = 2.0
#: the same below which it is preferred to a wall beyond all rows
WIDE = 1.25


@dataclass(frozen=True, eq=False)
class Scene:
    """All relief textures of a prepared source."""

    reliefs: tuple[Relief, ...]

    @cached_property
    def box(self) -> Box | None:
        """The box whose faces the textures are, if they are."""
        return find_box(self.reliefs)

    @property
    def bytes(self) -> int:
        """Bytes held beyond the sources."""
        return sum(relief.bytes for relief in self.reliefs)


@dataclass(eq=False)
class Canvas:
    """A frame in the making: its arrays hold nothing until the first face is drawn.

    Attributes
    ----------
    depth : (H, W) float32
    color, alpha : (H, W, 3), (H, W) float32, without pixels unless `shaded`
    shaded, drawn, colored : bool
        Whether colours are wanted; whether depth, and colours, have been written.
    faces : int
        How many faces have been shown.
    """

    depth: Array
    color: Array
    alpha: Array
    shaded: bool
    drawn: bool = False
    colored: bool = False
    faces: int = 0

    @classmethod
    def blank(cls, height: int, width: int, shaded: bool) -> Canvas:
        """Return one on which nothing has been drawn."""
        size = (height, width) if shaded else (0, 0)
        return cls(np.empty((height, width), np.float32), np.empty((*size, 3), np.float32),
                   np.empty(size, np.float32), shaded)  # fmt: skip

    def before(self) -> Array:
        """Return the depths so far for the colours to compare with, or an empty array where there are none."""
        if self.drawn and self.shaded:
            self.fill()
            return self.depth.copy()
        return _NO_DEPTH

    def fill(self) -> None:
        """Write background into what has not been written."""
        if not self.drawn:
            self.depth.fill(np.inf)
        if not self.colored:
            self.color.fill(0.0)
            self.alpha.fill(0.0)
        self.drawn = self.colored = True

    def finished(self) -> tuple[Array, Array, Array]:
        """Return depth, colour and alpha, all written."""
        self.fill()
        return self.depth, self.color, self.alpha


def prepare(textures: tuple[Any, ...]) -> Scene:
    """Take the first layer of every texture."""
    return Scene(tuple(build_relief(texture) for texture in textures))


def draw(scene: Scene, camera: Camera, outputs: tuple[str, ...], options: PrewarpOptions) -> Frame:
    """Render one frame; see `ibrpipe.render` and, for the options, ``docs/renderers/prewarp.md``."""
    settings = Settings(options.method, options.depth_bits, options.filter == "area")
    began = perf_counter()
    if options.method == "two-pass" and not settings.area:
        BACKGROUND.begin()
    shaded = bool({"color", "alpha"} & set(outputs))
    canvas = Canvas.blank(camera.height, camera.width, shaded)
    with limited_threads(options.threads):
        near = [_is_exact(relief, camera, options.fallback) for relief in scene.reliefs]
        chosen = [leveled(relief, camera, options) for relief in scene.reliefs]
        shown = 0
        if options.quads == "auto" and not settings.area and not any(near) and scene.box is not None:
            shown = _draw_object(tuple(chosen), camera, settings, canvas)
        for relief, each, exact in zip(scene.reliefs, chosen, near, strict=True):
            if exact:
                _draw_exact(relief, camera, canvas)
            elif not shown:
                _draw_relief(each, camera, settings, canvas)
    depth, color, alpha = canvas.finished()
    stats: dict[str, Any] = {
        "rays": depth.size,
        "exact": sum(near),
        "quads": shown or canvas.faces,
        "milliseconds": 1e3 * (perf_counter() - began),
    }
    return make_frame(outputs, depth, color, alpha, stats)


def _draw_relief(relief: Relief, camera: Camera, settings: Settings, canvas: Canvas) -> None:
    view = sight(relief.frame, camera)
    if settings.area:
        for face, swapped in visible_faces(relief, view):
            oriented, seen = (relief.swapped, view.swapped()) if swapped else (relief, view)
            _draw_by_area(oriented, seen, face, settings, canvas)
        return
    before, drawn = canvas.before(), False
    for face, swapped in visible_faces(relief, view):
        oriented, seen = (relief.swapped, view.swapped()) if swapped else (relief, view)
        drawn |= _draw_face(oriented, seen, face, settings, canvas)
    if drawn and canvas.shaded:
        rays = view.local_from_pixel[:2], view.eye[:2]
        size = np.array(relief.height.shape)
        BACKGROUND.wait()
        prewarp_view.view_color(
            canvas.depth, before, _NO_OWNER, 0, *rays, relief.texels, size, canvas.color, canvas.alpha
        )
        canvas.colored = True


def _draw_object(reliefs: tuple[Relief, ...], camera: Camera, settings: Settings, canvas: Canvas) -> int:
    """Draw the faces of a box as at most three quadrilaterals -> how many; 0 where the eye is inside the box."""
    box = find_box(reliefs)
    if box is None or not box.quads(camera):
        return 0
    canvas.fill()
    owner = np.full(canvas.depth.shape, prewarp_view.NOBODY, np.uint8)
    shown = draw_box(box, camera, settings, canvas.depth, owner)
    for number, relief in enumerate(reliefs if canvas.shaded else ()):
        view = sight(relief.frame, camera)
        rays, size = (view.local_from_pixel[:2], view.eye[:2]), np.array(relief.height.shape)
        prewarp_view.view_color(
            canvas.depth, _NO_DEPTH, owner, number, *rays, relief.texels, size, canvas.color, canvas.alpha
        )
    return shown


def _is_exact(relief: Relief, camera: Camera, fallback: str) -> bool:
    """Whether a relief is searched exactly instead of warped."""
    return fallback == "always" or (fallback == "auto" and _is_near(relief, camera))


def leveled(relief: Relief, camera: Camera, options: PrewarpOptions) -> Relief:
    """Return the level of a relief's pyramid that is warped, its texels joined as asked for."""
    level = projected_level(relief, camera) if options.level == "auto" else options.level
    return relief.level(level).joined_up_to(options.max_step)


def _is_near(relief: Relief, camera: Camera) -> bool:
    """Whether the eye is inside the relief's box or within a few texels of it (sec. 6), or it has hardly any texels."""
    low, high = relief.range
    if min(relief.height.shape) < FEWEST:
        return True
    eye = sight(relief.frame, camera).eye
    margin = NEAR * np.array([1.0, 1.0, relief.pitch])
    rows, columns = relief.height.shape
    return bool(
        low <= high and (eye > (0, 0, low) - margin).all() and (eye < np.array([columns, rows, high]) + margin).all()
    )


def _draw_exact(relief: Relief, camera: Camera, canvas: Canvas) -> None:
    """Render by the exact search of renderer ldi: the micro-polygons of a relief that is too near."""
    if "exact" not in relief.made:
        relief.made["exact"] = prepare_exact((relief.source,))
    outputs = ("color", "depth", "alpha") if canvas.shaded else ("depth",)
    frame = ldi.draw(relief.made["exact"], camera, outputs, LdiOptions(residuals=False))
    canvas.fill()
    found = np.asarray(frame.depth)
    nearer = found < canvas.depth
    canvas.depth[nearer] = found[nearer]
    if frame.color is not None and frame.alpha is not None:
        canvas.color[nearer], canvas.alpha[nearer] = frame.color[nearer], frame.alpha[nearer]


def projected_level(relief: Relief, camera: Camera) -> int:
    """Level of the pyramid by the projected area (sec. 4.3, 6), with no texel side longer than a pixel."""
    low, high = relief.range
    rows, columns = relief.height.shape
    if not low <= high:
        return 0
    frame, middle = relief.frame, 0.5 * (low + high)
    u, v = np.array([0, columns, columns, 0]), np.array([0, 0, rows, rows])
    corners = frame.origin + u[:, None] * frame.a + v[:, None] * frame.b + middle * frame.f
    return level_of(camera.K @ (camera.R @ corners.T + camera.t[:, None]), rows, columns)


def visible_faces(relief: Relief, view: Sight) -> list[tuple[Face, bool]]:
    """Return the exit faces in view, each with whether rows and columns are swapped."""
    (rows, columns), (low, high) = relief.height.shape, relief.range
    e_u, e_v, h = view.eye
    if not low <= high or (relief.front_only and h >= high):
        return []
    base, near = (low, high) if h > high else (high, low)
    outside = not low <= h <= high
    spread = abs(h - base) / abs(h - near) if outside and h != near else np.inf
    base = relief.flat if relief.flat is not None else base  # texels in the plane are not moved
    if spread <= WIDE:
        wide = None if h > high and relief.front_only else wide_plane(view, rows, columns, (low, high), base)
        return [] if wide is None else [(wide, False)]
    for swapped in (False, True):
        seen, size = (view.swapped(), (columns, rows)) if swapped else (view, (rows, columns))
        wide, found_one = wide_wall(seen, *size, low, high, relief.pitch, WIDEST if outside else LEVEL)
        if found_one:
            return [] if wide is None else [(wide, swapped)]
    if spread <= WIDEST:
        wide = None if h > high and relief.front_only else wide_plane(view, rows, columns, (low, high), base)
        return [] if wide is None else [(wide, False)]
    found: list[tuple[Face | None, bool]] = []
    if h > low and not relief.front_only:
        found.append((plane_face(view, rows, columns, low), False))
    if h < high:
        found.append((plane_face(view, rows, columns, high), False))
    for eye, count, other, swapped in ((e_v, rows, columns, False), (e_u, columns, rows, True)):
        seen = view.swapped() if swapped else view
        for at in (0.5, count - 0.5):
            if high > low and (eye - at) * (0.5 * count - at) > 0:
                found.append((wall_face(seen, other, at, low, high, relief.pitch), swapped))
    return [(face, swapped) for face, swapped in found if face is not None]


def _draw_by_area(relief: Relief, view: Sight, face: Face, settings: Settings, canvas: Canvas) -> None:
    picture = warp_face_by_area(relief, view, face, settings)
    if picture is None:
        return
    canvas.fill()
    canvas.faces += 1
    values, left, top, columns = picture
    homography, bounds = _on_picture(face, left, top, columns, len(values))
    jump = relief.jump(face, view)
    prewarp_area.view_area(values, homography, bounds, jump, canvas.depth, canvas.color, canvas.alpha)


def _on_picture(face: Face, left: int, top: int, columns: int, rows: int) -> tuple[Array, Array]:
    """The homography (4, 3) from frame to picture, and the bounds (6,) of what is in view; see core.prewarp_view."""
    homography = np.zeros((4, 3))
    homography[:3] = face.homography
    homography[0] -= left * face.homography[2]
    homography[1] -= top * face.homography[2]
    homography[3, 2] = face.far
    bounds = np.array([*face.window, columns, rows])
    bounds[:2] -= left
    bounds[2:4] -= top
    return homography, bounds


def _draw_face(relief: Relief, view: Sight, face: Face, settings: Settings, canvas: Canvas) -> bool:
    picture = warp_face(relief, view, face, settings)
    if picture is None:
        return False
    shifts, left, top, columns = picture
    homography, bounds = _on_picture(face, left, top, columns, len(shifts))
    jump = relief.jump(face, view)
    prewarp_view.view_depth(shifts.ravel(), shifts.shape[1], homography, bounds, jump, not canvas.drawn, canvas.depth)
    canvas.drawn = True
    canvas.faces += 1
    return True
