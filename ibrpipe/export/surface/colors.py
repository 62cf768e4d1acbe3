"""One colour a sample, for programs that know no view dependence: what photos see of it on the mean.

The mean is one of sRGB codes, which errors are measured in. Light that the object mirrors of itself is not traced; the
tables' light stands for it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ibrpipe.core.color import srgb_decode, srgb_encode
from ibrpipe.core.directions import spread_directions
from ibrpipe.core.reflection.directions import pad
from ibrpipe.types import Array, Camera, Texture
from ibrpipe.types.reflection import Reflection

#: cameras that are asked, and directions where there is no camera
MOST_CAMERAS, DIRECTIONS = 24, 48
#: cosine between normal and view from which on a view counts
LEAST_COSINE = 0.15
_BLOCK = 1 << 18


def mean_colors(texture: Texture, places: Array, cameras: Sequence[Camera]) -> Array:
    """Return the colours (S, 3) float32, linear, of a texture's samples.

    Parameters
    ----------
    texture : Texture
    places : (S, 3) float64
        Positions of the samples in the world.
    cameras : sequence of Camera
        Those of the photos; without any, directions all around count alike.
    """
    found = texture.component(Reflection.kind)
    if not isinstance(found, Reflection):
        return texture.layers.color
    eyes = [each.center for each in _some(cameras)]
    views: Array = np.array(eyes) if eyes else spread_directions(DIRECTIONS)
    out = np.empty_like(texture.layers.color)
    for start in range(0, len(out), _BLOCK):
        part = slice(start, start + _BLOCK)
        out[part] = _mean(texture, found, part, places[part], views, bool(eyes))
    return out


def table_lights(padded: Array, directions: Array) -> Array:
    """Light (N, 3) of a padded table (n + 2, n + 2, 3) from directions (N, 3); bilinear."""
    size = padded.shape[0] - 2
    x, y, z = (directions / np.abs(directions).sum(axis=1, keepdims=True)).T
    u = np.where(z < 0, np.copysign(1 - abs(y), x), x)
    v = np.where(z < 0, np.copysign(1 - abs(x), y), y)
    u, v = (u + 1) * 0.5 * size + 0.5, (v + 1) * 0.5 * size + 0.5
    i, j = np.minimum(u.astype(np.int64), size), np.minimum(v.astype(np.int64), size)
    s, t = (u - i)[:, None], (v - j)[:, None]
    upper = (1 - s) * padded[j, i] + s * padded[j, i + 1]
    return (1 - t) * upper + t * ((1 - s) * padded[j + 1, i] + s * padded[j + 1, i + 1])


def _mean(texture: Texture, reflection: Reflection, part: slice, places: Array, views: Array, near: bool) -> Array:
    light, diffuse = reflection.light, texture.layers.color[part]
    tables = pad(light.tables)
    normal = texture.layers.normal[part].astype(np.float64)
    shares = np.ones((len(diffuse), len(tables))) if reflection.weights is None else reflection.weights[part]
    total, count = np.zeros((len(diffuse), 3)), np.zeros(len(diffuse))
    for view in views:
        toward = view - places if near else np.broadcast_to(view, places.shape)
        toward = toward / np.linalg.norm(toward, axis=1, keepdims=True)
        cosine = (normal * toward).sum(axis=1)
        seen = np.flatnonzero(cosine > LEAST_COSINE)
        c = cosine[seen, None]
        mirrored, grazing = 2.0 * c * normal[seen] - toward[seen], (1.0 - c) ** 5
        color = (1.0 - light.damping * grazing) * diffuse[seen]
        for number, (table, f) in enumerate(zip(tables, light.reflectance, strict=True)):
            color = color + shares[seen, number, None] * (f + (1.0 - f) * grazing) * table_lights(table, mirrored)
        total[seen] += srgb_encode(np.minimum(color, 1.0))
        count[seen] += 1
    known = count > 0
    mean = srgb_decode(total[known] / count[known, None])
    out = diffuse.copy()
    out[known] = mean
    return out


def _some(cameras: Sequence[Camera]) -> list[Camera]:
    step = -(-len(cameras) // MOST_CAMERAS) or 1
    return list(cameras[::step])
