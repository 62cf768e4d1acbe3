"""Colours and gradients of shared reflection against the twin: seams, grazing looks, clipped and unseen places."""

from __future__ import annotations

import numpy as np
import pytest
import reflection_twin as twin
from kernel_runs import on_all_thread_counts

from ibrpipe.core.reflection.directions import cell_directions, fold, pad
from ibrpipe.core.reflection.geometry import reflect
from ibrpipe.core.reflection.model import TRAITS, add_gradients, predict
from ibrpipe.core.reflection.steps import sum_tables, sum_texels

SIZE, SAMPLES, LOOKS = 6, 9, 120
REFLECTANCE = (0.045, 0.9)


class Looks:
    """Random looks at nine samples under tables of 6 x 6 cells."""

    def __init__(self, tables, free, seed=0):
        rng = np.random.default_rng(seed)
        self.corners = rng.integers(0, SAMPLES, (12, 4)).astype(np.int32)
        self.corners[rng.random((12, 4)) < 0.2] = -1
        self.corners[3] = -1
        self.texels = rng.uniform(0.1, 0.9, (SAMPLES, 3 + (tables if free else 0))).astype(np.float32)
        self.tables = rng.uniform(0.1, 1.4, (tables, SIZE, SIZE, 3)).astype(np.float32)
        self.law = np.array([0.9 if tables else 0.0, 0.2, *REFLECTANCE[:tables]])
        self.normals, self.toward = unit(rng.normal(size=(LOOKS, 3))), unit(rng.normal(size=(LOOKS, 3)))
        self.toward[:20] = unit(np.cross(self.normals[:20], self.toward[:20]) + 1e-3 * self.normals[:20])  # grazing
        self.where = np.stack([rng.integers(0, 12, LOOKS), np.zeros(LOOKS)], axis=1).astype(np.int32)
        self.traits = rng.random((LOOKS, TRAITS)).astype(np.float32)
        self.traits[rng.random(LOOKS) < 0.7, 9:] = np.nan
        self.traits[:, 6:9] *= np.where(rng.random((LOOKS, 3)) < 0.1, -1, 1)
        self.reflected = np.empty((LOOKS, 3))
        reflect(self.normals, self.toward, SIZE, self.where, self.traits, self.reflected)

    @property
    def padded(self):
        return pad(self.tables).reshape(len(self.tables), (SIZE + 2) ** 2, 3)

    def twin_color(self, i, texels, tables):
        trait = self.traits[i].astype(float)
        mirrored = None if np.isnan(trait[9]) else trait[9:]
        samples = self.corners[self.where[i, 0]]
        return twin.color(samples, trait[:2], self.normals[i], self.toward[i], mirrored, texels, tables, self.law)

    def twin_loss(self, texels, tables):
        total = 0.0
        for i in range(LOOKS):
            light = self.twin_color(i, texels, tables)
            if light is not None:
                trait = self.traits[i].astype(float)
                total += twin.loss(light, trait[6:9], trait[5], self.law[1])
        return total

    def gradients(self, parts=5):
        ends = np.linspace(0, LOOKS, parts + 1).astype(np.int64)
        chunks = np.stack([ends[:-1], ends[1:], np.zeros(parts), SAMPLES * np.arange(parts)], axis=1).astype(np.int64)
        pieces = np.zeros((parts * SAMPLES, self.texels.shape[1]), np.float32)
        tables, losses = np.zeros((parts, *self.padded.shape), np.float32), np.zeros((parts, 2))
        add_gradients(
            self.where, self.traits, chunks, self.corners, self.texels, self.padded, self.law, pieces, tables, losses
        )
        of_texels, of_tables = np.empty_like(self.texels), np.empty(self.padded.shape, np.float32)
        sum_texels(chunks, np.full(parts, SAMPLES), pieces, of_texels)
        sum_tables(tables, of_tables)
        of_tables = fold(of_tables.reshape(len(self.tables), SIZE + 2, SIZE + 2, 3))
        return of_texels, of_tables, losses.sum(axis=0)


def unit(vectors):
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


KINDS = [(0, False), (1, False), (1, True), (2, True)]


@pytest.mark.parametrize(("tables", "free"), KINDS)
def test_colours_as_twin_whatever_the_threads(tables, free):
    looks = Looks(tables, free)

    def compute():
        out = np.empty((LOOKS, 3), np.float32)
        predict(looks.where, looks.traits, looks.corners, looks.texels, looks.padded, looks.law, out)
        return (out,)

    (got,) = on_all_thread_counts(compute)
    unknown = 0
    for i in range(LOOKS):
        wanted = looks.twin_color(i, looks.texels.astype(float), looks.tables.astype(float))
        unknown += wanted is None
        np.testing.assert_allclose(got[i], np.full(3, np.nan) if wanted is None else wanted, rtol=2e-5, atol=1e-6)
    assert 0 < unknown < LOOKS / 2


@pytest.mark.parametrize(("tables", "free"), KINDS)
def test_gradients_as_finite_differences_of_twin_whatever_the_threads(tables, free):
    looks = Looks(tables, free, seed=1)
    of_texels, of_tables, (loss, weight) = on_all_thread_counts(looks.gradients)
    texels, light = looks.texels.astype(float), looks.tables.astype(float)
    assert loss == pytest.approx(looks.twin_loss(texels, light), rel=1e-5)
    known = [i for i in range(LOOKS) if looks.corners[looks.where[i, 0]].max() >= 0]
    assert weight == pytest.approx(looks.traits[known, 5].sum(dtype=float))
    rng = np.random.default_rng(2)
    for values, gradient, count in ((texels, of_texels, 30), (light, of_tables, 60)):
        for _ in range(count if values.size else 0):
            at = tuple(rng.integers(0, n) for n in values.shape)
            before = values[at]
            ends = []
            for step in (1e-5, -1e-5):
                values[at] = before + step
                ends.append(looks.twin_loss(texels, light))
            values[at] = before
            assert gradient[at] == pytest.approx((ends[0] - ends[1]) / 2e-5, rel=2e-3, abs=2e-4)


def test_a_clipped_channel_pulls_up_only():
    looks = Looks(1, False, seed=3)
    looks.traits[:, 6:9] = -0.01  # the photo says: at least next to nothing
    of_texels, of_tables, (loss, _) = looks.gradients()
    assert loss == 0
    assert not of_texels.any()
    assert not of_tables.any()
    looks.traits[:, 6:9] = -3.0
    of_texels, of_tables, (loss, _) = looks.gradients()
    assert loss > 0
    assert (of_texels <= 0).all()
    assert (of_tables <= 0).all()
    assert of_texels.any()


def test_no_observations():
    looks = Looks(1, False)
    looks.where, looks.traits = looks.where[:0], looks.traits[:0]
    chunks = np.zeros((2, 4), np.int64)
    parts, tables, losses = np.zeros((0, 3), np.float32), np.zeros((2, 1, 64, 3), np.float32), np.zeros((2, 2))
    add_gradients(
        looks.where, looks.traits, chunks, looks.corners, looks.texels, looks.padded, looks.law, parts, tables, losses
    )
    assert not losses.any()
    out = np.ones((SAMPLES, 3), np.float32)
    sum_texels(chunks, np.zeros(2, np.int64), parts, out)
    assert not out.any()


def test_tables_go_on_across_their_seams_as_twin():
    # light that is a smooth function of direction is found anywhere, also where the square is folded
    size = 48
    smooth = lambda d: 1.0 + 0.5 * d @ np.array([[0.3, -0.5, 0.2], [0.1, 0.4, -0.6], [0.5, 0.2, 0.3]])  # noqa: E731
    table = np.sqrt(smooth(cell_directions(size)))
    rng = np.random.default_rng(4)
    ways = unit(np.concatenate([rng.normal(size=(200, 3)), rng.normal(size=(200, 3)) * (1, 1, 0.01), [[0, 0, -1.0]]]))
    ways = np.concatenate([ways, unit(np.array([[1e-9, 0.5, -0.5], [-1e-9, 0.5, -0.5], [0.3, 0, -0.8], [0, 0, 1]]))])
    where, traits, out = np.zeros((len(ways), 2), np.int32), np.zeros((len(ways), TRAITS), np.float32), ways.copy()
    reflect(ways, ways, size, where, traits, out)  # seen straight on, the mirror looks along the normal
    traits[:, 9:] = np.nan
    padded = pad(table[None].astype(np.float32)).reshape(1, -1, 3)
    got = np.empty((len(ways), 3), np.float32)
    corners, black = np.zeros((1, 4), np.int32), np.zeros((1, 3), np.float32)
    predict(where, traits, corners, black, padded, np.array([0.9, 0.2, 1.0]), got)
    np.testing.assert_allclose(got, smooth(ways), atol=1e-2)  # a cell is 4 degrees wide
    for way, light in zip(ways, got, strict=True):
        np.testing.assert_allclose(light, twin.table_light(table, way), atol=2e-5)


@pytest.mark.parametrize("size", [1, 2, 5])
def test_folding_is_the_transpose_of_padding(size):
    rng = np.random.default_rng(5)
    table, other = rng.random((2, size, size, 3)), rng.random((2, size + 2, size + 2, 3))
    assert (pad(table) * other).sum() == pytest.approx((table * fold(other)).sum())


def test_cell_directions_as_twin():
    ways = cell_directions(7)
    for v in range(7):
        for u in range(7):
            np.testing.assert_allclose(ways[v, u], twin.direction_of(u + 0.5, v + 0.5, 7), atol=1e-12)
            np.testing.assert_allclose(twin.place_of(ways[v, u], 7), (u + 0.5, v + 0.5), atol=1e-12)
