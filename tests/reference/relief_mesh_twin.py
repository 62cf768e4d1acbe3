"""Slow plain twins of relief mapping on meshes, ray by ray in float64; nothing of the package's kernels is used.

Written from ``docs/renderers/relief.md``.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np


def unit(v):
    length = np.linalg.norm(v)
    return v / length if length > 0 else v


def corner_axes(source, crease_deg=40.0):
    """(F, 3, 3, 3): normal, dP/du, dP/dv of every corner, averaged by angle."""
    places, faces, uv = source.mesh.vertices, source.mesh.faces, source.uv
    normals, axes, hands, angles = [], [], [], []
    for face, texture in zip(faces, uv):
        p = places[face]
        normals.append(unit(np.cross(p[1] - p[0], p[2] - p[0])))
        edges = texture[1:] - texture[0]
        area = np.linalg.det(edges)
        sound = abs(area) > 1e-12 and np.linalg.norm(normals[-1]) > 0
        axes.append(np.linalg.solve(edges, p[1:] - p[0]) if sound else np.zeros((2, 3)))
        hands.append(np.sign(area) if sound else 0.0)
        angles.append([])
        for c in range(3):
            one, other = unit(p[(c + 1) % 3] - p[c]), unit(p[(c + 2) % 3] - p[c])
            angles[-1].append(np.arctan2(np.linalg.norm(np.cross(one, other)), one @ other))
    out = np.zeros((len(faces), 3, 3, 3))
    limit = np.cos(np.radians(crease_deg))
    for f, face in enumerate(faces):
        for c in range(3):
            normal, along, total = np.zeros(3), np.zeros((2, 3)), 0.0
            for g, other in enumerate(faces):
                for d in range(3):
                    if not np.array_equal(places[other[d]], places[face[c]]):
                        continue
                    if g != f and normals[f] @ normals[g] < limit:
                        continue
                    normal += angles[g][d] * normals[g]
                    shift = uv[g, d] - uv[f, c]
                    if hands[g] == hands[f] and (g == f or np.allclose(shift, np.round(shift), rtol=0, atol=1e-9)):
                        along += angles[g][d] * axes[g]
                        total += angles[g][d]
            out[f, c, 0] = unit(normal) if np.linalg.norm(normal) > 0 else normals[f]
            out[f, c, 1:] = along / total if total > 0 else 0.0
    return out.astype(np.float32).astype(float)


def texel(grid, i, j, wraps):
    rows, columns = grid.shape
    if wraps:
        return float(grid[j % rows, i % columns])
    return float(grid[min(max(j, 0), rows - 1), min(max(i, 0), columns - 1)])


def bilinear(grid, x, y, wraps):
    """Value at texel coordinates, texel centres at whole numbers."""
    i, j = int(np.floor(x)), int(np.floor(y))
    p, q = x - i, y - j
    a, b, c, e = (texel(grid, i + k % 2, j + k // 2, wraps) for k in range(4))
    return (a * (1 - p) + b * p) * (1 - q) + (c * (1 - p) + e * p) * q


class Layers:
    """Depth layers of a relief: is a point (x, y texels, z) inside?"""

    def __init__(self, source):
        self.front = 1.0 - source.height.astype(np.float32)
        self.back = None if source.back is None else 1.0 - source.back.astype(np.float32)
        self.wraps = source.edges == "wrap"

    def gap(self, x, y, z):
        """At least 0 inside."""
        front = z - bilinear(self.front, x, y, self.wraps)
        return front if self.back is None else min(front, bilinear(self.back, x, y, self.wraps) - z)

    def first(self, start, way, begin, end):
        """First s in [begin, end] that is inside, by looking into every cell on the way."""
        cuts = [begin, end]
        for axis in (0, 1):
            if way[axis]:
                ends = sorted(start[axis] + s * way[axis] for s in (begin, end))
                cuts += [(k - start[axis]) / way[axis] for k in range(int(np.ceil(ends[0])), int(ends[1] // 1) + 1)]
        cuts = sorted(min(max(cut, begin), end) for cut in cuts)
        if self.gap(*(start + begin * way)) >= 0:
            return begin
        for low, high in pairwise(cuts):
            middle = start + 0.5 * (low + high) * way
            i, j = int(np.floor(middle[0])), int(np.floor(middle[1]))
            roots = [low, high]
            for grid in (self.front,) if self.back is None else (self.front, self.back):
                roots += self.roots(grid, i, j, start, way)
            for s in sorted(root for root in roots if low <= root <= high):
                if self.gap(*(start + s * way)) >= -1e-12:
                    return s
        return np.inf

    def roots(self, grid, i, j, start, way):
        a, b, c, e = (texel(grid, i + k % 2, j + k // 2, self.wraps) for k in range(4))
        p, q, z = start[0] - i, start[1] - j, start[2]
        u, v, w, t = way[0], way[1], b - a, c - a
        k = a - b - c + e
        poly = [-k * u * v, way[2] - (w * u + t * v + k * (p * v + q * u)), z - a - (w * p + t * q + k * p * q)]
        while poly and poly[0] == 0:
            poly = poly[1:]
        return [root.real for root in np.roots(poly) if abs(root.imag) < 1e-12]

    def stepped(self, start, way, begin, end, steps, halvings):
        """The published search."""
        for k in range(1, steps + 1):
            s = begin + k * (end - begin) / steps
            if self.gap(*(start + s * way)) >= 0:
                low, part = s - (end - begin) / steps, (end - begin) / steps
                for _ in range(halvings):
                    part *= 0.5
                    low += 0.0 if self.gap(*(start + (low + part) * way)) >= 0 else part
                return low + part
        return np.inf


def frame_at(source, axes, f, weights, w):
    """(3, 3) columns T, B, -thickness N at a place of a face, or None where there is no relief."""
    p = source.mesh.vertices[source.mesh.faces[f]]
    g = unit(np.cross(p[1] - p[0], p[2] - p[0]))
    if g @ w >= 0:
        return None
    n = unit(weights @ axes[f, :, 0])
    one, other = -n @ w, -g @ w
    if one < 0.5 * other:
        n = unit(n + (0.5 * other - one) / (other - one) * (g - n))
    t, b = (weights @ axes[f, :, k] for k in (1, 2))
    t, b = t - (t @ n) * n, b - (b @ n) * n
    if abs(np.cross(t, b) @ n) <= 1e-6 * np.linalg.norm(t) * np.linalg.norm(b):
        return None
    return np.stack([t, b, -source.thickness * n], axis=1)


def cast(source, camera, search="exact", steps=32, halvings=8, least=10):
    """(depth (h, w), uv and z of the hit (h, w, 3)) float64, inf and NaN where nothing is hit."""
    axes, layers = corner_axes(source), Layers(source)
    size = np.array(source.height.shape[::-1], float)
    depth, place = np.full((camera.height, camera.width), np.inf), np.full((camera.height, camera.width, 3), np.nan)
    corners = source.mesh.vertices[source.mesh.faces] - camera.center
    volume = np.linalg.det(corners)
    for y, x in np.ndindex(depth.shape):
        w = camera.world_from_pixel @ (x + 0.5, y + 0.5, 1.0)
        edges = np.cross(np.roll(corners, -1, axis=1), np.roll(corners, -2, axis=1)) @ w  # (F, 3)
        for f in np.flatnonzero(np.where(volume[:, None] < 0, edges <= 0, False).all(axis=1) & (volume < 0)):
            share = edges[f] / volume[f]
            if not share.sum() > 0:
                continue
            t, weights = 1.0 / share.sum(), share / share.sum()
            uv, z = weights @ source.uv[f], 0.0
            frame = frame_at(source, axes, f, weights, w)
            if frame is not None:
                way = np.linalg.solve(frame, w)
                way, fall = way / way[2], way[2]
                begin, end = 0.0, 1.0
                if source.edges == "cut":
                    for axis in (0, 1):
                        if way[axis]:
                            ends = sorted((edge - uv[axis]) / way[axis] for edge in (0.0, 1.0))
                            begin, end = max(begin, ends[0]), min(end, ends[1])
                if begin > end:
                    continue
                start = np.array([*(uv * size - 0.5), 0.0])
                along = np.array([*(way[:2] * size), 1.0])
                if search == "exact":
                    s = layers.first(start, along, begin, end)
                else:
                    slope = fall * source.thickness / np.linalg.norm(w)
                    count = steps if least >= steps else int(np.ceil(least + (steps - least) * (1 - min(slope, 1))))
                    s = layers.stepped(start, along, begin, end, count, halvings)
                if not np.isfinite(s):
                    continue
                uv, z, t = uv + s * way[:2], s, t + s / fall
            if t < depth[y, x]:
                depth[y, x], place[y, x] = t, (*uv, z)
    return depth, place


TETRAHEDRA = (((0, 0), (1, 0), (2, 0), (2, 1)), ((0, 0), (1, 0), (1, 1), (2, 1)), ((0, 0), (0, 1), (1, 1), (2, 1)))


def smooth_normals(source):
    """(V, 3) normals averaged by angle over all faces around a vertex."""
    places = source.mesh.vertices
    out = np.zeros_like(places)
    for face in source.mesh.faces:
        p = places[face]
        normal = unit(np.cross(p[1] - p[0], p[2] - p[0]))
        for c in range(3):
            one, other = unit(p[(c + 1) % 3] - p[c]), unit(p[(c + 2) % 3] - p[c])
            out[face[c]] += np.arctan2(np.linalg.norm(np.cross(one, other)), one @ other) * normal
    return np.array([unit(each) for each in out]).astype(np.float32).astype(float)


def cast_shell(source, camera):
    """(h, w) float64 depth of the nearest place inside the relief, in all tetrahedra of all prisms; vertices welded.

    For eyes outside and above the relief: whatever is inside counts.
    """
    normals, layers, size = smooth_normals(source), Layers(source), np.array(source.height.shape[::-1], float)
    solids = []
    for f, face in enumerate(source.mesh.faces):
        rank = np.argsort(face)
        for tetra in TETRAHEDRA:
            corner = [(rank[c], floor) for c, floor in tetra]
            places = np.array(
                [source.mesh.vertices[face[c]] - k * source.thickness * normals[face[c]] for c, k in corner]
            )
            texture = np.array([[*(source.uv[f, c] * size - 0.5), k] for c, k in corner])
            solids.append((np.linalg.inv(np.c_[places - camera.center, np.ones(4)].T), texture))
    out = np.full((camera.height, camera.width), np.inf)
    for y, x in np.ndindex(out.shape):
        w = camera.world_from_pixel @ (x + 0.5, y + 0.5, 1.0)
        for inverse, texture in solids:
            way, at = inverse[:, :3] @ w, inverse[:, 3]
            begin, end = 0.0, out[y, x]
            for a, b in zip(at, way):
                if b > 0:
                    begin = max(begin, -a / b)
                elif b < 0:
                    end = min(end, -a / b)
                elif a < 0:
                    end = -1.0
            start, along = texture.T @ at, texture.T @ way
            if source.edges == "cut":
                for axis in (0, 1):
                    if along[axis]:
                        ends = sorted((e - start[axis]) / along[axis] for e in (-0.5, size[axis] - 0.5))
                        begin, end = max(begin, ends[0]), min(end, ends[1])
            if begin <= end:
                out[y, x] = min(out[y, x], layers.first(start, along, begin, end))
    return out
