"""Fit diffuse texels and shared tables of reflected light to all observations at once."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from scipy.sparse import csr_array, diags_array

from ibrpipe.core.reflection.directions import fold, pad
from ibrpipe.core.reflection.model import CHANNELS, DARK, add_gradients
from ibrpipe.core.reflection.steps import adam_step, sum_tables, sum_texels
from ibrpipe.modelling.view_dependence.reflection.observations import Observations
from ibrpipe.progress import track
from ibrpipe.renderers.view_dependence.reflection import Model
from ibrpipe.types import Array

#: reflectance at normal incidence of the tables: coat, metal
REFLECTANCE = (0.045, 0.9)
#: observations are cut into so many chunks, whatever the threads
CHUNKS = 32


@dataclass(frozen=True)
class FitRules:
    """How the fit goes.

    Attributes
    ----------
    size : cells along an edge of a table
    epochs, polish : rounds through all observations; rounds at 0.4 of the rates once self-reflection is renewed
    batches : steps a round
    rates : largest step of square roots of D, of k, of square roots of E
    smoothness : of neighbouring cells of a table, against a mean cell's observations
    evenness : of neighbouring samples' weights, against a mean sample's observations
    bend : error in square roots of light from which on it counts linearly
    damping : how much of D goes at grazing angles
    """

    size: int = 144
    epochs: int = 12
    polish: int = 3
    batches: int = 4
    rates: tuple[float, float, float] = (0.02, 0.04, 0.05)
    smoothness: float = 0.003
    evenness: float = 0.01
    bend: float = 0.2
    damping: float = 0.9


def make_law(tables: int, rules: FitRules) -> Array:
    """Damping, bend and reflectances; without tables nothing is damped."""
    return np.array([rules.damping if tables else 0.0, rules.bend, *REFLECTANCE[:tables]])


def fit(observations: Observations, corners: Array, first: Array, tables: int, rules: FitRules) -> Model:
    """Fit a model with so many tables.

    Parameters
    ----------
    observations : Observations
    corners : (P, 4) int32, samples of every patch
    first : (S, 3) float32
        First guess of the diffuse colours, linear.
    tables : int
        0, 1 or 2.

    Notes
    -----
    The same bytes whatever the number of threads: gradients are summed by chunk, in the order of the chunks.
    """
    observations, ends = _in_batches(observations, rules.batches)
    roots = np.sqrt(np.maximum(np.nan_to_num(first), DARK)).astype(np.float32)
    model = Model(roots, np.empty((0, rules.size, rules.size, 3), np.float32), make_law(0, rules))
    reflect_itself(model, observations, corners)
    model = _begin(model, observations, corners, tables, rules)
    pace = _Pace(model, observations, corners, ends, rules)
    pace.run(rules.epochs, 1.0)
    if tables and len(observations.met):
        _polish(model, observations, corners, ends, rules)
    return model


def polish(model: Model, observations: Observations, corners: Array, rules: FitRules) -> None:
    """Go on with the fit of a model, in place, where the observations have changed a little."""
    observations, ends = _in_batches(observations, rules.batches)
    _polish(model, observations, corners, ends, rules)


def _polish(model: Model, observations: Observations, corners: Array, ends: Array, rules: FitRules) -> None:
    reflect_itself(model, observations, corners)
    _Pace(model, observations, corners, ends, rules).run(rules.polish, 0.4)


def _in_batches(observations: Observations, batches: int) -> tuple[Observations, Array]:
    """The observations batch by batch and by patch within each, and the ends (B + 1,) of the batches."""
    by_patch = np.argsort(observations.where[:, 0], kind="stable")
    parts = [by_patch[n::batches] for n in range(batches)]
    return observations.subset(np.concatenate(parts)), np.cumsum([0] + [len(part) for part in parts])


def reflect_itself(model: Model, observations: Observations, corners: Array) -> None:
    """Renew the mirrored colours of observations whose reflected ray meets the object."""
    light = model.own_light(observations.met_where, observations.met_traits, corners)
    observations.traits[observations.met, 9:] = light


def _begin(model: Model, observations: Observations, corners: Array, tables: int, rules: FitRules) -> Model:
    """First guess of the tables from what the diffuse colours leave over, and of the weights."""
    law = make_law(tables, rules)
    if tables == 0:
        return replace(model, law=law)
    coat = _left_over(replace(model, law=make_law(0, rules)), observations, corners, law)
    if tables == 1:
        return Model(model.texels, np.sqrt(coat)[None], law)
    from scipy.ndimage import gaussian_filter

    tint = (model.texels.astype(np.float64) ** 2).mean(axis=0)
    metal = gaussian_filter(coat, (3, 3, 0)) * (tint / max(float(tint.mean()), DARK))
    weights = np.broadcast_to(np.array((0.9, 0.1), np.float32), (len(model.texels), 2))
    texels = np.concatenate([model.texels, weights], axis=1)
    return Model(texels, np.sqrt(np.stack([coat, metal])).astype(np.float32), law)


def _left_over(model: Model, observations: Observations, corners: Array, law: Array) -> Array:
    """(n, n, 3) float32 reflected light that best explains what the diffuse colours leave of the photos."""
    size = model.tables.shape[1]
    where, traits = observations.where, observations.traits
    s = traits[:, 2].astype(np.float64)
    strength = law[2] + (1 - law[2]) * s
    left = traits[:, 6:9].astype(np.float64) ** 2
    left -= (1 - law[0] * s)[:, None] * np.nan_to_num(model.colors(where, traits, corners))
    weight = np.where(np.isnan(traits[:, 9]), traits[:, 5], 0.0)
    fx, fy = traits[:, 3].astype(np.float64), traits[:, 4].astype(np.float64)
    top, bottom = np.zeros(((size + 2) ** 2, 3)), np.zeros((size + 2) ** 2)
    for c in range(4):
        cell = where[:, 1] + (c & 1) + (c >> 1) * (size + 2)
        part = weight * strength * (fx if c & 1 else 1 - fx) * (fy if c & 2 else 1 - fy)
        bottom += np.bincount(cell, part * strength, len(bottom))
        for channel in range(3):
            top[:, channel] += np.bincount(cell, part * left[:, channel], len(bottom))
    shape = (1, size + 2, size + 2, -1)
    above, below = fold(top.reshape(shape))[0], fold(bottom.reshape(shape))[0]
    little = 0.02 * below.mean() + 1e-12
    mean = above.sum(axis=(0, 1)) / max(float(below.sum()), 1e-12)
    return np.clip((above + little * mean) / (below + little), DARK, 100.0).astype(np.float32)


class _Pace:
    """Steps of Adam over one model, in place."""

    def __init__(self, model: Model, observations: Observations, corners: Array, ends: Array, rules: FitRules) -> None:
        self.model, self.observations, self.corners, self.rules = model, observations, corners, rules
        self.chunks = [_chunks(observations.where, corners, *pair) for pair in pairwise(ends)]
        texels, tables = model.texels, model.tables
        self.moments = [np.zeros_like(array) for array in (texels, texels, tables, tables)]
        rows = max(int(counts.sum()) for _, counts in self.chunks)
        self.parts = np.empty((rows, texels.shape[1]), np.float32)
        self.table_parts = np.empty((CHUNKS, *model.padded.shape), np.float32)
        self.unevenness = unevenness(corners, len(texels)) if texels.shape[1] > CHANNELS else None
        self.losses: list[float] = []

    def run(self, epochs: int, pace: float) -> None:
        """Go through all observations so many times, ever more slowly."""
        steps = epochs * self.rules.batches
        for step in track(range(steps), "fit"):
            rate = pace * 0.5 * (1.0 + np.cos(np.pi * step / steps))
            self._step(step % self.rules.batches, rate, step + 1)

    def _step(self, batch: int, rate: float, count: int) -> None:
        model, seen, (chunks, counts) = self.model, self.observations, self.chunks[batch]
        losses = np.zeros((len(chunks), 2))
        self.parts[:], self.table_parts[:] = 0, 0
        add_gradients(
            seen.where, seen.traits, chunks, self.corners, model.texels, model.padded, model.law, self.parts,
            self.table_parts, losses,
        )  # fmt: skip
        loss, mass = losses.sum(axis=0)
        self.losses.append(float(loss / max(mass, 1e-12)))
        gradient = np.empty_like(model.texels)
        sum_texels(chunks, counts, self.parts, gradient)
        of_root, of_share, of_table = (rate * each for each in self.rules.rates)
        shares = model.texels.shape[1] - CHANNELS
        rates, lows = np.array([of_root] * 3 + [of_share] * shares), np.array([1e-3] * 3 + [0.0] * shares)
        if shares and self.rules.evenness:
            uneven = self.unevenness @ model.texels[:, CHANNELS:]
            gradient[:, CHANNELS:] += np.float32(2 * self.rules.evenness * mass / len(gradient)) * uneven
        adam_step(model.texels, gradient, *self.moments[:2], rates, lows, count)
        if len(model.tables):
            self._step_tables(of_table, float(mass), count)

    def _step_tables(self, rate: float, mass: float, count: int) -> None:
        tables, size = self.model.tables, self.rules.size
        summed = np.empty(self.table_parts.shape[1:], np.float32)
        sum_tables(self.table_parts, summed)
        gradient = fold(summed.reshape(len(tables), size + 2, size + 2, CHANNELS))
        around = pad(tables)
        bend = 4 * tables - around[:, :-2, 1:-1] - around[:, 2:, 1:-1] - around[:, 1:-1, :-2] - around[:, 1:-1, 2:]
        gradient += np.float32(2 * self.rules.smoothness * mass / size**2) * bend
        flat = [array.reshape(-1, CHANNELS) for array in (tables, gradient, *self.moments[2:])]
        adam_step(*flat, np.full(3, rate), np.full(3, 1e-3), count)


def neighbours(corners: Array, samples: int) -> csr_array:
    """(S, S) float32, 1 where two samples are neighbours in the patches (P, 4)."""
    pairs = np.concatenate([corners[:, [one, other]] for one, other in ((0, 1), (2, 3), (0, 2), (1, 3))])
    pairs = np.unique(np.sort(pairs[(pairs >= 0).all(axis=1)], axis=1), axis=0)
    ends = np.concatenate([pairs, pairs[:, ::-1]])
    return csr_array((np.ones(len(ends), np.float32), (ends[:, 0], ends[:, 1])), shape=(samples, samples))


def unevenness(corners: Array, samples: int) -> csr_array:
    """(S, S) sum, over a sample's neighbours in the patches (P, 4), of how far it is above them."""
    near = neighbours(corners, samples)
    return csr_array(diags_array(near.sum(axis=1)) - near).astype(np.float32)


def _chunks(where: Array, corners: Array, begin: int, end: int) -> tuple[Array, Array]:
    """Return chunks (C, 4) int64 of the observations from `begin` to `end`, and how many samples (C,) each touches."""
    low = np.where(corners >= 0, corners, np.iinfo(np.int32).max).min(axis=1)
    high = corners.max(axis=1)
    bounds = np.linspace(begin, end, CHUNKS + 1).astype(np.int64)
    out, counts = np.zeros((CHUNKS, 4), np.int64), np.zeros(CHUNKS, np.int64)
    for n, (first, last) in enumerate(pairwise(bounds)):
        patches = where[first:last, 0]
        least, most = (int(low[patches].min()), int(high[patches].max())) if last > first else (0, -1)
        counts[n] = max(most - least + 1, 0)
        out[n] = first, last, least if counts[n] else 0, counts[:n].sum()
    return out, counts
