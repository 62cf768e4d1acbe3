"""Slow plain twins of PatchMatch: cost of a plane, half a sweep, agreement of depth maps; all in float64."""

from __future__ import annotations

import numpy as np

FLOOR, UNSEEN, STEEPEST = 2.0, 2.0, -0.14


def mixed(h):
    h ^= h >> 16
    h = h * 0x21F0AAAD % 2**32
    return h ^ (h >> 15)


def uniform(seed, pixel, turn, salt):
    h = (seed * 0x21F0AAAD + pixel) % 2**32
    for extra in (turn, salt):
        h = (mixed(h) ^ extra) * 0x735A2D97 % 2**32
        h ^= h >> 15
    return mixed(h) / 2**32


def unit(v):
    return v / np.linalg.norm(v)


def ray(x, y, lens):
    return unit(np.array([(x - lens[2]) / lens[0], (y - lens[3]) / lens[1], 1.0]))


def towards(normal, x, y, lens):
    r, n = ray(x, y, lens), unit(normal)
    n = -n if n @ r > 0 else n
    if n @ r > STEEPEST:
        side = unit(n - (n @ r) * r)
        n = side * np.sqrt(1 - STEEPEST**2) + STEEPEST * r
    return n


def normal_of(plane, x, y, lens):
    q, a, b = plane
    K = np.array([[lens[0], 0, lens[2]], [0, lens[1], lens[3]], [0, 0, 1]])
    return unit(-K.T @ np.array([a, b, q - a * x - b * y]))


def plane_of(q, normal, x, y, lens):
    K = np.array([[lens[0], 0, lens[2]], [0, lens[1], lens[3]], [0, 0, 1]])
    g = np.linalg.inv(K).T @ normal
    g *= q / (g @ [x, y, 1])
    return np.array([q, g[0], g[1]])


def random_normal(seed, pixel, turn, salt, x, y, lens):
    z = 2 * uniform(seed, pixel, turn, salt) - 1
    phi = 2 * np.pi * uniform(seed, pixel, turn, salt + 1)
    r = np.sqrt(1 - z * z)
    return towards(np.array([r * np.cos(phi), r * np.sin(phi), z]), x, y, lens)


def bilinear(grey, u, v):
    height, width = grey.shape
    u, v = np.clip(u - 0.5, 0, width - 1.001), np.clip(v - 0.5, 0, height - 1.001)
    i, j = int(v), int(u)
    fu, fv = u - j, v - i
    rows = grey[i : i + 2, j : j + 2]
    return (1 - fv) * ((1 - fu) * rows[0, 0] + fu * rows[0, 1]) + fv * ((1 - fu) * rows[1, 0] + fu * rows[1, 1])


def plane_cost(reference, valid, grey, view, window, softness, i, j, plane):
    """1 - weighted correlation of the window around (i, j) with where the plane takes it in `grey`."""
    M, m = view[:9].reshape(3, 3), view[9:12]
    x, y = j + 0.5, i + 0.5
    centre = M @ [x, y, 1] + m * plane[0]
    if not (centre[2] > 1e-6 and 0 <= centre[0] < view[12] * centre[2] and 0 <= centre[1] < view[13] * centre[2]):
        return UNSEEN
    w, r, s = [], [], []
    for dx, dy, space in window.T:
        row, column = int(i + dy), int(j + dx)
        if not (0 <= row < valid.shape[0] and 0 <= column < valid.shape[1] and valid[row, column]):
            continue
        apart = reference[row, column] - reference[i, j]
        w.append(max(0.0, 1 - apart**2 * softness - space) ** 16)
        r.append(reference[row, column])
        u, v, scale = M @ [x + dx, y + dy, 1] + m * (plane[0] + plane[1] * dx + plane[2] * dy)
        s.append(bilinear(grey, u / scale, v / scale))
    w, r, s = np.array(w) / np.sum(w), np.array(r), np.array(s)
    dr, ds = r - w @ r, s - w @ s
    return 1 - w @ (dr * ds) / np.sqrt((w @ dr**2 + FLOOR) * (w @ ds**2 + FLOOR))


def disagreement(view, other, i, j, q, most):
    x, y = j + 0.5, i + 0.5
    u, v, w = view[:9].reshape(3, 3) @ [x, y, 1] + view[9:12] * q
    if w <= 1e-6 or not (0 <= u / w < view[12] and 0 <= v / w < view[13]):
        return most
    u, v = u / w, v / w
    back = other[int(v), int(u)]
    s, t, r = view[16:25].reshape(3, 3) @ [u, v, 1] + view[25:28] * back
    return min(np.hypot(s / r - x, t / r - y), most) if back > 0 and r > 1e-6 else most


def agrees(plane, view, other, limits, lens, i, j):
    """Does the neighbour's own plane, other (3, H, W), lead back to the pixel, its depth and its normal?"""
    x, y = j + 0.5, i + 0.5
    M, m = view[:9].reshape(3, 3), view[9:12]
    u, v, w = M @ [x, y, 1] + m * plane[0]
    if w <= 1e-6 or not (0 <= u / w < view[12] and 0 <= v / w < view[13]):
        return False
    u, v = u / w, v / w
    q, a, b = other[:, int(v), int(u)].astype(float)
    back = q + a * (u - int(u) - 0.5) + b * (v - int(v) - 0.5)
    s, t, r = view[16:25].reshape(3, 3) @ [u, v, 1] + view[25:28] * back
    if not (q > 0 and back > 0 and r > 1e-6 and abs(r * plane[0] / back - 1) < limits[1]):
        return False
    g = M.T @ [a, b, back - a * u - b * v]
    seen = normal_of((g @ [x, y, 1], g[0], g[1]), x, y, lens)
    own = normal_of(plane.astype(float), x, y, lens)
    return bool(np.hypot(s / r - x, t / r - y) < limits[0] and seen @ own > limits[2])


def regions(i, j):
    for far in (False, True):
        for di, dj in ((1, 0), (-1, 0), (0, 1), (0, -1)):
            if far:
                places = [(3 + 2 * k, 0) for k in range(11)]
            else:
                places = [(1, 0)] + [(k + 1, sign * k) for k in (1, 2, 3) for sign in (1, -1)]
            yield [(i + di * a + (c if di == 0 else 0), j + dj * a + (c if dj == 0 else 0)) for a, c in places]


def proposed(state, valid, i, j):
    planes = [state[:3, i, j]]
    for region in regions(i, j):
        inside = [(y, x) for y, x in region if 0 <= y < valid.shape[0] and 0 <= x < valid.shape[1] and valid[y, x]]
        inside = [place for place in inside if np.isfinite(state[3][place])]
        if inside:
            y, x = min(inside, key=lambda place: state[3][place])
            q, a, b = state[:3, y, x]
            planes.append(np.array([q + a * (j - x) + b * (i - y), a, b]))
    return planes


def changed(plane, ranges, reach, lens, i, j, seed, pixel, turn):
    x, y = j + 0.5, i + 0.5
    q, n = plane[0], normal_of(plane, x, y, lens)
    low, high, step = ranges

    def draw(k, more):
        return uniform(seed, pixel, turn, 8 * (k + 1) + more)

    def moved(k, share):
        return q + (2 * draw(k, 0) - 1) * share * reach * step

    def turned(k):
        return n + min(0.3 * reach, 0.6) * (2 * np.array([draw(k, 1), draw(k, 2), draw(k, 3)]) - 1)

    tries = [(moved(0, 1), n), (moved(1, 0.15), n), (moved(2, 1), turned(2)), (q, turned(3))]
    anywhere = low + (high - low) * draw(4, 0)
    tries += [(anywhere, random_normal(seed, pixel, turn, 44, x, y, lens))]
    tries += [(q, random_normal(seed, pixel, turn, 52, x, y, lens))]
    return [plane_of(min(max(p, low), high), towards(m, x, y, lens), x, y, lens) for p, m in tries]


def chosen_views(costs, turn, keep):
    limit = 0.8 * np.exp(-turn * turn / 90)
    scores = np.where(costs < limit, np.exp(-(costs**2) / 0.18), 0).sum(axis=0)
    scores += 1e-4 * (2.001 - np.minimum(costs.min(axis=0), UNSEEN))
    weights = np.zeros(len(scores))
    best = np.argsort(-scores, kind="stable")[:keep]
    weights[best] = scores[best] / scores[best].sum()
    return weights


def half_sweep(
    colour, turn, seed, reach, keep, softness, consistency, ranges, lens, window, reference, valid, views, greys,
    others, state,
):  # fmt: skip
    """New state (4, H, W) after one half of a sweep; greys and others: lists of (H, W)."""
    out = state.astype(float)
    for i, j in np.argwhere(valid):
        if (i + j) % 2 != colour:
            continue

        def cost(view, grey, other, plane, i=i, j=j):
            found = plane_cost(reference, valid, grey, view, window, softness, i, j, plane)
            if consistency[0] > 0 and found < UNSEEN:
                found += consistency[0] * disagreement(view, other, i, j, plane[0], consistency[1])
            return found

        planes = proposed(out, valid, i, j)
        costs = np.array([[cost(*each, plane) for each in zip(views, greys, others)] for plane in planes])
        weights = chosen_views(costs, turn, keep)
        totals = costs @ weights
        best, least = planes[int(np.argmin(totals))], totals.min()
        for plane in changed(best, ranges, reach, lens, i, j, seed, i * valid.shape[1] + j, turn):
            total = sum(w * cost(*each, plane) for w, *each in zip(weights, views, greys, others) if w > 0)
            if total < least:
                best, least = plane, total
        out[:3, i, j], out[3, i, j] = best, least
    return out


def fit_planes(inverse, radius, tolerance):
    """Plane (3, H, W) of each pixel's inverse depths by NumPy's least squares."""
    rows, columns = inverse.shape
    planes = np.zeros((3, rows, columns))
    for i in range(rows):
        for j in range(columns):
            q = float(inverse[i, j])
            if q <= 0:
                continue
            kept = []
            for y in range(max(i - radius, 0), min(i + radius, rows - 1) + 1):
                for x in range(max(j - radius, 0), min(j + radius, columns - 1) + 1):
                    reach = tolerance * (1 + max(abs(x - j), abs(y - i)))
                    if inverse[y, x] > 0 and abs(float(inverse[y, x]) - q) <= reach:
                        kept.append((1, x - j, y - i, float(inverse[y, x])))
            known = np.array(kept, float)
            moments = known[:, :3].T @ known[:, :3]
            spread = np.linalg.det(moments) * moments[0, 0]
            if len(kept) < 6 or spread <= 1e-3 * len(kept) ** 4:
                planes[:, i, j] = q, 0, 0
            else:
                planes[:, i, j] = np.linalg.lstsq(known[:, :3], known[:, 3], rcond=None)[0]
    planes[0] = np.maximum(planes[0], 0)
    return planes
