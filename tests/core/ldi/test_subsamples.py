"""Several rays through some pixels: the hits of a picture with so many pixels, and means of their colours."""

from __future__ import annotations

import numpy as np
import pytest
from kernel_runs import on_all_thread_counts
from small_fields import CAMERAS, layers

from ibrpipe.core.ldi import project, subsamples
from ibrpipe.renderers.scene import prepare
from ibrpipe.renderers.search.projection import patch_views, project_behind
from ibrpipe.renderers.search.projection import project as project_picture

VIEWS = ["front", "low", "within"]


def numbered(asked):
    counts = asked.sum(axis=1, dtype=np.int64)
    slots, rows = np.full(asked.shape, 99, np.int32), np.empty((int(counts.sum()), 2))
    tiles = np.zeros([-(-size // subsamples.TILE) for size in asked.shape], np.uint8)
    subsamples.number_pixels(asked, np.cumsum(counts) - counts, slots, tiles, rows)
    return slots, tiles, rows


def test_asked_pixels_are_numbered_row_by_row():
    rng = np.random.default_rng(1)
    asked = (rng.random((19, 21)) < 0.3).astype(np.uint8)
    asked[8:16, :8] = 0
    slots, tiles, rows = numbered(asked)
    wanted = np.argwhere(asked)
    np.testing.assert_array_equal(rows, wanted[:, ::-1])
    np.testing.assert_array_equal(slots[asked > 0], np.arange(len(wanted)))
    assert (slots[asked == 0] == -1).all()
    for row, column in np.ndindex(tiles.shape):
        own = asked[8 * row : 8 * row + 8, 8 * column : 8 * column + 8]
        assert tiles[row, column] == own.any()
    assert not tiles.all()
    assert len(numbered(np.zeros((3, 4), np.uint8))[2]) == 0


def searched(scene, camera, asked, side, parts):
    depth, ids = all_searched(scene, camera, asked, side, parts, 1)
    return depth[0], ids[0]


def all_searched(scene, camera, asked, side, parts, ranks):
    slots, tiles, rows = numbered(asked)
    offsets = (np.arange(side) + 0.5) / side
    keys, blocks = np.empty((parts, ranks, len(rows) * side**2), np.int64), scene.blocks
    subsamples.search_subsamples(
        blocks.patches, blocks.blocks, blocks.bounds, patch_views(scene, camera), (camera.width, camera.height),
        (slots, tiles, offsets), keys,
    )  # fmt: skip
    size = ranks, len(rows), side**2
    depth, ids = np.empty(size, np.float32), np.empty(size, np.uint32)
    subsamples.merge_subsamples(keys, depth, ids)
    return depth, ids


@pytest.mark.parametrize("view", VIEWS)
@pytest.mark.parametrize("side", [1, 2, 4])
def test_rays_hit_what_pixels_of_their_size_hit(view, side):
    scene, camera = prepare((layers((20, 26), seed=5), layers(seed=9))), CAMERAS[view]
    asked = (np.random.default_rng(2).random((camera.height, camera.width)) < 0.4).astype(np.uint8)
    depth, ids = on_all_thread_counts(lambda: searched(scene, camera, asked, side, 2))
    large = camera.resized(camera.width * side, camera.height * side)
    wanted, numbers = project_picture(scene, large)
    shape, pixels = (camera.height, side, camera.width, side), asked > 0
    wanted = np.moveaxis(wanted.reshape(shape), 1, 2)[pixels].reshape(depth.shape)
    numbers = np.moveaxis(numbers.reshape(shape), 1, 2)[pixels].reshape(depth.shape)
    same = ids == numbers
    assert same.mean() > 0.995  # rays along a patch's border may meet its neighbour
    np.testing.assert_allclose(depth[same], wanted[same], rtol=2e-6)
    assert np.isfinite(depth).sum() > 10


@pytest.mark.parametrize("view", VIEWS)
def test_hits_behind_one_another_are_those_of_whole_pictures(view):
    scene, camera = prepare((layers((20, 26), seed=5), layers(seed=9))), CAMERAS[view]
    asked = (np.random.default_rng(2).random((camera.height, camera.width)) < 0.4).astype(np.uint8)
    depths, ids = on_all_thread_counts(lambda: all_searched(scene, camera, asked, 1, 2, 3))
    floors = np.full(camera.width * camera.height, -1, np.int64)
    wanted, numbers = project_behind(scene, camera, floors, 3)
    same = ids[:, :, 0] == numbers[:, asked > 0]
    assert same[np.isfinite(depths[:, :, 0])].mean() > 0.99
    np.testing.assert_allclose(depths[:, :, 0][same], wanted[:, asked > 0][same], rtol=2e-6)
    assert np.isfinite(depths[1]).any()


def test_without_patches_nothing_is_hit():
    scene, camera = prepare((layers(),)), CAMERAS["front"]
    empty = np.empty((0, 2), np.int64)
    keys = np.empty((2, 1, 4), np.int64)
    slots, tiles, _ = numbered(np.eye(13, 17, dtype=np.uint8)[:, :17] * (np.arange(13)[:, None] == 3))
    subsamples.search_subsamples(
        scene.blocks.patches, empty, np.empty((0, 10)), patch_views(scene, camera), (17, 13),
        (slots, tiles, np.array([0.25, 0.75])), keys,
    )  # fmt: skip
    assert (keys == project.NOTHING).all()


def test_means_are_of_what_covers_a_pixel():
    rng = np.random.default_rng(7)
    colors, known = rng.random((3, 4, 3)).astype(np.float32), rng.random((3, 4)).astype(np.float32)
    known[0, 1:], known[2] = 0, 0
    rows = np.array([[1, 0], [0, 2], [2, 1]], float)
    color, cover = np.full((3, 3, 3), -1, np.float32), np.full((3, 3), -1, np.float32)
    subsamples.mean_colors(colors, known, rows, color, cover)
    for n, (x, y) in enumerate(rows.astype(int)):
        total = known[n].sum(dtype=float)
        np.testing.assert_allclose(cover[y, x], total / 4, atol=1e-7)
        wanted = (known[n][:, None] * colors[n]).sum(axis=0) / total if total else np.zeros(3)
        np.testing.assert_allclose(color[y, x], wanted, rtol=1e-5)
    assert (cover == -1).sum() == 6
