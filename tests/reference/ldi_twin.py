"""Slow plain twins of the `ldi` renderer: neighbours and patches by sets, ray hits by trying every patch in float64.

Written from ``docs/renderers/ldi.md`` alone; nothing of the package's kernels is used.
"""

from __future__ import annotations

import itertools

import numpy as np

from ibrpipe.types import Camera, DepthImage, LayeredDepthImage, ReliefTexture

GAP, STEEPEST = 4.0, 4.0


def homogeneous(frame, points):
    """(x, y, n, q) of world points, u = x / q, v = y / q, d = n / q; linear in the point."""
    points = np.asarray(points, float)
    if isinstance(frame, Camera):
        x, y, q = np.moveaxis((points - frame.center) @ (frame.K @ frame.R).T, -1, 0)
        return np.stack([x, y, -np.ones_like(q), q], -1)
    u, v, d = np.moveaxis((points - frame.origin) @ np.linalg.inv(np.stack([frame.a, frame.b, frame.f], 1)).T, -1, 0)
    return np.stack([u, v, d, np.ones_like(u)], -1)


def sample_lists(layers):
    """Sample numbers of every texel, field depths, and slopes along u and v (NaN = unknown)."""
    rows, columns = layers.shape
    texels = {
        (r, c): list(range(layers.offsets[r, c], layers.offsets[r, c + 1])) for r in range(rows) for c in range(columns)
    }
    frame, depth, slope, texel = layers.frame, np.array(layers.depth, float), {}, {}
    if isinstance(frame, Camera):
        depth = (-1.0 / depth).astype(np.float32).astype(float)
    for (r, c), members in texels.items():
        for s in members:
            n = np.asarray(layers.normal[s], float)
            if isinstance(frame, Camera):
                g = n @ frame.world_from_pixel
                raw = depth[s] * g[:2] / (g @ np.array([c + 0.5, r + 0.5, 1.0]))
                texel[s] = -depth[s] / np.array([frame.K[0, 0], frame.K[1, 1]])
            else:
                with np.errstate(divide="ignore", invalid="ignore"):
                    raw = -np.array([n @ frame.a, n @ frame.b]) / (n @ frame.f)
                texel[s] = np.array([np.linalg.norm(frame.a), np.linalg.norm(frame.b)])
            slope[s] = np.clip(raw, -STEEPEST * texel[s], STEEPEST * texel[s]).astype(np.float32).astype(float)
    return texels, depth, slope, texel


def link(texels, depth, slope, texel, gap):
    """Set of (sample, sample, axis): mutual best partners among permitted pairs."""

    def cost(p, q, axis):
        jump, size = depth[q] - depth[p], min(texel[p][axis], texel[q][axis])
        a, b = slope[p][axis], slope[q][axis]
        if np.isnan(a) or np.isnan(b):
            return abs(jump) if abs(jump) <= gap * size else np.inf
        return abs(jump - (a + b) / 2) if min(a, b) - size <= jump <= max(a, b) + size else np.inf

    links = set()
    for (r, c), here in texels.items():
        for axis, there in ((0, texels.get((r, c + 1), [])), (1, texels.get((r + 1, c), []))):
            for p, q in itertools.product(here, there):
                mine = [cost(p, k, axis) for k in there]
                yours = [cost(k, q, axis) for k in here]
                if cost(p, q, axis) < np.inf and there[int(np.argmin(mine))] == q and here[int(np.argmin(yours))] == p:
                    links.add((p, q, axis))
    return links


def patches_of_layers(layers, gap=GAP):
    """List of (column, row, corner depths (4,), present (4,) bool, samples (4,)); column, row of the cell from -1."""
    texels, depth, slope, texel = sample_lists(layers)
    links = link(texels, depth, slope, texel, gap)
    found = []
    rows, columns = layers.shape
    for r, c in itertools.product(range(-1, rows), range(-1, columns)):
        corners = [texels.get((r + dr, c + dc), []) for dr, dc in ((0, 0), (0, 1), (1, 0), (1, 1))]
        groups = [{k: s} for k, members in enumerate(corners) for s in members]
        for a, b, axis in ((0, 1, 0), (1, 3, 1), (2, 3, 0), (0, 2, 1)):
            for p, q in itertools.product(corners[a], corners[b]):
                if (p, q, axis) in links:
                    first = next(g for g in groups if g.get(a) == p)
                    second = next(g for g in groups if g.get(b) == q)
                    if first is not second and not set(first) & set(second):
                        first.update(second)
                        groups.remove(second)
        found += [(c, r, *complete(g, depth, slope)) for g in groups]
    return found


def complete(group, depth, slope):
    """Corner depths with the missing ones predicted, presence, samples."""

    def ahead(k, axis, sign):
        step = slope[group[k]][axis]
        return depth[group[k]] + (0.0 if np.isnan(step) else sign * step)

    values = []
    for k in range(4):
        sign_u, sign_v = (1 if k & 1 else -1), (1 if k & 2 else -1)
        if k in group:
            values.append(depth[group[k]])
            continue
        guesses = [ahead(n, axis, s) for n, axis, s in ((k ^ 1, 0, sign_u), (k ^ 2, 1, sign_v)) if n in group]
        if not guesses:
            o = k ^ 3
            guesses = [ahead(o, 0, sign_u) + ahead(o, 1, sign_v) - depth[group[o]]]
        values.append(np.mean(guesses))
    return np.array(values), np.array([k in group for k in range(4)]), [group.get(k, -1) for k in range(4)]


def patches_of_heights(height):
    """As `patches_of_layers`, for a height field: cells whose four corners are finite."""
    h = np.asarray(height, float)
    cells = itertools.product(range(h.shape[0] - 1), range(h.shape[1] - 1))
    quads = ((c, r, h[[r, r, r + 1, r + 1], [c, c + 1, c, c + 1]]) for r, c in cells)
    return [(c, r, quad, np.ones(4, bool), None) for c, r, quad in quads if np.isfinite(quad).all()]


def single_layers(frame, depth, color):
    """One sample per finite texel, normals unknown."""
    there = np.isfinite(depth)
    ends = np.cumsum(there).reshape(depth.shape)
    offsets = np.concatenate([np.r_[0, ends[:-1, -1]][:, None], ends], 1)
    return LayeredDepthImage(frame, offsets, depth[there], color[there], np.full((int(there.sum()), 3), np.nan))


def patches_of(source):
    """(frame, patches, side) of any source; side 1: seen from lesser depth, -1: from greater, 0: from both."""
    if isinstance(source, ReliefTexture) and min(source.height.shape) > 1:
        return source.frame, patches_of_heights(source.height), 0
    if isinstance(source, ReliefTexture):
        layers = single_layers(source.frame, source.height, source.color)
        return source.frame, patches_of_layers(layers, np.inf), 1
    if isinstance(source, DepthImage):
        return source.camera, patches_of_layers(single_layers(source.camera, source.depth, source.color)), 1
    return source.frame, patches_of_layers(source), side_of(source)


def side_of(layers):
    """-1 where most known normals point away from the image plane, else 1."""
    away = 0
    for row, column in np.ndindex(layers.shape):
        for sample in range(layers.offsets[row, column], layers.offsets[row, column + 1]):
            ray = layers.frame.f if hasattr(layers.frame, "f") else layers.frame.pixel_rays([column + 0.5, row + 0.5])
            along = float(layers.normal[sample] @ ray)
            away += int(along > 0) - int(along < 0)
    return -1 if away > 0 and np.diff(layers.offsets, axis=1).max() < 2 else 1


def cast(source, camera, slack):
    """(H, W) float64 nearest camera depth over all patches, their borders moved outward by `slack` cells."""
    frame, patches, front = patches_of(source)
    y, x = np.mgrid[: camera.height, : camera.width] + 0.5
    ways = np.stack([x, y, np.ones_like(x)], -1) @ camera.world_from_pixel.T
    P = homogeneous(frame, camera.center)
    Q = homogeneous(frame, camera.center + ways) - P
    best = np.full(x.shape, np.inf)
    for column, row, depths, present, _ in patches:
        for t, good in roots(P, Q, column + 0.5, row + 0.5, depths, present, front, slack):
            best = np.where(good & (t < best), t, best)
    return best


def roots(P, Q, u0, v0, depths, present, front, slack):
    """Both roots t of d = bilinear(u, v), multiplied out by q twice, with whether they count."""
    a, b, c, e = depths
    (x0, x1), (y0, y1) = (P[0] - u0 * P[3], Q[..., 0] - u0 * Q[..., 3]), (P[1] - v0 * P[3], Q[..., 1] - v0 * Q[..., 3])
    (n0, n1), (q0, q1) = (P[2], Q[..., 2]), (P[3], Q[..., 3])
    k = a - b - c + e

    def pair(s0, s1, w0, w1):
        return s0 * w0, s0 * w1 + s1 * w0, s1 * w1

    terms = [
        (1.0, pair(n0, n1, q0, q1)),
        (-a, pair(q0, q1, q0, q1)),
        (a - b, pair(x0, x1, q0, q1)),
        (a - c, pair(y0, y1, q0, q1)),
        (-k, pair(x0, x1, y0, y1)),
    ]
    C, B, A = (sum(weight * poly[i] for weight, poly in terms) for i in range(3))
    square = B * B - 4 * A * C
    with np.errstate(all="ignore"):
        w = -0.5 * (B + np.where(B < 0, -1.0, 1.0) * np.sqrt(square))
        for t in (C / w, w / A):
            q = q0 + t * q1
            u, v = (x0 + t * x1) / q, (y0 + t * y1) / q
            inside = np.zeros(np.shape(t), bool)
            for corner in range(4):
                if present[corner]:
                    left, top = 0.5 * (corner & 1), 0.5 * (corner >> 1)
                    inside |= (abs(u - left - 0.25) <= 0.25 + slack) & (abs(v - top - 0.25) <= 0.25 + slack)
            rising = (front * (2 * A * t + B) > 0) | (front == 0)
            yield t, (square >= 0) & (t > 0) & (q > 0) & np.isfinite(t) & inside & rising
