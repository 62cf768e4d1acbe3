"""Slow plain twins of pre-warped planes as a camera sees them, pixel by pixel in float64."""

from __future__ import annotations

import numpy as np


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
