"""The ray search called directly, against trying every patch in float64."""

from __future__ import annotations

import ldi_twin
import numpy as np
import pytest
from kernel_runs import on_all_thread_counts
from small_fields import CAMERAS, depth_image, empty_picture, layers, lies_between, relief

from ibrpipe.core.ldi.search import search_field
from ibrpipe.renderers.fields import build_field
from ibrpipe.renderers.search.quadtree import build_sheets

SOURCES = {"relief": relief(), "layers": layers(), "depth image": depth_image()}


def searched(source, camera, window=None, base=5):
    depth, ids = empty_picture(camera)
    window = np.array([0, camera.width, 0, camera.height]) if window is None else window
    for sheet in build_sheets(build_field(source), base):
        pyramid, front = (sheet.nodes, sheet.meta, sheet.grid), bool(len(sheet.leaves[1]))
        view = sheet.pose.field_from_pixel(camera)
        search_field(view, sheet.box, pyramid, sheet.leaves, front, window, sheet.base, depth, ids)
    return depth, ids


@pytest.mark.parametrize("view", CAMERAS)
@pytest.mark.parametrize("name", SOURCES)
def test_hits_equal_brute_force(name, view):
    source, camera = SOURCES[name], CAMERAS[view]
    depth, ids = on_all_thread_counts(lambda: searched(source, camera))
    larger, smaller = (ldi_twin.cast(source, camera, slack) for slack in (1e-6, -1e-6))
    lies_between(depth, larger, smaller)
    assert ((ids == 2**32 - 1) == np.isinf(depth)).all()
    assert ids.min() >= 5


def test_only_pixels_of_the_window_are_searched_and_nearer_hits_stay():
    source, camera = SOURCES["relief"], CAMERAS["front"]
    whole, _ = searched(source, camera)
    depth, _ = searched(source, camera, np.array([3, 9, 2, 7]))
    np.testing.assert_array_equal(depth[2:7, 3:9], whole[2:7, 3:9])
    depth[2:7, 3:9] = np.inf
    assert np.isinf(depth).all()
    picture, ids = np.full(depth.shape, 0.5, np.float32), np.full(depth.shape, 9, np.uint32)
    sheet = build_sheets(build_field(source), 0)[0]
    pyramid, window = (sheet.nodes, sheet.meta, sheet.grid), np.array([0, 17, 0, 13])
    search_field(sheet.pose.field_from_pixel(camera), sheet.box, pyramid, sheet.leaves, False, window, 0, picture, ids)
    assert (picture == 0.5).all()
    assert (ids == 9).all()
