"""Gloss of whole pictures, pixel by pixel against the twin: what mirrors, what is met, what is not touched."""

from __future__ import annotations

import numpy as np
import pytest
import reflection_twin as twin
from kernel_runs import on_all_thread_counts

from ibrpipe.core.reflection.directions import pad
from ibrpipe.core.reflection.picture import ROWS, draw_gloss
from ibrpipe.core.reflection.voxels import WIDEST
from ibrpipe.renderers.pixel_grid import PixelGrid
from ibrpipe.types import Camera

SIZE, SAMPLES, PATCHES = 6, 20, 14
CAMERA = Camera.look_at((1.5, 1.0, -6.0), (2, 1.5, 1), fov_y_deg=40, width=13, height=11)
#: nothing is in the way
EMPTY = (
    np.array([0.0, 0.0, 0.0, 1.0]),
    np.full((1, 1, 1), -1, np.int32),
    np.full((8, 1, 1, 1), WIDEST, np.uint8),
    np.empty((0, 6)),
    np.zeros(1, np.int64),
    np.empty((0, 4), np.int32),
    np.empty((0, 4), np.int32),
)
#: the last patch, a wide one, faces the picture from behind the eye: every ray may meet it
WALL = PATCHES - 1
BEHIND = (*EMPTY[:-1], np.array([[WALL, 1, 0, 0]], np.int32))
LIFT, CLEAR, BRIGHTEST = 0.1, 0.2, 0.6


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
        self.records[2, 4:] = -1
        self.poses = np.stack([np.eye(4), np.diag([0.01, 0.01, -1.0, 1.0])])  # the second is wide and looks along -z
        self.poses[0, :3, 3] = 0.25
        self.poses[1, :2, 3] = 0.5
        self.records[WALL, :2], self.records[WALL, 4:] = 0, (3, 5, 6, 7)
        normals = rng.normal(size=(SAMPLES, 3)) * 0.3 - (0, 0, 1)
        self.normals = (normals / np.linalg.norm(normals, axis=1, keepdims=True)).astype(np.float32)
        self.normals[4] = np.nan
        self.depth = rng.uniform(6, 8, shape).astype(np.float32)
        self.depth[rng.random(shape) < 0.1] = np.inf
        self.ids = rng.integers(0, PATCHES, shape).astype(np.uint32)
        self.ids[rng.random(shape) < 0.05] = 2**32 - 1
        self.known = (rng.random(shape) < 0.9).astype(np.float32)
        self.color = rng.random((*shape, 3)).astype(np.float32)
        self.grid = PixelGrid.centers(*shape)
        self.colors = rng.uniform(0.1, 0.9, (SAMPLES, 4)).astype(np.float32)
        self.colors[:, 3] = rng.random(SAMPLES) < 0.9
        self.weights = rng.uniform(0.1, 0.9, (SAMPLES if free else 0, tables)).astype(np.float32)
        self.tables = rng.uniform(0.1, 1.4, (tables, SIZE, SIZE, 3)).astype(np.float32)
        self.law = np.array([0.9 if tables else 0.0, 0.2, *(0.045, 0.9)[:tables]])

    def draw(self, grid):
        """Colours, and by row how many pixels mirror and how many rays are met, by the kernel."""
        color, counts = self.color.copy(), np.full((len(self.depth), 2), 9)
        padded = np.zeros((len(self.tables), (SIZE + 2) ** 2, 4), np.float32)
        padded[..., :3] = pad(self.tables).reshape(len(self.tables), (SIZE + 2) ** 2, 3)
        surface = (self.records, self.normals, self.colors, self.weights, np.array([True, False]))
        depths = np.full((PATCHES, 4), 9.0, np.float32)  # of the wall: z = -9
        shapes = (self.poses, depths, np.full(PATCHES, 15, np.uint8))
        draw_gloss(
            (self.depth, self.ids, self.known), color, (CAMERA.world_from_pixel, CAMERA.center, *self.grid.arrays),
            surface, (padded, self.law), grid, shapes, np.array([LIFT, CLEAR, BRIGHTEST]),
            np.arange(-(-len(color) // ROWS)), counts,
        )  # fmt: skip
        return color, counts

    def share(self, record, at):
        """How much of each table a position shows: (L,)."""
        weights = twin.corner_weights(np.where(self.colors[record[4:], 3] > 0, record[4:], -1), *at)
        return sum(w * self.weights[s].astype(float) for w, s in zip(weights, record[4:]) if w > 0)

    def light(self, patch, point, eye, plain, mirrored):
        """Light (3,) of a point on a patch seen from `eye` over the colour `plain`; and its mirrored direction."""
        record = self.records[patch]
        pose = self.poses[record[2]] @ np.append(point, 1.0)
        at = np.clip(pose[:2] - record[:2], 0, 1)
        weights = twin.corner_weights(record[4:], *at)
        if weights is None or np.isnan(sum(w * self.normals[s] for w, s in zip(weights, record[4:]) if w > 0)).any():
            return None
        normal = sum(w * self.normals[s].astype(float) for w, s in zip(weights, record[4:]) if w > 0)
        normal, toward = normal / np.linalg.norm(normal), (eye - point) / np.linalg.norm(eye - point)
        texel = np.concatenate([np.sqrt(plain), self.share(record, at) if len(self.weights) else []])
        reflected = 2 * max(float(normal @ toward), 0.0) * normal - toward
        light = twin.color(
            [0], (0, 0), normal, toward, mirrored, texel[None], np.sqrt(self.tables.astype(float)), self.law
        )
        return light, normal, reflected

    def met(self, point, normal, reflected):
        """Light of the wall that a reflected ray meets; None where it passes."""
        start = point + LIFT * normal + CLEAR * reflected
        t = (-9 - start[2]) / reflected[2]
        end = start + t * reflected
        if not (reflected[2] < 0 and (np.abs(end[:2]) < 50).all()):
            return None
        record, at = self.records[WALL], 0.01 * end[:2] + 0.5
        weights = twin.corner_weights(np.where(self.colors[record[4:], 3] > 0, record[4:], -1), *at)
        plain = sum(w * self.colors[s, :3].astype(float) for w, s in zip(weights, record[4:]))
        return np.minimum(self.light(WALL, end, point, plain, None)[0], BRIGHTEST)

    def wanted(self, y, x, wall):
        """(Colour, is the wall met) of a pixel that mirrors; None for others."""
        far, patch = float(self.depth[y, x]), int(self.ids[y, x])
        if not (np.isfinite(far) and self.known[y, x] > 0 and patch < PATCHES) or self.records[patch, 2] == 1:
            return None
        point, plain = CAMERA.center + far * CAMERA.pixel_rays()[y, x], self.color[y, x].astype(float)
        free = self.light(patch, point, CAMERA.center, plain, None)
        if free is None:
            return None
        own = self.met(point, *free[1:]) if wall else None
        return (free[0] if own is None else self.light(patch, point, CAMERA.center, plain, own)[0]), own is not None


@pytest.mark.parametrize("wall", [False, True])
@pytest.mark.parametrize(("tables", "free"), [(1, False), (1, True), (2, True)])
def test_pixels_are_drawn_as_the_twin_draws_looks(tables, free, wall):
    hits = Hits(tables, free)
    color, counts = on_all_thread_counts(lambda: hits.draw(BEHIND if wall else EMPTY))
    mirror, met = np.zeros(len(color), int), np.zeros(len(color), int)
    for y, x in np.ndindex(hits.depth.shape):
        wanted = hits.wanted(y, x, wall)
        mirror[y] += wanted is not None
        met[y] += wanted is not None and wanted[1]
        light = hits.color[y, x] if wanted is None else wanted[0]
        np.testing.assert_allclose(color[y, x], light, rtol=1e-5, atol=1e-5)  # directions are float32
    np.testing.assert_array_equal(counts, np.stack([mirror, met], axis=1))
    assert 30 < mirror.sum() < hits.depth.size
    assert not wall or met.sum() > 10


def test_an_empty_picture_is_no_work():
    hits = Hits(1, True)
    for name in ("depth", "ids", "known", "color"):
        setattr(hits, name, getattr(hits, name)[:0])
    assert hits.draw(EMPTY)[0].shape == (0, CAMERA.width, 3)
