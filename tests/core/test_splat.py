"""The forward warp called directly, against every sample and pixel one by one."""

from __future__ import annotations

import numpy as np
import pytest
from small_fields import CAMERAS, depth_image, relief

from ibrpipe.core.ldi.project_heights import merge
from ibrpipe.core.splat import splat_samples
from ibrpipe.renderers.epipolar.samples import build_raster
from ibrpipe.renderers.fields import build_field

SOURCES = {"relief": relief(), "wall": depth_image()}


def one_by_one(raster, pixel, eye, base, grow, shape):
    """Depth and number of the nearest sample whose footprint holds a pixel's middle."""
    depth, ids = np.full(shape, np.inf), np.full(shape, 2**32 - 1)
    py, px = np.mgrid[: shape[0], : shape[1]] + 0.5
    for sample, d in enumerate(raster.depth.ravel().astype(float)):
        v, u = divmod(sample, raster.depth.shape[1])
        x, y, w = pixel @ (u, v, d, 1.0)
        t = -w / d if raster.pose.perspective else w
        if not (t > eye and w > 0):
            continue
        x, y = x / w, y / w
        wide = 0.5 * grow * np.abs(pixel[0, :2] - x * pixel[2, :2]).sum() / w
        high = 0.5 * grow * np.abs(pixel[1, :2] - y * pixel[2, :2]).sum() / w
        hit = (np.abs(px - x) <= wide) & (np.abs(py - y) <= high)
        t = np.float32(t)
        hit &= (t < depth) | ((t == depth) & (base + sample < ids))
        depth[hit], ids[hit] = t, base + sample
    return depth, ids


@pytest.mark.parametrize("view", CAMERAS)
@pytest.mark.parametrize("name", SOURCES)
@pytest.mark.parametrize("chunks", [1, 3])
def test_nearest_footprints_win(name, view, chunks):
    camera, field = CAMERAS[view], build_field(SOURCES[name])
    raster = build_raster(SOURCES[name], field, 0.0)
    pixel, shape = raster.pose.pixel_from_field(camera), (camera.height, camera.width)
    depth, ids = np.full((chunks, *shape), np.inf, np.float32), np.full((chunks, *shape), 2**32 - 1, np.uint32)
    flat, stride = raster.depth.ravel(), raster.depth.shape[1]
    splat_samples(flat, stride, pixel, raster.pose.perspective, 0.01, 5, 1.2, depth, ids)
    merge(depth, ids)
    want, numbers = one_by_one(raster, pixel, 0.01, 5, 1.2, shape)
    assert np.isfinite(want).any()
    np.testing.assert_allclose(depth[0], want, rtol=1e-6)
    np.testing.assert_array_equal(ids[0], numbers)


def test_without_samples_nothing_is_covered():
    depth, ids = np.full((2, 3, 4), np.inf, np.float32), np.zeros((2, 3, 4), np.uint32)
    for flat in (np.empty(0, np.float32), np.full(6, np.nan, np.float32)):
        splat_samples(flat, 3, np.ones((3, 4)), False, 0.0, 0, 1.0, depth, ids)
    assert np.isinf(depth).all()
