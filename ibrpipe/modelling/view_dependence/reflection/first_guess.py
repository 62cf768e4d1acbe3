"""First guess of diffuse colours, and which samples the observations speak of at all."""

from __future__ import annotations

import numpy as np

from ibrpipe.modelling.unseen import fill_colors
from ibrpipe.modelling.view_dependence.reflection.observations import Observations
from ibrpipe.renderers.view_dependence.mirror import Surface
from ibrpipe.types import Array

#: of all colours that photos show of a sample, lowest first: highlights are brighter
QUANTILE = 0.35


def seen_weight(observations: Observations, corners: Array, samples: int) -> Array:
    """(samples,) float64 weight with which the observations speak of each sample."""
    mine, weights = corners[observations.where[:, 0]], corner_weights(observations, corners)
    total = np.zeros(samples)
    for c in range(4):
        known = mine[:, c] >= 0
        total += np.bincount(mine[known, c], (weights[:, c] * observations.traits[:, 5])[known], samples)
    return total


def corner_weights(observations: Observations, corners: Array) -> Array:
    """(N, 4) float32 bilinear weights of every observation's samples, not renormalised."""
    p, q = observations.traits[:, 0], observations.traits[:, 1]
    weights = np.stack([(1 - p) * (1 - q), p * (1 - q), (1 - p) * q, p * q], axis=1)
    return np.where(corners[observations.where[:, 0]] >= 0, weights, 0.0)


def first_colors(observations: Observations, corners: Array, samples: int) -> Array:
    """First guess of diffuse colours: per channel a low quantile of what the observations nearest to a sample show.

    Returns
    -------
    (samples, 3) float32, linear; NaN where no observation is nearest
    """
    weights = corner_weights(observations, corners)
    nearest = corners[observations.where[:, 0], weights.argmax(axis=1)]
    usable = np.flatnonzero((weights.max(axis=1) > 0) & (observations.traits[:, 5] > 0))
    nearest = nearest[usable]
    counts = np.bincount(nearest, minlength=samples)
    rank = np.cumsum(counts) - counts + np.maximum(np.ceil(QUANTILE * counts).astype(np.int64) - 1, 0)
    out = np.full((samples, 3), np.nan, np.float32)
    for channel in range(3):
        root = np.abs(observations.traits[usable, 6 + channel])
        ordered = root[np.lexsort((root, nearest))]
        out[counts > 0, channel] = ordered[rank[counts > 0]] ** 2
    return out


def guess(observations: Observations, surface: Surface, points: Array) -> Array:
    """First guess of the diffuse colours (S, 3) float32, linear, of samples at points (S, 3); none is missing."""
    extent = float(np.ptp(points, axis=0).max()) if len(points) else 1.0
    return fill_colors(first_colors(observations, surface.corners, len(points)), points, surface.normals, extent)
