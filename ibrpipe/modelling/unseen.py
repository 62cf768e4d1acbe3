"""Samples that no photo shows: colours of their neighbours, and which of them lie in gaps of what photos show."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ibrpipe.modelling.diffuse_refinement import sample_points
from ibrpipe.modelling.rectangles import Rectangle
from ibrpipe.types import Array, LayeredDepthImage

#: a turn of the normal to the opposite side is as far as this many extents of the object, half
TURNED = 0.15
#: neighbours that are asked for a colour
ASKED = 4


def fill_colors(color: Array, points: Array, normals: Array, extent: float) -> Array:
    """Give samples without colour (NaN) that of the nearest samples with one.

    Nearness counts the normal, too: a turn to the opposite side is as far as 0.3 extents, so that the sides of a thin
    wall do not take each other's colour.
    """
    known = np.isfinite(color[:, 0])
    if known.all() or not known.any():
        return np.nan_to_num(color)
    keys = _keys(points, normals, extent)
    apart, found = _nearest(keys[known], keys[~known], min(ASKED, int(known.sum())))
    weights = 1.0 / (apart + 1e-9 * extent)
    weights /= weights.sum(axis=1, keepdims=True)
    out = color.copy()
    out[~known] = (weights[:, :, None] * color[known][found]).sum(axis=1)
    return out


def close_gaps(
    rectangles: Sequence[Rectangle], layers: Sequence[LayeredDepthImage], reach: float
) -> tuple[list[LayeredDepthImage], list[float]]:
    """Give samples that no photo shows, but that lie next to ones that photos show, the colour of these.

    Parameters
    ----------
    reach : distance over which a colour is carried, texels; 0 = none is

    Returns
    -------
    layers : list of LayeredDepthImage
        Samples that got a colour have 1 observer; the others are as before.
    shares : list of float
        Of each one's samples, those that got a colour.
    """
    points = np.concatenate([sample_points(r, each) for r, each in zip(rectangles, layers, strict=True)])
    normals, color = (np.concatenate([getattr(each, n) for each in layers]) for n in ("normal", "color"))
    seen = np.concatenate([observers_of(each) for each in layers]) > 0
    if reach <= 0 or not len(points) or seen.all() or not seen.any():
        return list(layers), [0.0] * len(layers)
    extent = float(np.ptp(points, axis=0).max())
    keys, texel = (
        _keys(points, normals, extent),
        np.repeat([r.texel for r in rectangles], [len(x.depth) for x in layers]),
    )
    apart, _ = _nearest(keys[seen], keys[~seen], 1)
    taken = np.flatnonzero(~seen)[apart[:, 0] <= reach * texel[~seen]]
    wanted = seen.copy()
    wanted[taken] = True
    filled = fill_colors(np.where(seen[:, None], color, np.nan)[wanted], points[wanted], normals[wanted], extent)
    color = color.copy()
    color[wanted] = filled
    result, shares, start = list[LayeredDepthImage](), list[float](), 0
    for each in layers:
        own = slice(start, start := start + len(each.depth))
        gaps = wanted[own] & ~seen[own]
        result.append(replace(each, color=color[own], observers=np.where(gaps, 1, observers_of(each))))
        shares.append(float(gaps.mean()) if len(gaps) else 0.0)
    return result, shares


def _keys(points: Array, normals: Array, extent: float) -> Array:
    """(N, 6) what nearness is measured between: points and, as a length, normals."""
    return np.concatenate([points, TURNED * extent * np.nan_to_num(normals)], axis=1)


def _nearest(known: Array, asked: Array, count: int) -> tuple[Array, Array]:
    """Distances and numbers (N, count) of the nearest known keys of every one that asks."""
    from scipy.spatial import cKDTree

    apart, found = cKDTree(known).query(asked, k=count)
    return apart.reshape(len(asked), count), found.reshape(len(asked), count)


def observers_of(layers: LayeredDepthImage) -> Array:
    """(S,) int32 photos that show every sample; 1 where that is not told."""
    return np.ones(len(layers.depth), np.int32) if layers.observers is None else layers.observers
