"""Projection of height fields, kernel by kernel, against plain scans and against trying every patch."""

from __future__ import annotations

import ldi_twin
import numpy as np
import pytest
from small_fields import CAMERAS, lies_between, relief

from ibrpipe.core.ldi import project_heights as ph
from ibrpipe.renderers.fields import build_field
from ibrpipe.renderers.ldi.renderer import pack_rays
from ibrpipe.renderers.search.epipolar_lines import EYE


@pytest.mark.parametrize("shape", [(2, 2), (7, 9), (18, 70), (35, 66)])
def test_bounds_of_blocks_equal_a_scan(shape):
    rng = np.random.default_rng(0)
    height = rng.random(shape).astype(np.float32)
    height[rng.random(shape) < 0.2] = np.nan
    height[:17, :65] = np.nan
    blocks = (-(-(shape[0] - 1) // ph.BLOCK_ROWS), -(-(shape[1] - 1) // ph.BLOCK_COLUMNS))
    low, high = np.empty(blocks, np.float32), np.empty(blocks, np.float32)
    ph.bound_blocks(height, low, high)
    for j, i in np.ndindex(*blocks):
        rows, columns = ph.BLOCK_ROWS, ph.BLOCK_COLUMNS
        own = height[j * rows : (j + 1) * rows + 1, i * columns : (i + 1) * columns + 1]
        some = own[np.isfinite(own)]
        assert (low[j, i], high[j, i]) == ((some.min(), some.max()) if len(some) else (np.inf, -np.inf))


def view_of(field, camera):
    return field.pose.pixel_from_field(camera), pack_rays(*field.pose.field_from_pixel(camera)), EYE * field.reach


@pytest.mark.parametrize("view", CAMERAS)
@pytest.mark.parametrize("parts", [1, 3])
def test_projected_cells_equal_brute_force(view, parts):
    source, camera = relief(), CAMERAS[view]
    field = build_field(source)
    depth = np.full((parts, camera.height, camera.width), np.inf, np.float32)
    ids = np.full(depth.shape, 2**32 - 1, np.uint32)
    low, high = np.array([[np.nanmin(field.height)]]), np.array([[np.nanmax(field.height)]])
    ph.project_heights(field.height, low, high, view_of(field, camera), (False, True), 4, depth, ids)
    ph.merge(depth, ids)
    lies_between(depth[0], *(ldi_twin.cast(source, camera, slack) for slack in (1e-6, -1e-6)))
    assert ids[0][np.isfinite(depth[0])].min() >= 4
    assert ids[0][np.isfinite(depth[0])].max() < 4 + field.cells


def test_a_field_of_holes_is_nowhere():
    camera, height = CAMERAS["front"], np.full((4, 5), np.nan, np.float32)
    field = build_field(relief())
    depth, ids = np.full((1, 13, 17), np.inf, np.float32), np.zeros((1, 13, 17), np.uint32)
    low, high = np.full((1, 1), np.inf, np.float32), np.full((1, 1), -np.inf, np.float32)
    ph.project_heights(height, low, high, view_of(field, camera), (True, False), 0, depth, ids)
    assert np.isinf(depth).all()


def test_listed_rays_meet_their_patch_alone():
    source, camera = relief((2, 2), holes=0.0), CAMERAS["front"]
    field = build_field(source)
    _, rays, eye = view_of(field, camera)
    y, x = np.mgrid[: camera.height, : camera.width]
    listed, count = np.zeros(11 * ph.LIST), x.size
    rows = (x.ravel(), y.ravel(), 0, 0, *field.height.ravel(), 9.5, 3)
    for row, value in enumerate(rows):
        listed[row * ph.LIST : row * ph.LIST + count] = value
    depth, ids = np.full(x.shape, np.inf, np.float32), np.full(x.shape, 9, np.uint32)
    ph.meet_listed(listed, 0, rays, eye, depth, ids)
    assert np.isinf(depth).all()
    ph.meet_listed(listed, count, rays, eye, depth, ids)
    larger, smaller = (ldi_twin.cast(source, camera, slack) for slack in (1e-6, -1e-6))
    assert np.isfinite(larger).any()
    assert (depth >= larger * (1 - 2e-6)).all()
    assert (depth <= smaller * (1 + 2e-6)).all()
    assert ((ids == 3) == np.isfinite(depth)).all()


def test_of_equal_hits_the_least_number_is_kept():
    depth = np.array([[[2.0, np.inf, 5.0]], [[2.0, 1.0, 6.0]], [[2.0, np.inf, 4.0]]], np.float32)
    ids = np.array([[[7, 9, 1]], [[3, 2, 2]], [[5, 9, 3]]], np.uint32)
    ph.merge(depth, ids)
    np.testing.assert_array_equal(depth[0], [[2.0, 1.0, 4.0]])
    np.testing.assert_array_equal(ids[0], [[3, 2, 3]])
