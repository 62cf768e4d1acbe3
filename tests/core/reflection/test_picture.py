"""Gloss of whole pictures, pixel by pixel against the twin: what is shaded, what is left, what is not touched."""

from __future__ import annotations

import numpy as np
import pytest
import reflection_twin as twin
from kernel_runs import on_all_thread_counts

from ibrpipe.core.reflection.directions import pad
from ibrpipe.core.reflection.occupancy import WIDEST
from ibrpipe.core.reflection.picture import LEFT, SHADED, UNTOUCHED, shade_free
from ibrpipe.types import Camera

SIZE, SAMPLES, PATCHES = 6, 20, 14
CAMERA = Camera.look_at((1.5, 1.0, -6.0), (2, 1.5, 1), fov_y_deg=40, width=13, height=11)
#: nothing is in the way
EMPTY = (
    np.array([0.0, 0.0, 0.0, 1.0]),
    np.full((1, 1, 1), -1, np.int32),
    np.full((8, 1, 1, 1), WIDEST, np.uint8),
    np.empty(0, np.int64),
    np.empty((0, 4)),
)
#: a voxel before the picture's upper half hinders every ray
HINDERED = (
    np.array([-20.0, -41.0, -40.0, 40.0]),
    np.zeros((1, 1, 1), np.int32),
    np.zeros((8, 1, 1, 1), np.uint8),
    np.ones(1, np.int64),
    np.array([[0.0, 0.0, 1.0, 2.0]]),
)


class Hits:
    """Random hits of two fields, of which the second reflects nothing; some without depth, samples or normals."""

    def __init__(self, tables, free):
        rng = np.random.default_rng(5)
        shape = (CAMERA.height, CAMERA.width)
        self.records = np.zeros((PATCHES, 8), np.int32)
        self.records[:, 0], self.records[:, 1] = rng.integers(0, 4, PATCHES), rng.integers(0, 3, PATCHES)
        self.records[-2:, 2] = 1
        self.records[:, 4:] = rng.integers(0, SAMPLES, (PATCHES, 4))
        self.records[:, 4:][rng.random((PATCHES, 4)) < 0.2] = -1
        self.corners = np.where(rng.random((PATCHES, 4)) < 0.15, -1, self.records[:, 4:]).astype(np.int32)
        self.records[2, 4:], self.corners[3] = -1, -1
        self.poses = np.stack([np.eye(4), np.eye(4)])
        self.poses[:, :3, 3] = 0.25
        normals = rng.normal(size=(SAMPLES, 3)) * 0.3 - (0, 0, 1)
        self.normals = (normals / np.linalg.norm(normals, axis=1, keepdims=True)).astype(np.float32)
        self.normals[4] = np.nan
        self.depth = rng.uniform(6, 8, shape).astype(np.float32)
        self.depth[rng.random(shape) < 0.1] = np.inf
        self.ids = rng.integers(0, PATCHES, shape).astype(np.uint32)
        self.ids[rng.random(shape) < 0.05] = 2**32 - 1
        self.known = (rng.random(shape) < 0.9).astype(np.float32)
        self.color = rng.random((*shape, 3)).astype(np.float32)
        self.texels = rng.uniform(0.1, 0.9, (SAMPLES, 3 + (tables if free else 0))).astype(np.float32)
        self.tables = rng.uniform(0.1, 1.4, (tables, SIZE, SIZE, 3)).astype(np.float32)
        self.law = np.array([0.9 if tables else 0.0, 0.2, *(0.045, 0.9)[:tables]])

    def shade(self, grid, always=0):
        """Colours and states by the kernel."""
        color, state = self.color.copy(), np.full(self.depth.shape, 9, np.uint8)
        surface = (self.records, self.corners, self.poses, self.normals, np.array([True, False]))
        padded = pad(self.tables).reshape(len(self.tables), (SIZE + 2) ** 2, 3)
        shade_free(
            self.depth, self.ids, self.known, color, np.concatenate([CAMERA.world_from_pixel, CAMERA.center[None]]),
            surface, (self.texels, padded, self.law), grid, always, np.array([0.1, 0.2]), state,
        )  # fmt: skip
        return color, state

    def wanted(self, y, x):
        """(state, colour or None) of a pixel whose reflected ray is free."""
        far, patch = float(self.depth[y, x]), int(self.ids[y, x])
        if not (np.isfinite(far) and self.known[y, x] > 0 and patch < PATCHES) or self.records[patch, 2] == 1:
            return UNTOUCHED, None
        record, point = self.records[patch], CAMERA.center + far * CAMERA.pixel_rays()[y, x]
        place = np.clip(point[:2] + 0.25 - record[:2], 0, 1)
        weights = twin.corner_weights(record[4:], *place)
        if weights is None or np.isnan(sum(w * self.normals[s] for w, s in zip(weights, record[4:]) if w > 0)).any():
            return LEFT, None
        normal = sum(w * self.normals[s].astype(float) for w, s in zip(weights, record[4:]) if w > 0)
        toward = CAMERA.center - point
        color = twin.color(
            self.corners[patch], place, normal / np.linalg.norm(normal), toward / np.linalg.norm(toward), None,
            self.texels.astype(float), self.tables.astype(float), self.law,
        )  # fmt: skip
        return (LEFT, None) if color is None else (SHADED, color)


@pytest.mark.parametrize(("tables", "free"), [(0, False), (1, False), (1, True), (2, True)])
def test_pixels_are_shaded_as_the_twin_shades_looks(tables, free):
    hits = Hits(tables, free)
    color, state = on_all_thread_counts(lambda: hits.shade(EMPTY))
    for y, x in np.ndindex(state.shape):
        wanted, light = hits.wanted(y, x)
        assert state[y, x] == wanted, (y, x)
        np.testing.assert_allclose(color[y, x], hits.color[y, x] if light is None else light, rtol=2e-6, atol=1e-7)
    assert set(np.unique(state)) == {UNTOUCHED, SHADED, LEFT}


def test_rays_that_may_meet_something_are_left_to_the_caller():
    hits = Hits(1, True)
    color, free = hits.shade(EMPTY)
    for grid, always in ((HINDERED, 0), (EMPTY, 4)):
        partly, state = hits.shade(grid, always)
        left = state == LEFT
        assert (left | (state == free)).all()
        assert (left & (free == SHADED)).sum() > 10
        np.testing.assert_array_equal(partly[left], hits.color[left])
        np.testing.assert_array_equal(partly[~left], color[~left])


def test_an_empty_picture_is_no_work():
    hits = Hits(1, True)
    for name in ("depth", "ids", "known", "color"):
        setattr(hits, name, getattr(hits, name)[:0])
    assert hits.shade(EMPTY)[1].shape == (0, CAMERA.width)
