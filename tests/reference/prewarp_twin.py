"""Slow plain twins in float64: pre-warping, every segment painted in order; pre-warped planes as a camera sees them."""

from __future__ import annotations

import numpy as np


def paint_line(places, values, centers, x, order):
    """Last segment in `order` (pairs of neighbours) that covers each x -> interpolated value, NaN = none."""
    out = np.full(len(x), np.nan)
    for i, j in order:
        p, q = places[i], places[j]
        if np.isnan(p) or np.isnan(q):
            continue
        inside = (x >= min(p, q)) & (x < max(p, q)) & centers(x)
        out[inside] = values[i] + (x[inside] - p) / (q - p) * (values[j] - values[i])
    return out


def warp_line(values, places, e, x, joined=None):
    """One line toward the foot `e` of the eye from both sides."""
    n = len(values)
    u = np.arange(n) + 0.5
    joined = np.ones(n - 1, bool) if joined is None else joined
    rising = [(i, i + 1) for i in range(n - 1) if u[i] <= e and joined[i]]
    falling = [(i, i + 1) for i in range(n - 2, -1, -1) if u[i + 1] >= e and joined[i]]
    before = paint_line(places, values, lambda s: s < e, x, rising)
    return np.where(x < e, before, paint_line(places, values, lambda s: s >= e, x, falling))


def warp_plane(height, eye, x, y, gap=np.inf):
    """Shifts g of the plane d = 0 at pixel centres x (columns), y (rows), by both passes; eye (e_u, e_v, h)."""
    e_u, e_v, h = eye
    shift = height / (h - height)
    u, v = np.arange(height.shape[1]) + 0.5, np.arange(height.shape[0]) + 0.5
    first = np.stack(
        [warp_line(g, u + (u - e_u) * g, e_u, x, np.abs(np.diff(d)) <= gap) for g, d in zip(shift, height, strict=True)]
    )
    columns = []
    for g in first.T:
        depth = h * g / (1 + g)
        with np.errstate(invalid="ignore"):
            columns.append(warp_line(g, v + (v - e_v) * g, e_v, y, np.abs(np.diff(depth)) <= gap))
    return np.stack(columns, axis=1)


def warp_wall(height, eye, at, x, y):
    """Shifts of the face v = `at` beyond the rows, at columns x and depths y; the eye on the side of lesser v."""
    e_u, e_v, h = eye
    rows, columns = height.shape
    u, v = np.arange(columns) + 0.5, np.arange(rows) + 0.5
    keep = [k for k in range(rows) if v[k] > e_v + 1e-4]
    g = {k: (at - v[k]) / (v[k] - e_v) for k in keep}
    depth = {}
    for k in keep:
        places = u + (u - e_u) * g[k]
        order = [(i, i + 1) for i in range(columns - 1)]
        depth[k] = paint_line(places, height[k], lambda s: s == s, x, order)
    out = np.full((len(y), len(x)), np.nan)
    for c in range(len(x)):
        d = np.array([depth[k][c] for k in keep])
        shifts = np.array([g[k] for k in keep])
        places = d + (d - h) * shifts
        order = [(i, i + 1) for i in range(len(keep) - 2, -1, -1)]
        out[:, c] = paint_line(places, shifts, lambda s: s == s, y, order)
    return out


def warp_cells(height, eye, x, y):
    """Shifts of the plane d = 0 by every cell between four texels; of those on one ray the nearest, by its depth."""
    e_u, e_v, h = eye
    g = height / (h - height)
    u, v = np.arange(height.shape[1]) + 0.5, np.arange(height.shape[0]) + 0.5
    p, q = u + (u - e_u) * g, v[:, None] + (v[:, None] - e_v) * g
    best = np.full((len(y), len(x)), np.nan)
    for k, i in np.ndindex(height.shape[0] - 1, height.shape[1] - 1):
        edges = [((k, i), (k, i + 1)), ((k + 1, i), (k + 1, i + 1)), ((k, i), (k + 1, i)), ((k, i + 1), (k + 1, i + 1))]
        if np.isnan(g[k : k + 2, i : i + 2]).any():
            continue
        for n, at in enumerate(x):
            met = []
            for one, two in edges:
                if (p[one] <= at) != (p[two] <= at):
                    t = (at - p[one]) / (p[two] - p[one])
                    met.append((q[one] + t * (q[two] - q[one]), g[one] + t * (g[two] - g[one])))
            if len(met) < 2:
                continue
            (low, g_low), (high, g_high) = min(met), max(met)
            inside = (y >= low) & (y < high)
            shift = g_low + (y[inside] - low) / (high - low) * (g_high - g_low)
            best[inside, n] = np.fmax(best[inside, n], shift)
    return best


def mean_over_pixels(places, values, count, steps=4000):
    """Mean of a piecewise linear function of rising places over pixels 0 .. count - 1, and the share covered."""
    x = (np.arange(count * steps) + 0.5) / steps - 0.5
    found = np.interp(x, places, values, left=np.nan, right=np.nan).reshape(count, steps)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.nansum(found, axis=1) / np.isfinite(found).sum(axis=1), np.isfinite(found).mean(axis=1)


def plane_points(homography, bounds, shape):
    """Yield (y, x, u, v, w) of the pixels whose ray meets the rectangle (x0, x1, y0, y1) before the camera."""
    for y, x in np.ndindex(shape):
        u, v, w = homography[:3] @ (x + 0.5, y + 0.5, 1.0)
        if w > 0 and bounds[0] <= u / w <= bounds[1] and bounds[2] <= v / w <= bounds[3]:
            yield y, x, u / w, v / w, w


def corners(picture, u, v):
    """Weights (4,) and values (4, ...) of the pixels around a place, kept inside the picture; and the nearest one."""
    rows, columns = picture.shape[:2]
    s, t = np.clip(u - 0.5, 0, columns - 1), np.clip(v - 0.5, 0, rows - 1)
    i, j = min(int(s), max(columns - 2, 0)), min(int(t), max(rows - 2, 0))
    i1, j1 = min(i + 1, columns - 1), min(j + 1, rows - 1)
    p, q = s - i, t - j
    values = np.array([picture[j, i], picture[j, i1], picture[j1, i], picture[j1, i1]], float)
    return np.array([(1 - p) * (1 - q), p * (1 - q), (1 - p) * q, p * q]), values, (p >= 0.5) + 2 * (q >= 0.5)


def shift_at(shifts, u, v, jump):
    """(g, is it between four pixels of one surface?) at a place of the plane's picture."""
    weights, values, nearest = corners(shifts, u, v)
    near = values[nearest]
    if np.isfinite(values).all() and np.ptp(values) <= jump * (1 + near) ** 2:
        return weights @ values, True
    return near, False


def view_depth(shifts, homography, bounds, jump, shape):
    """(h, w) camera depth, inf where the plane is not seen."""
    out = np.full(shape, np.inf)
    for y, x, u, v, w in plane_points(homography, bounds, shape):
        g, _ = shift_at(shifts, u, v, jump)
        if 1 + g > 0:
            out[y, x] = homography[3, 2] / w / (1 + g)
    return out


def view_area(picture, homography, bounds, jump, shape):
    """(h, w) depth and (h, w, 3) colour of a picture with colours; colours are mixed wherever none is missing."""
    depth, color = np.full(shape, np.inf), np.full((*shape, 3), np.nan)
    for y, x, u, v, w in plane_points(homography, bounds, shape):
        weights, values, nearest = corners(picture, u, v)
        g, _ = shift_at(picture[..., 3], u, v, jump)
        if 1 + g > 0:
            depth[y, x] = homography[3, 2] / w / (1 + g)
            color[y, x] = weights @ values[:, :3] if np.isfinite(values[:, 3]).all() else values[nearest, :3]
    return depth, color


def view_color(depth, homography, eye, color):
    """(h, w, 3) colour of the texture where a pixel's ray is at its depth."""
    out = np.zeros((*depth.shape, 3))
    for y, x in np.argwhere(np.isfinite(depth)):
        u, v = eye + depth[y, x] * (homography @ (x + 0.5, y + 0.5, 1.0))
        weights, values, _ = corners(color, u, v)
        out[y, x] = weights @ values
    return out
