"""The exact answer for relief-mapped meshes: every face (or prism), every cell on the way of every ray, in float64.

Written from ``docs/renderers/relief.md``, in NumPy; nothing of the renderer's kernels is used.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from ibrpipe.bench.oracles.fields import DOUBT, Truth, pixel_centers
from ibrpipe.types import Array, Camera
from ibrpipe.types.relief_mesh import ReliefMesh

CREASE_DEG = 40.0
#: the averaged normal faces the eye at least this share as much as the polygon does
FACING = 0.5
#: how far beyond the surface a root may lie by rounding and still be on it, of the depth
ROUNDING = 1e-12
#: how far below the surface a ray is inside for sure, of the depth
BELOW = 1e-7
#: vertices of the tetrahedra of a prism: (corner by number, 0 top or 1 bottom)
TETRAHEDRA = (((0, 0), (1, 0), (2, 0), (2, 1)), ((0, 0), (1, 0), (1, 1), (2, 1)), ((0, 0), (0, 1), (1, 1), (2, 1)))


@dataclass(frozen=True, eq=False)
class Relief:
    """A relief in float64: depths 0 to 1 of front and back (H, W), whether they are tiled."""

    front: Array
    back: Array | None
    wraps: bool

    @property
    def size(self) -> Array:
        """Texels across and down."""
        return np.array(self.front.shape[::-1], np.float64)

    def moved(self, move: float) -> Relief:
        """Return the relief with its front `move` deeper and its back as much nearer, in shares of the depth."""
        back = None if self.back is None else np.clip(self.back - move, 0.0, 1.0)
        return Relief(np.clip(self.front + move, 0.0, 1.0), back, self.wraps)


def relief_of(source: ReliefMesh, heights: Array | None = None) -> Relief:
    """Return the relief of a source; `heights` (H, W) float64 stand in for the stored ones."""
    height = source.height if heights is None else heights
    back = None if source.back is None else 1.0 - source.back.astype(np.float64)
    return Relief(1.0 - height.astype(np.float64), back, source.edges == "wrap")


@dataclass(frozen=True, eq=False)
class Hits:
    """Exact hits of one picture.

    Attributes
    ----------
    truth : Truth
        `patch` is the number of the face or prism.
    position, rate : (H, W, 3) float64
        Texture coordinates and depth (u, v, z) of the hit, and how they change per camera depth; NaN = nothing.
    texel : (H, W) float64
        Side of a texel of the relief there, scene units.
    """

    truth: Truth
    position: Array
    rate: Array
    texel: Array


def cast_relief(source: ReliefMesh, relief: Relief, camera: Camera, model: str) -> Hits:
    """Cast all pixel centres, with the range that rounding excuses; `model` is "flat" or "shell".

    Where prisms of a shell overlap, a ray may come into one through an inner side that lies below its surface: there
    that side may be hit, or the first surface that the ray comes to from outside; the range of such a pixel holds both.
    """
    cast = partial(_cast, _flat_lines(source) if model == "flat" else _shell_lines(source))
    grid = pixel_centers(camera)
    depth, face, position, rate = cast(relief, camera, grid)
    overlap = [cast(relief, camera, grid, strict=True)[0]] if model == "shell" else []
    moves = [(0.0, DOUBT * np.array(direction)) for direction in ((1, 0.7), (-1, -0.7))]
    moves += [(DOUBT, np.zeros(2)), (-DOUBT, np.zeros(2))]
    found = np.stack([depth, *overlap, *(cast(relief.moved(move), camera, grid + shift)[0] for move, shift in moves)])
    shape = (camera.height, camera.width)
    parts = (depth, face, np.where(face < 0, -1, 0), found.min(axis=0), found.max(axis=0))
    truth = Truth(*(part.reshape(shape) for part in parts))
    texel = texel_sizes(source)[np.maximum(face, 0)].reshape(shape)
    return Hits(truth, position.reshape(*shape, 3), rate.reshape(*shape, 3), texel)


def texel_sizes(source: ReliefMesh) -> Array:
    """(F,) float64: side of a square as large as a texel of the relief on each face, scene units."""
    p, uv = source.mesh.vertices[source.mesh.faces], source.uv * source.height.shape[::-1]
    area = np.linalg.norm(np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]), axis=1)
    texels = np.abs(np.linalg.det(uv[:, 1:] - uv[:, :1]))
    sound = (area > 0) & (texels > 1e-12)
    size = np.sqrt(np.where(sound, area, 1.0) / np.where(sound, texels, 1.0))
    return np.where(sound, size, np.median(size[sound]) if sound.any() else 1.0)


#: from the eye, the rays (P, 3) and the texels (2,) to what they may meet: number of the face; which rays (N,); depth
#: at w = 0 and per w (N,); position (x, y texels, z) there and per w (N, 3); range of w (N,); whether the solid may
#: begin where the range does (N,)
Lines = Callable[[Array, Array, Array], Iterator[tuple[int, Array, Array, Array, Array, Array, Array, Array, Array]]]


def _cast(
    lines: Lines, relief: Relief, camera: Camera, pixels: Array, strict: bool = False
) -> tuple[Array, Array, Array, Array]:
    """Return depth, number of the face, position and its rate; `strict`: the solid begins only where it may."""
    directions = np.column_stack([pixels, np.ones(len(pixels))]) @ camera.world_from_pixel.T
    depth, face = np.full(len(pixels), np.inf), np.full(len(pixels), -1)
    position, rate = np.full((len(pixels), 3), np.nan), np.full((len(pixels), 3), np.nan)
    unit = np.array([*relief.size, 1.0])
    for number, rays, at, per, start, direction, begin, end, free in lines(camera.center, directions, relief.size):
        first = begin
        if not relief.wraps:
            for axis in (0, 1):
                begin, end = _clip(start[:, axis] + 0.5, direction[:, axis], relief.size[axis], begin, end)
        w = np.full(len(rays), np.inf)
        some = begin <= end
        w[some] = first_inside(relief, start[some], direction[some], begin[some], end[some])
        if strict:
            late = np.flatnonzero(some & ~free & (begin == first) & (w == begin))
            below = first_inside(relief.moved(BELOW), start[late], direction[late], begin[late], begin[late])
            late = late[np.isfinite(below)]
            w[late] = first_inside(relief, start[late], direction[late], begin[late], end[late], entering=True)
        w[~direction.any(axis=1)] = 0.0  # faces without relief
        met = np.isfinite(w)
        t = np.where(met, at + per * np.where(met, w, 0.0), np.inf)
        nearer = t < depth[rays]
        chosen, w, per, start, direction = (
            rays[nearer],
            w[nearer, None],
            per[nearer, None],
            start[nearer],
            direction[nearer],
        )
        depth[chosen], face[chosen] = t[nearer], number
        position[chosen] = (start + w * direction + (0.5, 0.5, 0.0)) / unit
        rate[chosen] = direction / per / unit
    return depth, face, position, rate


def _clip(at: Array, direction: Array, size: float, begin: Array, end: Array) -> tuple[Array, Array]:
    with np.errstate(divide="ignore", invalid="ignore"):
        one, other = -at / direction, (size - at) / direction
    still = direction == 0.0
    begin = np.where(still, begin, np.fmax(begin, np.fmin(one, other)))
    end = np.where(still, np.where((at >= 0) & (at <= size), end, -np.inf), np.fmin(end, np.fmax(one, other)))
    return begin, end


def first_inside(
    relief: Relief, start: Array, direction: Array, begin: Array, end: Array, entering: bool = False
) -> Array:
    """(N,) first w of [begin, end] where ``start + w direction`` (x, y texels, z) is inside or comes in; inf = none."""
    if not len(start):
        return np.zeros(0)
    cuts = [begin[:, None], end[:, None]]
    for axis in (0, 1):
        ends = start[:, axis] + np.stack([begin, end]) * direction[:, axis]
        low, high = ends.min(axis=0), ends.max(axis=0)
        first = np.ceil(low)
        count = int(np.max(np.floor(high) - first, initial=-1.0)) + 1
        lines = first[:, None] + np.arange(count)
        with np.errstate(divide="ignore", invalid="ignore"):
            at = (lines - start[:, axis, None]) / direction[:, axis, None]
        cuts.append(np.where(lines <= high[:, None], np.nan_to_num(at, nan=np.inf), np.inf))
    cut = np.sort(np.clip(np.concatenate(cuts, axis=1), begin[:, None], end[:, None]), axis=1)
    low, length = cut[:, :-1], np.diff(cut, axis=1)
    middle = start[:, None, :2] + (low + 0.5 * length)[..., None] * direction[:, None, :2]
    cell = np.floor(middle).astype(np.int64)
    at = start[:, None] + low[..., None] * direction[:, None]
    p, q, z = at[..., 0] - cell[..., 0], at[..., 1] - cell[..., 1], at[..., 2]
    steps = [direction[:, None, k] for k in range(3)]
    gaps = [_gap(relief, relief.front, cell, p, q, z, steps, 1.0)]
    if relief.back is not None:
        gaps.append(_gap(relief, relief.back, cell, p, q, z, steps, -1.0))
    trial = np.stack([np.zeros_like(low), *(root for gap in gaps for root in _roots(*gap))])
    with np.errstate(invalid="ignore"):
        good = (trial >= 0) & (trial <= length)
        if entering:
            good[0] = False
            for k, (A, B, _) in enumerate(gaps):
                good[1 + 2 * k : 3 + 2 * k] &= 2 * A * trial[1 + 2 * k : 3 + 2 * k] + B > 0
        for A, B, C in gaps:
            good &= (A * trial + B) * trial + C >= -ROUNDING
    found = np.where(good, low + trial, np.inf).min(axis=0)
    return found.min(axis=1, initial=np.inf)


def _gap(
    relief: Relief, grid: Array, cell: Array, p: Array, q: Array, z: Array, direction: list[Array], sign: float
) -> tuple[Array, Array, Array]:
    """`sign` times (z minus the bilinear patch) along the rays, as A w^2 + B w + C."""
    rows, columns = grid.shape
    i, j = cell[..., 0], cell[..., 1]
    values = []
    for k in range(4):
        x, y = i + k % 2, j + k // 2
        if relief.wraps:
            values.append(grid[y % rows, x % columns])
        else:
            values.append(grid[np.clip(y, 0, rows - 1), np.clip(x, 0, columns - 1)])
    a, b, c, e = values
    along, across, twist = b - a, c - a, a - b - c + e
    A = -twist * direction[0] * direction[1]
    B = direction[2] - (along * direction[0] + across * direction[1] + twist * (p * direction[1] + q * direction[0]))
    C = z - a - (along * p + across * q + twist * p * q)
    return sign * A, sign * B, sign * C


def _roots(A: Array, B: Array, C: Array) -> tuple[Array, Array]:
    with np.errstate(divide="ignore", invalid="ignore"):
        square = np.sqrt(B * B - 4 * A * C)
        half = -0.5 * (B + np.where(B < 0, -square, square))
        return half / A, C / half


def corner_axes(source: ReliefMesh) -> Array:
    """(F, 3, 3, 3): normal, dP/du, dP/dv of every corner, averaged by angle, as float32 stores them."""
    places, faces, uv = source.mesh.vertices, source.mesh.faces, source.uv
    p = places[faces]
    normal, angle = _unit(np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])), _angles(p)
    edges, sides = uv[:, 1:] - uv[:, :1], p[:, 1:] - p[:, :1]
    area = np.linalg.det(edges)
    sound = (np.abs(area) > 1e-12) & (np.linalg.norm(normal, axis=1) > 0)
    axes = np.zeros((len(faces), 2, 3))
    axes[sound] = np.linalg.solve(edges[sound], sides[sound])
    hand = np.where(sound, np.sign(area), 0.0)
    out = np.zeros((len(faces), 3, 3, 3))
    for f, c in np.ndindex(len(faces), 3):
        g, d = np.nonzero((p == p[f, c]).all(axis=2))
        near = (normal[g] @ normal[f] >= np.cos(np.radians(CREASE_DEG))) | (g == f)
        g, d = g[near], d[near]
        shift = uv[g, d] - uv[f, c]
        same = (hand[g] == hand[f]) & ((g == f) | (np.abs(shift - np.round(shift)) < 1e-9).all(axis=1))
        total = (angle[g, d, None] * normal[g]).sum(axis=0)
        out[f, c, 0] = _unit(total) if np.any(total) else normal[f]
        weight = angle[g[same], d[same]]
        out[f, c, 1:] = (weight[:, None, None] * axes[g[same]]).sum(axis=0) / max(weight.sum(), 1e-300)
    return out.astype(np.float32).astype(np.float64)


def _unit(v: Array) -> Array:
    length = np.linalg.norm(v, axis=-1, keepdims=True)
    return v / np.where(length > 0, length, 1.0)


def _angles(p: Array) -> Array:
    one, other = _unit(np.roll(p, -1, axis=1) - p), _unit(np.roll(p, -2, axis=1) - p)
    return np.arctan2(np.linalg.norm(np.cross(one, other), axis=-1), (one * other).sum(axis=-1))


def _flat_lines(source: ReliefMesh) -> Lines:
    """The relief below each face, in the frame of its normal and texture axes averaged at the ray's own point."""
    axes = corner_axes(source)

    def lines(eye: Array, directions: Array, size: Array) -> Iterator[tuple]:
        corners = source.mesh.vertices[source.mesh.faces] - eye
        volume = np.linalg.det(corners)
        for f in np.flatnonzero(volume < 0):
            p = corners[f]
            edges = np.cross(np.roll(p, -1, axis=0), np.roll(p, -2, axis=0)) @ directions.T  # (3, P)
            rays = np.flatnonzero((edges <= 0).all(axis=0) & (edges.sum(axis=0) < 0))
            if not len(rays):
                continue
            total = edges[:, rays].sum(axis=0)
            weights, w, t = (edges[:, rays] / total).T, directions[rays], volume[f] / total
            frame, able = _frames(source, axes[f], p, weights, w)
            start = np.column_stack([(weights @ source.uv[f]) * size - 0.5, np.zeros(len(rays))])
            direction = np.zeros_like(start)
            direction[able] = np.linalg.solve(frame[able], w[able, :, None])[..., 0]
            fall = np.where(able, direction[:, 2], 1.0)
            direction = np.column_stack([direction[:, :2] * size / fall[:, None], np.where(able, 1.0, 0.0)])
            free = np.ones(len(rays), bool)
            yield f, rays, t, 1.0 / fall, start, direction, np.zeros(len(rays)), np.where(able, 1.0, 0.0), free

    return lines


def _frames(source: ReliefMesh, axes: Array, p: Array, weights: Array, w: Array) -> tuple[Array, Array]:
    """(N, 3, 3) columns T, B, -thickness N, and where they span space (N,)."""
    g = _unit(np.cross(p[1] - p[0], p[2] - p[0]))
    n = _unit(weights @ axes[:, 0])
    one, other = -(n * w).sum(axis=1), -(w @ g)
    share = np.where(one < FACING * other, (FACING * other - one) / np.where(other == one, 1.0, other - one), 0.0)
    n = _unit(n + share[:, None] * (g - n))
    t, b = weights @ axes[:, 1], weights @ axes[:, 2]
    t, b = (v - (v * n).sum(axis=1, keepdims=True) * n for v in (t, b))
    area = (np.cross(t, b) * n).sum(axis=1)
    able = np.abs(area) > 1e-6 * np.linalg.norm(t, axis=1) * np.linalg.norm(b, axis=1)
    return np.stack([t, b, -source.thickness * n], axis=2), able


def _shell_lines(source: ReliefMesh) -> Lines:
    """The three tetrahedra of the prism below every face; for eyes outside the solid, above the surface."""
    places, faces = source.mesh.vertices, source.mesh.faces
    same = np.unique(places, axis=0, return_inverse=True)[1].ravel()
    first = np.unique(same, return_index=True)[1]
    p, total = places[faces], np.zeros((len(first), 3))
    one = _angles(p)[..., None] * _unit(np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]))[:, None]
    np.add.at(total, same[faces], one)
    normals = _unit(total).astype(np.float32).astype(np.float64)[same[faces]]
    ranks = np.argsort(first[same[faces]], axis=1)
    walls = _walls(same[faces], source.uv)

    def lines(eye: Array, directions: Array, size: Array) -> Iterator[tuple]:
        for f, tetra in ((f, tetra) for f in range(len(faces)) for tetra in TETRAHEDRA):
            c, floor = ranks[f, [k for k, _ in tetra]], np.array([k for _, k in tetra], float)
            points = p[f, c] - eye - floor[:, None] * source.thickness * normals[f, c]
            matrix = np.concatenate([points.T, np.ones((1, 4))])
            if np.linalg.matrix_rank(points[1:] - points[0]) < 3:
                continue
            inverse = np.linalg.inv(matrix)
            at, direction = inverse[:, 3], directions @ inverse[:, :3].T
            with np.errstate(divide="ignore", invalid="ignore"):
                cut = -at / direction
            entries = np.where(direction > 0, cut, 0.0)
            begin = entries.max(axis=1, initial=0.0)
            free = np.array([_is_free(tetra, k, walls[f], ranks[f]) for k in range(4)])[entries.argmax(axis=1)]
            end = np.where(direction < 0, cut, np.inf).min(axis=1)
            end = np.where(((direction == 0) & (at < 0)).any(axis=1), -1.0, end)
            rays = np.flatnonzero(begin <= end)
            if len(rays):
                texture = np.column_stack([source.uv[f, c] * size - 0.5, floor])
                start = np.broadcast_to(at @ texture, (len(rays), 3))
                none = np.zeros(len(rays))
                free = free[rays] & (begin[rays] > 0)
                yield f, rays, none, none + 1.0, start, direction[rays] @ texture, begin[rays], end[rays], free

    return lines


def _walls(faces: Array, uv: Array) -> Array:
    """(F, 3) bool: whether the texture ends at the edge from corner c to the next: no other face, or several."""
    found, sides = np.ones(faces.shape, bool), np.stack([faces, np.roll(faces, -1, axis=1)], axis=2)
    ends = np.stack([uv, np.roll(uv, -1, axis=1)], axis=2)
    for f, c in np.ndindex(*faces.shape):
        same, turned = (sides == sides[f, c]).all(axis=2), (sides == sides[f, c, ::-1]).all(axis=2)
        others = np.argwhere(same | turned)
        if len(others) == 2 and sides[f, c, 0] != sides[f, c, 1]:
            g, d = others[0] if tuple(others[1]) == (f, c) else others[1]
            shift = (ends[g, d, ::-1] if turned[g, d] else ends[g, d]) - ends[f, c]
            whole = np.abs(shift - np.round(shift)).max() < 1e-9
            found[f, c] = not (whole and np.abs(shift[0] - shift[1]).max() < 1e-9)
    return found


def _is_free(tetra: Sequence[tuple[int, int]], gate: int, walls: Array, rank: Array) -> bool:
    """Say whether the solid may begin at the face opposite to vertex `gate`: the prism's top, or a wall."""
    rest = [vertex for k, vertex in enumerate(tetra) if k != gate]
    corners = sorted({int(rank[corner]) for corner, _ in rest})
    if len(corners) == 2:
        return bool(walls[corners[0] if corners[1] - corners[0] == 1 else corners[1]])
    return all(floor == 0 for _, floor in rest)


def read(picture: Array, wraps: bool, u: Array, v: Array) -> Array:
    """(..., K) float64: a picture (H, W, K), bilinear between texel centres, at texture coordinates; 0 at NaN."""
    rows, columns = picture.shape[:2]
    hit = np.isfinite(u) & np.isfinite(v)
    x, y = np.where(hit, u, 0.0) * columns - 0.5, np.where(hit, v, 0.0) * rows - 0.5
    i, j = np.floor(x).astype(np.int64), np.floor(y).astype(np.int64)
    out = np.zeros((*u.shape, picture.shape[2]))
    for k in range(4):
        across, down = i + k % 2, j + k // 2
        weight = (1 - np.abs(x - across)) * (1 - np.abs(y - down))
        if wraps:
            across, down = across % columns, down % rows
        out += weight[..., None] * picture[down.clip(0, rows - 1), across.clip(0, columns - 1)]
    return out * hit[..., None]


def stored(source: ReliefMesh, heights: Array, bits: int) -> ReliefMesh:
    """Return the source with these heights (H, W) float64 in 8 or 16 bits, or as float32 (32)."""
    levels = 2**bits - 1
    return source if bits == 32 else replace(source, height=np.rint(heights * levels) / levels)
