"""Slow plain twins of what photos say about a surface point: visibility, diffuse colour, blend of the best four."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Photo:
    """One photo: its camera, colour (H, W, 3), depth (H, W) and mask (H, W)."""

    camera: object
    color: np.ndarray
    depth: np.ndarray
    mask: np.ndarray


def packed(photos):
    """(projection, centers, sizes, starts, color, depth, mask) as the kernels take them."""
    areas = [photo.depth.size for photo in photos]
    return (
        np.stack([p.camera.K @ p.camera.cam_from_world for p in photos]),
        np.stack([p.camera.center for p in photos]),
        np.array([p.depth.shape for p in photos], np.int32),
        np.concatenate([[0], np.cumsum(areas)]).astype(np.int64),
        np.concatenate([p.color.reshape(-1, 3) for p in photos]).astype(np.float32),
        np.concatenate([p.depth.ravel() for p in photos]).astype(np.float32),
        np.concatenate([p.mask.ravel() for p in photos]).astype(np.float32),
    )


def seen_color(photo, point, normal, cos_min, slack):
    """("hidden" | "usable" | "clean", colour): how a photo sees a point, from the pixels that show its surface."""
    camera = photo.camera
    height, width = photo.depth.shape
    local = camera.R @ point + camera.t
    if local[2] <= 0:
        return "hidden", None
    x, y = (camera.K @ local)[:2] / local[2] - 0.5
    if not (0 <= x <= width - 1 and 0 <= y <= height - 1):
        return "hidden", None
    away = camera.center - point
    cosine = float(normal @ away / np.linalg.norm(away))
    if cosine < cos_min:
        return "hidden", None
    tolerance = slack * local[2] / camera.K[0, 0] / max(cosine, 0.05)
    left, top = min(math.floor(x), max(width - 2, 0)), min(math.floor(y), max(height - 2, 0))
    total, color, clean = 0.0, np.zeros(3), True
    for row in (top, min(top + 1, height - 1)):
        for column in (left, min(left + 1, width - 1)):
            same = abs(photo.depth[row, column] - local[2]) <= tolerance and photo.mask[row, column] >= 0.5
            clean &= bool(same and photo.mask[row, column] >= 0.95)
            if same:
                weight = max(0.0, 1 - abs(x - column)) * max(0.0, 1 - abs(y - row))
                total += weight
                color += weight * photo.color[row, column]
    if total < 0.25:
        return "hidden", None
    return "clean" if clean else "usable", color / total


def reduced(values, votes, top, bins, statistic):
    """Median, mean or mode of one channel: the values sorted into bins, then those of the bin that counts averaged."""
    values, votes = np.asarray(values, float), np.asarray(votes, float)
    if statistic == "mean":
        return np.average(values, weights=votes)
    number = np.clip((values / top * bins).astype(int), 0, bins - 1)
    held = np.bincount(number, votes)
    if statistic == "mode":
        middle = {held.argmax()}
    else:
        up_to = held.cumsum() / votes.sum()
        middle = {(up_to >= 0.5 - 1e-9).argmax(), (up_to >= 0.5 + 1e-9).argmax()}
    return np.mean([np.average(values[number == which], weights=votes[number == which]) for which in middle])


def pixels_per_area(photo, point, normal, step=1e-4):
    """Pixels that show a unit of area around a point, by where the corners of a small triangle fall."""
    side = np.cross(normal, [1.0, 0.0, 0.0] if abs(normal[0]) < 0.9 else [0.0, 1.0, 0.0])
    side /= np.linalg.norm(side)
    corners = [point, point + step * side, point + step * np.cross(normal, side)]
    projected = [photo.camera.K @ (photo.camera.R @ corner + photo.camera.t) for corner in corners]
    (x0, y0), (x1, y1), (x2, y2) = ((p[0] / p[2], p[1] / p[2]) for p in projected)
    return abs((x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0)) / step**2


def diffuse(photos, point, normal, cos_min, slack, top, bins, statistic):
    """(colour or NaN, mean absolute deviation, photos used)."""
    found = [(*seen_color(photo, point, normal, cos_min, slack), photo) for photo in photos]
    for kind in ("clean", "usable"):
        colors = np.array([color for quality, color, _ in found if quality == kind])
        if len(colors):
            votes = [pixels_per_area(photo, point, normal) for quality, _, photo in found if quality == kind]
            value = np.array([reduced(colors[:, c], votes, top, bins, statistic) for c in range(3)])
            return value, np.abs(colors - value).mean(), len(colors)
    return np.full(3, np.nan), 0.0, 0


def blend_weights(dots, most=4):
    """Weights dot - (fourth dot), normalised; with fewer than four the threshold lies half the spread below them."""
    dots = np.asarray(dots, float)
    low = dots[-1] if len(dots) == most else dots[-1] - 0.5 * (dots[0] - dots[-1]) - 1e-9
    raw = np.maximum(dots - low, 0)
    return raw / raw.sum() if raw.sum() > 0 else np.full(len(dots), 1 / len(dots))


def angle_weights(dots, most, falloff):
    """(1 - angle / bar) / (angle + 0.003)^falloff, normalised; the bar is the last angle, or 1.2 of it if fewer see."""
    angles = np.arccos(np.clip(dots, -1, 1))
    bar = angles[-1] if len(dots) == most else 1.2 * angles[-1] + 1e-6
    raw = np.maximum(1 - angles / bar, 0) / (angles + 0.003) ** falloff
    return raw / raw.sum() if raw.sum() > 0 else np.full(len(dots), 1 / len(dots))


def keys(t, a):
    """Cubic convolution (keys1981, eq. 4 with a free)."""
    t = abs(t)
    if t < 1:
        return (a + 2) * t**3 - (a + 3) * t**2 + 1
    return a * t**3 - 5 * a * t**2 + 8 * a * t - 4 * a if t < 2 else 0.0


def sharp_color(photo, point, slack, cosine, sharpness):
    """Colour at the projection by cubic convolution; None where 2 x 2 pixels differ or one of 4 x 4 is no object."""
    camera = photo.camera
    height, width = photo.depth.shape
    local = camera.R @ point + camera.t
    x, y = (camera.K @ local)[:2] / local[2] - 0.5
    left, top = min(math.floor(x), max(width - 2, 0)), min(math.floor(y), max(height - 2, 0))
    if left < 1 or top < 1 or left + 2 >= width or top + 2 >= height:
        return None
    block = np.s_[top - 1 : top + 3, left - 1 : left + 3]
    inner = np.s_[top : top + 2, left : left + 2]
    tolerance = slack * local[2] / camera.K[0, 0] / max(cosine, 0.05)
    if not (photo.mask[block] >= 0.5).all() or not (abs(photo.depth[inner] - local[2]) <= tolerance).all():
        return None
    down = [keys(y - row, -sharpness) for row in range(top - 1, top + 3)]
    across = [keys(x - column, -sharpness) for column in range(left - 1, left + 3)]
    return np.einsum("i,j,ijc->c", down, across, photo.color[block].astype(float))


def blend(photos, point, normal, direction, cos_min, slack, most=4, falloff=0.0, sharpness=0.0):
    """(colour or NaN, photos used): the best four, or so many, by angle among those that see the point."""
    found = []
    for photo in photos:
        quality, color = seen_color(photo, point, normal, cos_min, slack)
        if quality != "hidden":
            if sharpness:
                away = photo.camera.center - point
                sharp = sharp_color(photo, point, slack, float(normal @ away / np.linalg.norm(away)), sharpness)
                color = color if sharp is None else sharp
            away = photo.camera.center - point
            found.append((float(away @ direction / np.linalg.norm(away)), color))
    found.sort(key=lambda entry: -entry[0])
    if not found:
        return np.full(3, np.nan), 0
    best = found[:most]
    dots = [dot for dot, _ in best]
    weights = angle_weights(dots, most, falloff) if falloff else blend_weights(dots, most)
    return weights @ np.array([color for _, color in best]), len(best)


def lookup_diffuse(point, facing, texel_sizes, layers):
    """Diffuse colour of a point from the texture that faces it best and knows it; layers: LayeredDepthImage each."""
    for which in np.argsort(-np.asarray(facing), kind="stable"):
        cosine = facing[which]
        if cosine <= 0:
            break
        image = layers[which]
        u, v, wanted = _field_place(image.frame, point)
        slope = math.sqrt(1 - min(cosine, 1.0) ** 2) / cosine
        tolerance = 1.5 * texel_sizes[which] * (1 + slope)
        total, weight = np.zeros(3), 0.0
        for row in range(image.shape[0]):
            for column in range(image.shape[1]):
                share = max(0.0, 1 - abs(u - 0.5 - column)) * max(0.0, 1 - abs(v - 0.5 - row))
                samples = range(image.offsets[row, column], image.offsets[row, column + 1])
                gaps = [(abs(image.depth[i] - wanted), -i) for i in samples if image.observers[i] > 0]
                if share > 0 and gaps and min(gaps)[0] <= tolerance:
                    total += share * image.color[-min(gaps)[1]]
                    weight += share
        if weight > 0.05:
            return total / weight
    return np.full(3, np.nan)


def _field_place(frame, point):
    if hasattr(frame, "K"):
        local = frame.R @ point + frame.t
        u, v, _ = frame.K @ local / local[2]
        return u, v, local[2]
    return np.linalg.solve(np.stack([frame.a, frame.b, frame.f], axis=1), point - frame.origin)


def corner_normals(vertices, faces, crease_deg):
    """(F, 3, 3) unit normals of face corners: faces around a place that bend less than the crease, by angle."""
    vertices = np.asarray(vertices, float)
    out = np.empty((len(faces), 3, 3))
    flat = []
    for face in faces:
        a, b, c = vertices[face]
        normal = np.cross(b - a, c - a)
        flat.append(normal / np.linalg.norm(normal) if np.linalg.norm(normal) > 0 else normal)
    for f, face in enumerate(faces):
        for corner, vertex in enumerate(face):
            total = np.zeros(3)
            for g, other in enumerate(faces):
                for c, second in enumerate(other):
                    bends_little = flat[f] @ flat[g] >= math.cos(math.radians(crease_deg))
                    if (vertices[second] == vertices[vertex]).all() and (f == g or bends_little):
                        one = vertices[other[(c + 1) % 3]] - vertices[second]
                        two = vertices[other[(c + 2) % 3]] - vertices[second]
                        total += math.atan2(np.linalg.norm(np.cross(one, two)), one @ two) * flat[g]
            length = np.linalg.norm(total)
            out[f, corner] = total / length if length > 0 else flat[f]
    return out
