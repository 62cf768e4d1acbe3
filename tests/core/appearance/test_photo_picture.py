"""Whole pictures from photos against the plain twin, pixel by pixel."""

from __future__ import annotations

import numpy as np
import photo_twin
import pytest
from kernel_runs import on_all_thread_counts
from photo_scene import plane_depth, random_photos

from ibrpipe.core.appearance.photo_picture import decoded, draw_photos
from ibrpipe.core.color import srgb_decode
from ibrpipe.renderers.pixel_grid import PixelGrid
from ibrpipe.types import Camera

RULES = np.array([0.05, 2.0, 0.75, 0.5])
TABLE = srgb_decode(np.linspace(0, 1, 4096)).astype(np.float32)
CAMERA = Camera.look_at((0.4, -0.6, 2.6), (0, 0, 0), up=(0, 1, 0), fov_y_deg=110, width=16, height=12)


def coded_photos(seed):
    """Random photos whose colours are bytes."""
    photos = random_photos(8, seed)
    return photos, [np.round(255 * photo.color).astype(np.uint8) for photo in photos]


def drawn(photos, codes, known, depth, most, normals=None, active=True):
    projection, centers, sizes, starts, _, far, mask = photo_twin.packed(photos)
    packed = projection, centers, sizes, starts, np.concatenate([c.reshape(-1, 3) for c in codes]), far, mask
    records, field = np.full((2, 8), -1, np.int32), np.eye(4)[None]
    records[:, :3] = 0
    if normals is not None:
        records[:, 4:] = 0
    ids = np.arange(depth.size, dtype=np.uint32).reshape(depth.shape) % 2
    color, counts = np.full((*depth.shape, 3), -1, np.float32), np.zeros((len(depth), 2), np.int64)
    view = CAMERA.world_from_pixel.copy(), CAMERA.center, *PixelGrid.centers(*depth.shape).arrays
    surface = records, np.full((1, 3), np.nan, np.float32) if normals is None else normals, np.array([active])
    draw_photos((depth, ids, known), color, view, surface, field, packed, most, RULES, TABLE, counts)
    return color, counts


@pytest.mark.parametrize("most", [2, 3, 5])
@pytest.mark.parametrize("normal", [None, (0.0, 0.6, 0.8), (0.0, -0.6, -0.8)])
def test_as_twin_whatever_the_threads(most, normal):
    """Normals are turned to the viewer; where none is known it is the direction to the viewer."""
    photos, codes = coded_photos(5)
    depth = plane_depth(CAMERA)
    depth[0, :4] = np.inf
    known = np.ones_like(depth)
    known[1, :4] = 0
    normals = None if normal is None else np.array([normal], np.float32)
    color, counts = on_all_thread_counts(lambda: drawn(photos, codes, known, depth, most, normals))
    rays, asked, seen = CAMERA.pixel_rays(), 0, 0
    for row, column in np.ndindex(depth.shape):
        if not (np.isfinite(depth[row, column]) and known[row, column]):
            assert (color[row, column] == -1).all()
            continue
        asked += 1
        ray = rays[row, column]
        point, toward = CAMERA.center + float(depth[row, column]) * ray, -ray / np.linalg.norm(ray)
        upward = toward if normal is None else np.array(normal) * np.sign(np.dot(normal, toward))
        bytes_seen = [photo_twin.Photo(p.camera, c / 255, p.depth, p.mask) for p, c in zip(photos, codes)]
        wanted, count = photo_twin.blend(bytes_seen, point, upward, toward, *RULES[:2], most, *RULES[2:])
        if count == 0:
            assert (color[row, column] == -1).all()
            continue
        seen += 1
        np.testing.assert_allclose(color[row, column], srgb_decode(np.clip(wanted, 0, 1)), atol=5e-5)
    assert counts.sum(axis=0).tolist() == [asked, seen]
    assert 50 < seen < asked


def test_fields_that_do_not_ask_are_left_alone():
    photos, codes = coded_photos(5)
    depth = plane_depth(CAMERA)
    color, counts = drawn(photos, codes, np.ones_like(depth), depth, 4, active=False)
    assert (color == -1).all()
    assert not counts.any()


def test_decoding_interpolates_and_stays_inside():
    table = np.array([0.0, 1.0, 4.0, 9.0], np.float32)
    assert [decoded(code, table) for code in (-1.0, 0.0, 0.5, 1.0, 2.75, 3.0, 7.0)] == [0, 0, 0.5, 1, 7.75, 9, 9]
