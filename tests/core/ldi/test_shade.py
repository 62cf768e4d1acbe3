"""Colours of hits against the bilinear formula, pixel by pixel."""

from __future__ import annotations

import numpy as np
import pytest
from small_fields import CAMERAS, layers, relief

from ibrpipe.core.ldi import shade
from ibrpipe.renderers.ldi.renderer import find_hits
from ibrpipe.renderers.pixel_grid import PixelGrid
from ibrpipe.renderers.scene import prepare

CAMERA = CAMERAS["front"]


def hits_of(source):
    scene = prepare((source,))
    hits = find_hits(scene, CAMERA, "quadtree")
    return scene, hits.depth, hits.ids


def place(start, turn, x, y, t):
    u, v, _, q = start + t * turn @ (x + 0.5, y + 0.5, 1.0)
    return u / q, v / q


def test_heights_take_the_mean_of_four_texels():
    source = relief()
    scene, depth, ids = hits_of(source)
    (_, field, base), color = scene.heights[0], source.color
    start, turn = field.pose.field_from_pixel(CAMERA)
    out, known = np.full((*depth.shape, 3), -1, np.float32), np.zeros(depth.shape, np.float32)
    ids[3, 4] = base + field.cells  # of another field
    shade.shade_heights(depth, ids, PixelGrid.centers(*depth.shape).arrays, base, start, turn, color, out, known)
    mine = np.isfinite(depth)
    mine[3, 4] = False
    np.testing.assert_array_equal(known, mine)
    assert (out[~mine] == -1).all()
    for y, x in np.argwhere(mine):
        j, i = divmod(int(ids[y, x]) - base, color.shape[1] - 1)
        u, v = place(start, turn, x, y, float(depth[y, x]))
        p, q = np.clip((u - i, v - j), 0, 1)
        a, b, c, e = color[j, i], color[j, i + 1], color[j + 1, i], color[j + 1, i + 1]
        want = (a * (1 - p) + b * p) * (1 - q) + (c * (1 - p) + e * p) * q
        np.testing.assert_allclose(out[y, x], want, atol=1e-5)


@pytest.mark.parametrize("unseen", [False, True])
def test_patches_take_the_mean_of_the_corners_that_are_known(unseen):
    scene, depth, ids = hits_of(layers())
    records, color = scene.records
    color = color.copy()
    color[:, 3] = 0.0 if unseen else np.arange(len(color)) % 3 > 0
    start, turn = scene.patches[0][1].pose.field_from_pixel(CAMERA)
    out, known = np.zeros((*depth.shape, 3), np.float32), np.full(depth.shape, -1, np.float32)
    shade.shade_patches(
        depth, ids, PixelGrid.centers(*depth.shape).arrays, records, start[None], turn[None], color, out, known
    )
    assert (known[np.isinf(depth)] == -1).all()
    assert np.isfinite(depth).sum() > 20
    for y, x in np.argwhere(np.isfinite(depth)):
        column, row, _, _, *samples = records[ids[y, x]]
        u, v = place(start, turn, x, y, float(depth[y, x]))
        p, q = np.clip((u - column, v - row), 0, 1)
        weights = np.array([(1 - p) * (1 - q), p * (1 - q), (1 - p) * q, p * q])
        weights *= [sample >= 0 and color[sample, 3] > 0 for sample in samples]
        assert (known[y, x] == 1.0) == (weights.sum() > 0)
        if weights.sum() > 1e-3:
            np.testing.assert_allclose(out[y, x], weights @ color[samples, :3] / weights.sum(), atol=1e-4)


def test_patches_cover_as_their_corners_do():
    scene, depth, ids = hits_of(layers())
    records, color = scene.records
    color = color.copy()
    color[:, 3] = (np.arange(len(color)) % 5) / 4.0
    start, turn = scene.patches[0][1].pose.field_from_pixel(CAMERA)
    out, known = np.zeros((*depth.shape, 3), np.float32), np.zeros(depth.shape, np.float32)
    shade.shade_patches(
        depth, ids, PixelGrid.centers(*depth.shape).arrays, records, start[None], turn[None], color, out, known
    )
    for y, x in np.argwhere(np.isfinite(depth)):
        column, row, _, _, *samples = records[ids[y, x]]
        u, v = place(start, turn, x, y, float(depth[y, x]))
        p, q = np.clip((u - column, v - row), 0, 1)
        weights = np.array([(1 - p) * (1 - q), p * (1 - q), (1 - p) * q, p * q])
        weights *= [sample >= 0 and color[sample, 3] > 0 for sample in samples]
        filled = weights * color[samples, 3]
        if filled.sum() > 1e-3:
            np.testing.assert_allclose(known[y, x], filled.sum() / weights.sum(), atol=1e-4)
            np.testing.assert_allclose(out[y, x], filled @ color[samples, :3] / filled.sum(), atol=1e-4)
    assert ((known > 0.1) & (known < 0.9)).sum() > 10
