"""Projection of layered images' patches, kernel by kernel, against plain NumPy and against trying every patch."""

from __future__ import annotations

import ldi_twin
import numpy as np
import pytest
from small_fields import CAMERAS, layers, lies_between

from ibrpipe.core.ldi import project
from ibrpipe.renderers.fields import build_field
from ibrpipe.renderers.ldi.renderer import pack_rays
from ibrpipe.renderers.search.epipolar_lines import EYE
from ibrpipe.renderers.search.patches import pack_blocks

VIEWS = ["front", "low", "within"]


def packed(source, camera):
    field = build_field(source)
    start, turn = field.pose.field_from_pixel(camera)
    pixels = field.pose.pixel_from_field(camera)
    sign = np.sign(np.linalg.det(pixels[:, :3])) * np.sign(start[3])
    views = (
        pixels[None], pack_rays(start, turn)[None], np.array([EYE * field.reach]), np.array([sign]),
        np.array([field.pose.perspective]),
    )  # fmt: skip
    return field, pack_blocks([field]), views


def pictures(camera, parts, ranks=1):
    return np.empty((parts, ranks, camera.width * camera.height), np.int64)


def floors(camera):
    return np.full(camera.width * camera.height, -1, np.int64)


def all_merged(keys, camera):
    size = keys.shape[1], camera.height, camera.width
    depth, ids = np.empty(size, np.float32), np.empty(size, np.uint32)
    project.merge_pictures(keys, camera.width, depth, ids)
    return depth, ids


def merged(keys, camera):
    depth, ids = all_merged(keys, camera)
    return depth[0], ids[0]


@pytest.mark.parametrize("view", VIEWS)
@pytest.mark.parametrize("parts", [1, 2])
def test_projected_patches_equal_brute_force(view, parts):
    source, camera = layers(), CAMERAS[view]
    field, blocks, views = packed(source, camera)
    keys, size = pictures(camera, parts), (camera.width, camera.height)
    project.project_patches(blocks.patches, blocks.blocks, blocks.bounds, views, size, keys, floors(camera))
    depth, ids = merged(keys, camera)
    lies_between(depth, *(ldi_twin.cast(source, camera, slack) for slack in (1e-6, -1e-6)))
    assert (ids[np.isfinite(depth)] < len(field.corners)).all()


@pytest.mark.parametrize("view", VIEWS)
@pytest.mark.parametrize("parts", [1, 2])
def test_hits_behind_one_another_are_those_found_one_by_one(view, parts):
    """Twin: the search of the nearest hit alone, again and again from the last one on."""
    source, camera = layers(), CAMERAS[view]
    _, blocks, views = packed(source, camera)
    size = camera.width, camera.height
    keys, least = pictures(camera, parts, 3), floors(camera)
    project.project_patches(blocks.patches, blocks.blocks, blocks.bounds, views, size, keys, least)
    depths, ids = all_merged(keys, camera)
    for rank in range(3):
        keys = pictures(camera, 1)
        project.project_patches(blocks.patches, blocks.blocks, blocks.bounds, views, size, keys, least)
        depth, number = merged(keys, camera)
        np.testing.assert_array_equal(depths[rank], depth)
        hit = np.isfinite(depth)
        np.testing.assert_array_equal(ids[rank][hit], number[hit])
        least = ((depth.view(np.int32).astype(np.int64) << 32) | np.where(hit, number, 0)).ravel()
    assert np.isfinite(depths[1]).any()


def test_without_blocks_nothing_is_hit():
    _, blocks, views = packed(layers(), CAMERAS["front"])
    keys = pictures(CAMERAS["front"], 2)
    project.project_patches(
        blocks.patches, blocks.blocks[:0], blocks.bounds[:0], views, (17, 13), keys, floors(CAMERAS["front"])
    )
    assert (keys == project.NOTHING).all()
    depth, _ = merged(keys, CAMERAS["front"])
    assert np.isinf(depth).all()


def homogeneous(blocks, views, k):
    """(4, 3) homogeneous pixels of the corners of patch k of block 0."""
    u, v = blocks.patches[1][0, :, k].astype(float)
    d = blocks.corners[0, :, k].astype(float)
    places = np.array([[u, v, d[0], 1], [u + 1, v, d[1], 1], [u, v + 1, d[2], 1], [u + 1, v + 1, d[3], 1]])
    return places @ views[0][0].T


def is_beyond(corners, camera):
    """All corners beyond one side of the picture, or behind the eye."""
    x, y, w = corners.T
    sides = (x < -0.02 * w, x > (camera.width + 0.02) * w, y < -0.02 * w, y > (camera.height + 0.02) * w, w <= 0)
    return any(side.all() for side in sides)


@pytest.mark.parametrize("view", VIEWS)
def test_boxes_hold_the_pixels_of_their_patches(view):
    camera = CAMERAS[view]
    field, blocks, views = packed(layers(), camera)
    boxes, count = np.empty((6, project.BLOCK)), len(field.corners)
    size = (camera.width, camera.height)
    project.bound_boxes(0, count, 0, blocks.corners, blocks.patches[1], views[0], False, views[3][0], size, 0.0, boxes)
    seen = 0
    for k in range(count):
        corners = homogeneous(blocks, views, k)
        x, y, w = corners.T
        if (w > 1e-6).all():
            left, right = np.ceil((x / w).min() - 0.52), np.floor((x / w).max() - 0.48)
            top, bottom = np.ceil((y / w).min() - 0.52), np.floor((y / w).max() - 0.48)
            if boxes[0, k] <= boxes[1, k]:
                seen += 1
                assert boxes[5, k] == 0.0
                assert boxes[4, k] == pytest.approx(w.mean())
                assert tuple(boxes[:4, k]) == (
                    max(left, 0), min(right, camera.width - 1), max(top, 0), min(bottom, camera.height - 1)
                )  # fmt: skip
        elif boxes[0, k] <= boxes[1, k]:
            assert tuple(boxes[:4, k]) == (0, camera.width - 1, 0, camera.height - 1)
            assert boxes[5, k] == 1.0
    assert view == "within" or seen > 5


@pytest.mark.parametrize("view", VIEWS)
def test_patches_beyond_the_picture_are_known(view):
    camera = CAMERAS[view]
    field, blocks, views = packed(layers(), camera)
    for k in range(len(field.corners)):
        found = project.beyond_picture(
            0, k, 0, blocks.patches[1], blocks.corners, views[0], camera.width, camera.height
        )  # fmt: skip
        assert found == is_beyond(homogeneous(blocks, views, k), camera)


def test_blocks_are_left_out_only_where_nothing_is_seen():
    source = layers((40, 30), seed=8)
    for camera in CAMERAS.values():
        field, blocks, views = packed(source, camera)
        hit, size = np.isfinite(ldi_twin.cast(layers(), camera, 0.0)), (camera.width, camera.height)
        assert hit.any()
        for block in range(len(blocks.blocks)):
            skipped = project.skip_block(block, 0, blocks.bounds, views[0], views[1], *size)
            keys = pictures(camera, 1)
            keys[:] = project.NOTHING
            alone = slice(block, block + 1)
            never = np.array([[-1e9, 1e9] * 5])
            patches = tuple(each[alone] for each in blocks.patches)
            project.project_patches(patches, blocks.blocks[alone], never, views, size, keys, floors(camera))
            assert not (skipped and (keys != project.NOTHING).any())
        assert len(blocks.blocks) > 2
        assert field.cells.max() > 30


def test_listed_pieces_are_met_once_their_list_is_full_or_when_asked():
    camera = CAMERAS["front"]
    field, blocks, views = packed(layers(), camera)
    boxes, count, size = np.empty((6, project.BLOCK)), len(field.corners), (camera.width, camera.height)
    project.bound_boxes(0, count, 0, blocks.corners, blocks.patches[1], views[0], False, views[3][0], size, 0.0, boxes)
    counts, listed = np.zeros(4, np.int64), np.empty((4, 9, project.LIST), np.float32)
    tags, keys = np.empty((4, 5, project.LIST), np.int64), np.full((1, 1, 17 * 13), project.NOTHING, np.int64)
    least = floors(camera)
    project.list_pieces(0, count, 0, blocks.patches, views, size, boxes, (counts, listed, tags), keys, least, 0)
    wide, high = (np.maximum(boxes[k + 1, :count] - boxes[k, :count] + 1, 0) for k in (0, 2))
    assert counts.sum() == (np.ceil(wide / 2) * np.ceil(high / 2)).sum()
    assert (counts < project.LIST).all()
    assert (keys == project.NOTHING).all()
    for kind in range(4):
        project.meet_pieces(kind, counts[kind], 0, views[1], views[2][0], camera.width, listed, tags, keys, least, 0)
    depth, _ = merged(keys, camera)
    lies_between(depth, *(ldi_twin.cast(layers(), camera, slack) for slack in (1e-6, -1e-6)))


def test_the_least_word_of_all_pictures_is_kept():
    def word(depth, number):
        return int(np.float32(depth).view(np.int32)) << 32 | number

    keys = np.array([[word(2, 7), project.NOTHING, word(1, 1)], [word(2, 3), word(5, 2), word(3, 0)]], np.int64)
    depth, ids = np.empty((1, 1, 3), np.float32), np.empty((1, 1, 3), np.uint32)
    project.merge_pictures(keys[:, None].copy(), 3, depth, ids)
    np.testing.assert_array_equal(depth, [[[2, 5, 1]]])
    np.testing.assert_array_equal(ids, [[[3, 2, 1]]])
    ranked = np.stack([keys, np.full_like(keys, project.NOTHING)], axis=1)
    depth, ids = np.empty((2, 1, 3), np.float32), np.empty((2, 1, 3), np.uint32)
    project.merge_pictures(ranked, 3, depth, ids)
    np.testing.assert_array_equal(depth, [[[2, 5, 1]], [[2, np.inf, 3]]])
    np.testing.assert_array_equal(ids[:, 0, [0, 2]], [[3, 1], [7, 0]])
