"""Draft depth by rectified pairs: rectification in all directions, error, masks, what cannot be done."""

import cv2
import numpy as np
import pytest
from plane_scene import HEIGHT, NORMAL, PLACES, WIDTH, camera_at, sparse, take, true_depth

from ibrpipe.errors import CaptureError
from ibrpipe.io.dense import read_map
from ibrpipe.reconstruction import depth as dense
from ibrpipe.reconstruction.depth.rectify import rectified
from ibrpipe.reconstruction.depth.semi_global import merged

CONFIG = dense.DepthConfig(method="sgbm", neighbours=4)
WHOLE = (0, 0, WIDTH, HEIGHT)


def project(camera, points):
    local = points @ camera.R.T + camera.t
    pixel = local @ camera.K.T
    return pixel[:, :2] / pixel[:, 2:]


@pytest.mark.parametrize("place", [(0.6, 0.1, 0), (-0.6, 0, 0.2), (0, 0.5, 0), (0, -0.5, 0.1), (0.4, 0.4, 0)])
@pytest.mark.parametrize("up", [(0, -1, 0), (0.5, -1, 0), (1, 0, 0)])
def test_a_point_is_in_the_same_row_of_both(place, up):
    view, partner = camera_at((0, 0, 0)), camera_at(place, up)
    pair = rectified(view, partner, WHOLE, 3.0, 6.0)
    rng = np.random.default_rng(1)
    pixels = rng.uniform((0, 0), (WIDTH, HEIGHT), (200, 2))
    depth = rng.uniform(3, 6, (200, 1))
    points = view.center + depth * (np.concatenate([pixels, np.ones((200, 1))], axis=1) @ view.world_from_pixel.T)
    first, second = project(pair.first, points), project(pair.second, points)
    assert np.abs(first[:, 1] - second[:, 1]).max() < 1e-9
    disparity = first[:, 0] - second[:, 0]
    assert disparity.min() > 0
    assert disparity.max() < pair.disparities
    assert first[:, 0].min() >= pair.disparities - 1e-9
    assert (first <= [pair.first.width, pair.first.height]).all()
    back = np.concatenate([first, np.ones((200, 1))], axis=1) @ pair.pixels.T
    assert np.abs(back[:, :2] / back[:, 2:] - pixels).max() < 1e-9


@pytest.mark.parametrize("place", [(0, 0, 1.0), (0.05, 0, -1.0), (0, 0, 0)])
def test_an_epipole_in_the_picture_is_refused(place):
    assert rectified(camera_at((0, 0, 0)), camera_at(place), WHOLE, 3.0, 6.0) is None


def test_many_disparities_shrink_the_pictures():
    pair = rectified(camera_at((0, 0, 0)), camera_at((1.5, 0, 0)), WHOLE, 0.05, 6.0)
    assert pair is None or pair.disparities <= 512 + 16


@pytest.fixture(scope="module")
def views(tmp_path_factory):
    folder = tmp_path_factory.mktemp("photos")
    return [take(folder, n, camera_at(place)) for n, place in enumerate(PLACES)]


@pytest.fixture(scope="module")
def maps(views, tmp_path_factory):
    return dense.estimate_depths(views, tmp_path_factory.mktemp("dense"), CONFIG, 3, sparse(views))


def test_depth_maps_of_a_plane(views, maps):
    for view, each in zip(views, maps, strict=True):
        depth = read_map(each.depth)
        error = np.abs(depth / true_depth(view.camera) - 1)
        assert (depth[:, :6] == 0).all()
        assert (depth[:, 8:] > 0).mean() > 0.8
        assert np.median(error[depth > 0]) < 0.004
        assert each.seconds > 0
    normal, sure = read_map(maps[1].normal), read_map(maps[1].confidence)
    known = read_map(maps[1].depth) > 0
    expected = views[1].camera.R @ (-NORMAL / np.linalg.norm(NORMAL))
    assert np.median(normal[known] @ expected) > 0.99
    assert (sure[known] > 0).all()
    assert sure[~known].max(initial=0) == 0


def test_the_number_of_threads_changes_no_byte(views, maps, tmp_path):
    before = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        again = dense.estimate_depths(views, tmp_path, CONFIG, 3, sparse(views))
    finally:
        cv2.setNumThreads(before)
    for one, two in zip(maps, again, strict=True):
        for kind in ("depth", "normal", "confidence"):
            assert getattr(one, kind).read_bytes() == getattr(two, kind).read_bytes()


def test_forward_motion_says_what_to_use(tmp_path):
    views = [take(tmp_path, n, camera_at((0, 0, 0.3 * n))) for n in range(3)]
    with pytest.raises(CaptureError, match=r"no photo can be rectified.*method=patchmatch"):
        dense.estimate_depths(views, tmp_path / "dense", CONFIG, 0, sparse(views))


def test_the_larger_group_wins_and_is_averaged():
    inverse = np.array([0.50, 0.90, 0.52, 0.0], np.float32).reshape(4, 1, 1)
    best, cost = merged(inverse, np.array([1.0, 1.5, 1.0, 9.0]), 0.05)
    assert best[0, 0] == pytest.approx(0.51)
    assert cost[0, 0] == pytest.approx(1 / 3)
    best, cost = merged(np.zeros((2, 1, 1), np.float32), np.ones(2), 0.05)
    assert (best[0, 0], cost[0, 0]) == (0, 1)
