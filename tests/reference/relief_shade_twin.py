"""Slow plain twin of light on relief-mapped meshes: one hit at a time, from what ``docs/renderers/relief.md`` says."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from relief_mesh_twin import Layers, bilinear, unit


@dataclass(frozen=True)
class Light:
    """A lamp: direction or place (counted from the eye), and shares of light (3,) each."""

    way: np.ndarray
    is_place: bool
    ambient: np.ndarray
    diffuse: np.ndarray
    specular: np.ndarray
    shininess: float = 7.0
    shadows: bool = True
    bias: float = 1e-4


def read(levels, wraps, u, v, jacobian, most):
    """(4,) texel of a pyramid [(H, W, 4), ...] over a footprint (2, 2): du, dv per pixel right and down."""
    if most == 0:
        return _bilinear4(levels[0], u, v, wraps)
    scale = np.array([levels[0].shape[1], levels[0].shape[0]])
    axes, (longer, shorter), _ = np.linalg.svd(scale[:, None] * jacobian)
    probes = int(np.clip(math.ceil(longer / max(shorter, 1) - 1e-6), 1, most))
    level = np.clip(math.log2(max(longer / probes, shorter)), 0, len(levels) - 1)
    fine, out = int(level), np.zeros(4)
    for k in range(probes):
        at = np.array([u, v]) + ((k + 0.5) / probes - 0.5) * longer * axes[:, 0] / scale
        out += (1 - level + fine) * _bilinear4(levels[fine], *at, wraps)
        if level > fine:
            out += (level - fine) * _bilinear4(levels[fine + 1], *at, wraps)
    return out / probes


def _bilinear4(image, u, v, wraps):
    if not wraps:
        u, v = np.clip([u, v], 0, 1)
    x, y = u * image.shape[1] - 0.5, v * image.shape[0] - 0.5
    return np.array([bilinear(image[..., k], x, y, wraps) for k in range(4)])


def footprint(frame, world_from_pixel, pixel, t):
    """(2, 2): texture coordinates per pixel right and down, on the plane through a hit parallel to the polygon."""

    def place(x, y):
        way = world_from_pixel @ (x, y, 1.0)
        return frame[:2] @ way * (t * (frame[2] @ middle) / (frame[2] @ way))

    middle, step = world_from_pixel @ (*pixel, 1.0), 1e-4
    ways = [(place(*(pixel + step * way)) - place(*(pixel - step * way))) / (2 * step) for way in np.eye(2)]
    return np.stack(ways, axis=1)


def normal_of(frame, texel, slopes):
    """Normal of a texel: slopes (-dh/du, -dh/dv), or a vector in the frame of the texture's axes."""
    if slopes:
        return unit(texel[0] * frame[0] + texel[1] * frame[1] - frame[2])
    axes = np.linalg.inv(frame).T  # dP/du, dP/dv, -thickness N
    return unit(texel[0] * unit(axes[0]) + texel[1] * unit(axes[1]) - texel[2] * unit(frame[2]))


def back_normal(frame, back, x, y, wraps):
    """Normal of the back layer, out of the object; x, y in texels, centres at whole numbers."""
    step = 1e-5
    u = (bilinear(back, x + step, y, wraps) - bilinear(back, x - step, y, wraps)) / (2 * step) * back.shape[1]
    v = (bilinear(back, x, y + step, wraps) - bilinear(back, x, y - step, wraps)) / (2 * step) * back.shape[0]
    return unit(frame[2] - u * frame[0] - v * frame[1])


def is_shaded(source, frame, uvz, toward, bias, stepped=None):
    """Whether the relief lies between a hit and the light; stepped: (steps, halvings) of the published search."""
    way = frame @ toward
    if way[2] >= 0:
        return True
    way, size = way / way[2], np.array(source.height.shape[::-1])
    entry, begin = uvz[:2] - uvz[2] * way[:2], 0.0
    if source.edges == "cut":
        for axis in (0, 1):
            begin = max(begin, min(-entry[axis] / way[axis], (1 - entry[axis]) / way[axis]))
    end = uvz[2] - bias
    if begin >= end:
        return False
    start, along = np.array([*(entry * size - 0.5), 0.0]), np.array([*(way[:2] * size), 1.0])
    if stepped:
        return Layers(source).stepped(start, along, begin, uvz[2], *stepped) < end
    return Layers(source).first(start, along, begin, end) < np.inf


def lit(source, light, frame, way, t, uvz, color, texel, mapping, slopes, stepped=None):
    """(3,) light of one hit; mapping "plain", "bump", "parallax" or "relief"; texel None = the polygon's normal."""
    base = unit(-frame[2])
    base = -base if base @ way > 0 else base
    layers, place = Layers(source), np.array([*(uvz[:2] * source.height.shape[::-1] - 0.5), uvz[2]])
    n = base if mapping == "plain" else normal_of(frame, texel, slopes)
    if layers.back is not None and mapping == "relief":
        gaps = [abs(place[2] - bilinear(grid, *place[:2], layers.wraps)) for grid in (layers.front, layers.back)]
        n = back_normal(frame, layers.back, *place[:2], layers.wraps) if gaps[1] < gaps[0] else n
    toward = unit(light.way - t * way if light.is_place else light.way)
    gate = 1.0 if layers.back is not None else min(1.0, 8 * max(0.0, toward @ base))
    shine, gloss = max(0.0, toward @ n), 0.0
    if shine > 0:
        gloss = max(0.0, unit(toward + unit(-way)) @ n) ** light.shininess
    able = light.shadows and mapping == "relief" and shine > 0 and gate > 0
    if able and is_shaded(source, frame, uvz, toward, light.bias, stepped):
        shine, gloss = shine * light.ambient.mean(), 0.0
    return light.ambient * color + gate * (light.diffuse * color * shine + light.specular * gloss)
