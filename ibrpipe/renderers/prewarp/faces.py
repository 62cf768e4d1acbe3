"""Which faces of a relief texture's box the camera sees it through, and what part of each is needed.

The box spans the outermost texel centres and the range of heights. Every ray that meets the box leaves it through one
*exit* face (at most three from outside in general position); the texture is pre-warped into those. Magnification there
is never below 1, so no texel is lost in between. Texture coordinates: u, v in texels, d along f in scene units.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ibrpipe.types import Array, Camera, ParallelFrame

#: farthest a texel may be magnified toward the eye before it counts as reaching infinity
MOST = 1e6
#: texels from which on a texture's picture may be coarser than the texture
LARGE = 2**16
#: least pixels along depth that a row must have in a wall beyond all rows
LEAST_DEPTH = 0.25
#: most pixels of a small texture's wall per texel along depth
FINER = 4.0


@dataclass(frozen=True, eq=False)
class Sight:
    """A camera in texture coordinates; at camera depth t, pixel p shows ``eye + t * local_from_pixel @ (px, py, 1)``.

    Attributes
    ----------
    eye : (3,) float64
        u, v, d of the camera's centre.
    local_from_pixel : (3, 3) float64
    width, height : int
    """

    eye: Array
    local_from_pixel: Array
    width: int
    height: int

    def swapped(self) -> Sight:
        """Return the same with rows and columns swapped."""
        order = [1, 0, 2]
        return Sight(self.eye[order], self.local_from_pixel[order], self.width, self.height)


def sight(frame: ParallelFrame, camera: Camera) -> Sight:
    """Return `camera` in the texel coordinates of `frame`."""
    local = frame.local_from_world
    return Sight(local @ (camera.center - frame.origin), local @ camera.world_from_pixel, camera.width, camera.height)


@dataclass(frozen=True, eq=False)
class Face:
    """One face of the box, as seen.

    Attributes
    ----------
    wall : bool
        A face v = `at`, seen with rows that are scaled (swap rows and columns for a face u = const); else d = `at`.
    at : float
        Where it is along its axis.
    pitch : float
        Depth per pixel of a wall's picture, scene units; texels of the plane's picture are 1.
    low : float
        Depth of a wall's first border.
    homography : (3, 3) float64
        (x, y, w) of a pixel's point on the face, ``x / w, y / w`` in texels (wall: rows of `pitch`).
    far : float
        Camera depth of that point is ``far / w``.
    window : (left, right, top, bottom) float
        The part of the face that is in view, face pixels.
    zoom : float
        Pixels of the face's picture per texel, along rows; on a plane along columns, too.
    shift : (x, y) float
        Where u = 0, and on a plane v = 0, falls in the picture.
    near : bool
        The face is between the eye and the surface.
    """

    wall: bool
    at: float
    pitch: float
    low: float
    homography: Array
    far: float
    window: tuple[float, float, float, float]
    zoom: float = 1.0
    shift: tuple[float, float] = (0.0, 0.0)
    near: bool = False


def plane_face(view: Sight, rows: int, columns: int, depth: float) -> Face | None:
    """Return the face d = `depth`, or None where no ray in view leaves through it."""
    e_u, e_v, h = view.eye
    return _face(view, False, depth, 1.0, 0.0, 2, (0, 1), (e_u, e_v), depth - h, (0.5, columns - 0.5, 0.5, rows - 0.5))


def rectangle_face(view: Sight, limits: tuple[float, float, float, float]) -> Face | None:
    """Return the rectangle (left, right, top, bottom) of the plane d = 0."""
    e_u, e_v, h = view.eye
    return _face(view, False, 0.0, 1.0, 0.0, 2, (0, 1), (e_u, e_v), -h, limits)


def wide_plane(view: Sight, rows: int, columns: int, depths: tuple[float, float], depth: float) -> Face | None:
    """Return the face d = `depth` with all that surfaces between two `depths` reach beyond its borders.

    The picture of a small texture has two pixels per texel: its borders are sampled, not cut.
    """
    e_u, e_v, h = view.eye
    zoom = 1.0 if rows * columns >= LARGE else 2.0
    ratios = np.array([(h - depth) / (h - d) for d in depths])
    limits = []
    for e, count in ((e_u, columns), (e_v, rows)):
        reached = e + np.outer((0.5 - e, count - 0.5 - e), ratios)
        limits += [zoom * float(reached.min()), zoom * float(reached.max())]
    scaled = Sight(view.eye, view.local_from_pixel * np.array([zoom, zoom, 1.0])[:, None], view.width, view.height)
    face = _face(scaled, False, depth, 1.0, 0.0, 2, (0, 1), (zoom * e_u, zoom * e_v), depth - h, (*limits,))
    return None if face is None else replace(face, zoom=zoom)


def wall_face(view: Sight, columns: int, at: float, low: float, high: float, pitch: float) -> Face | None:
    """Return the face v = `at` between the depths `low` and `high`."""
    limits = (0.5, columns - 0.5, 0.0, (high - low) / pitch)
    return _wall(view, at, low, pitch, limits)


def wide_wall(
    view: Sight, rows: int, columns: int, low: float, high: float, pitch: float, most: float
) -> tuple[Face | None, bool]:
    """Return a wall beyond all rows with all that the surface reaches on its plane, and whether there is such a wall.

    There is none while the eye's foot lies between the outermost rows, where the nearest row is magnified more than
    `most` times, or where too many rows would fall on one pixel. Where the frame has fewer pixels than its picture,
    that is made smaller, until the farthest row is reduced as much as the nearest is magnified; where a small texture's
    has more along depth, finer.
    """
    e_u, e_v, h = view.eye
    near, at = (0.5, rows - 0.5) if e_v < 0.5 * rows else (rows - 0.5, 0.5)
    if (near - e_v) * (at - e_v) <= 0 or not (at - e_v) / (near - e_v) <= most:
        return None, False
    ratios = np.array([1.0, (at - e_v) / (near - e_v)])
    across = e_u + np.outer((0.5 - e_u, columns - 0.5 - e_u), ratios)
    along = h + np.outer((low - h, high - h), ratios)
    bottom = float(along.min())
    limits = np.array([across.min(), across.max(), 0.0, (along.max() - bottom) / pitch])
    if limits[3] < LEAST_DEPTH * rows:
        return None, False
    face = _wall(view, at, bottom, pitch, (*limits,))
    if face is None:
        return None, True
    x0, x1, y0, y1 = face.window
    least, most = (float(ratios[1]) ** -0.5, 1.0) if rows * columns >= LARGE else (1.0, FINER)
    zoom = min(max(view.width / max(x1 - x0, 1.0), least), 1.0)
    finer = min(max(view.height / max(y1 - y0, 1.0), least), most)
    limits *= np.array([zoom, zoom, finer, finer])
    return _wall(view, at, bottom, pitch / finer, (*limits,), zoom), True


def _wall(
    view: Sight, at: float, low: float, pitch: float, limits: tuple[float, ...], zoom: float = 1.0
) -> Face | None:
    e_u, e_v, h = view.eye
    local_from_pixel = view.local_from_pixel * np.array([zoom, 1.0, 1.0 / pitch])[:, None]
    scaled = Sight(view.eye, local_from_pixel, view.width, view.height)
    face = _face(scaled, True, at, pitch, low, 1, (0, 2), (zoom * e_u, (h - low) / pitch), at - e_v, limits)
    return None if face is None else replace(face, zoom=zoom)


def _face(
    view: Sight,
    wall: bool,
    at: float,
    pitch: float,
    low: float,
    axis: int,
    along: tuple[int, int],
    foot: tuple[float, float],
    reach: float,
    limits: tuple[float, ...],
) -> Face | None:
    """Homography of pixels onto the face that `axis` crosses; `reach`: where it is minus where the eye is."""
    if reach == 0.0:
        return None
    sign = np.sign(reach)
    weight = sign * view.local_from_pixel[axis]
    homography = np.stack(
        [foot[i] * weight + abs(reach) * view.local_from_pixel[along[i]] for i in range(2)] + [weight]
    )
    window = _visible(homography, view, limits)
    return None if window is None else Face(wall, at, pitch, low, homography, abs(reach), window)


def _visible(homography: Array, view: Sight, limits: tuple[float, ...]) -> tuple[float, float, float, float] | None:
    """Clip the face's rectangle by the picture; return the bounds of what is left."""
    scale = np.abs(homography).max()
    if not scale > 0 or abs(np.linalg.det(homography / scale)) < 1e-300:
        return None
    pixels = np.linalg.inv(homography / scale)
    left, right, top, bottom = limits
    corners = [(left, top), (right, top), (right, bottom), (left, bottom)]
    sides = [pixels[2], pixels[0], view.width * pixels[2] - pixels[0], pixels[1], view.height * pixels[2] - pixels[1]]
    for a, b, c in np.stack(sides).tolist():
        corners = _clip(corners, a, b, c)
        if not corners:
            return None
    x, y = zip(*corners, strict=True)
    return min(x), max(x), min(y), max(y)


def _clip(corners: list[tuple[float, float]], a: float, b: float, c: float) -> list[tuple[float, float]]:
    """Keep the part of a convex polygon where ``a x + b y + c >= 0``."""
    kept = []
    level = [a * x + b * y + c for x, y in corners]
    for k, (x, y) in enumerate(corners):
        after = (k + 1) % len(corners)
        p, q = level[k], level[after]
        if p >= 0:
            kept.append((x, y))
        if (p >= 0) != (q >= 0):
            t = p / (p - q)
            kept.append((x + (corners[after][0] - x) * t, y + (corners[after][1] - y) * t))
    return kept


def source_range(eye: float, window: tuple[float, float], least: float, most: float, count: int) -> tuple[int, int]:
    """Return the first and last texel of a line that magnifications `least` to `most` can take into `window`."""
    reached = [eye + (x - eye) / s for x in window for s in (least, most)]
    first = int(np.floor(min(max(min(reached), -2.0), count + 2.0) - 0.5)) - 1
    last = int(np.ceil(min(max(max(reached), -2.0), count + 2.0) - 0.5)) + 1
    return max(first, 0), min(last, count - 1)
