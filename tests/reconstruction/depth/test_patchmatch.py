"""Depth maps of a small capture: error, resumption, neighbours, what is dropped."""

import numpy as np
import pytest
from plane_scene import HEIGHT, NORMAL, PLACES, WIDTH, camera_at, rays, sparse, take, true_depth

from ibrpipe.errors import CaptureError
from ibrpipe.io.dense import read_map
from ibrpipe.io.photos.images import write_png
from ibrpipe.io.views import View
from ibrpipe.reconstruction import depth as dense
from ibrpipe.reconstruction.depth.consistency import small_pieces
from ibrpipe.reconstruction.depth.schedule import enlarged, passes
from ibrpipe.reconstruction.depth.view_selection import select_views
from ibrpipe.types import Camera

CONFIG = dense.DepthConfig(coarsest=64, iterations=4, neighbours=4)


@pytest.fixture(scope="module")
def views(tmp_path_factory):
    folder = tmp_path_factory.mktemp("photos")
    return [take(folder, n, camera_at(place)) for n, place in enumerate(PLACES)]


def errors(views, maps):
    for view, each in zip(views, maps, strict=True):
        depth = read_map(each.depth)
        yield depth, np.abs(depth / true_depth(view.camera) - 1)


def test_depth_maps_of_a_plane(views, tmp_path):
    maps = dense.estimate_depths(views, tmp_path, CONFIG, 3, sparse(views))
    for depth, error in errors(views, maps):
        assert (depth[:, :5] == 0).all()
        assert (depth[:, 8:] > 0).mean() > 0.85
        assert np.median(error[depth > 0]) < 0.004
    normal, sure = read_map(maps[1].normal), read_map(maps[1].confidence)
    expected = views[1].camera.R @ (-NORMAL / np.linalg.norm(NORMAL))
    known = read_map(maps[1].depth) > 0
    assert np.median(normal[known] @ expected) > 0.99
    assert (normal[~known] == 0).all()
    assert (sure[known] > 0).all()
    assert sure[~known].max(initial=0) == 0
    assert sure.max() <= 1
    assert maps[0].seconds > 0


def test_a_stopped_run_goes_on_and_gives_the_same_bytes(views, tmp_path, monkeypatch):
    whole = dense.estimate_depths(views, tmp_path / "a", CONFIG, 3, sparse(views))
    real, calls = dense.run_pass, []

    def stops(job, which, order):
        if order.number == 2 and which == 1:
            raise KeyboardInterrupt
        return real(job, which, order)

    def counts(job, which, order):
        calls.append(order.number)
        return real(job, which, order)

    monkeypatch.setattr(dense, "run_pass", stops)
    with pytest.raises(KeyboardInterrupt):
        dense.estimate_depths(views, tmp_path / "b", CONFIG, 3, sparse(views))
    monkeypatch.setattr(dense, "run_pass", counts)
    again = dense.estimate_depths(views, tmp_path / "b", CONFIG, 3, sparse(views))
    assert min(calls) == 2
    assert all(one.depth.read_bytes() == two.depth.read_bytes() for one, two in zip(whole, again))
    assert all(one.normal.read_bytes() == two.normal.read_bytes() for one, two in zip(whole, again))
    calls.clear()
    assert [each.seconds for each in dense.estimate_depths(views, tmp_path / "b", CONFIG, 3, sparse(views))] == [
        0.0
    ] * 5
    assert not calls


def test_neighbours_and_range_without_points(views):
    for view, selection in zip(views, select_views(views, None, 4), strict=True):
        depth = true_depth(view.camera)
        assert selection.near < depth.min()
        assert selection.far > np.median(depth)
        assert len(selection.others) >= 2


def ball_views(folder, count, masked=True):
    """Photos of a unit ball at the origin from `count` places around it, and the ball's depth range in each."""
    turn = np.arange(count) * 2 * np.pi / count
    for n, (x, y) in enumerate(zip(4 * np.cos(turn), 4 * np.sin(turn), strict=True)):
        camera = Camera.look_at([x, y, 0.0], [0, 0, 0], up=(0, 0, 1), fov_y_deg=40, width=WIDTH, height=HEIGHT)
        direction = rays(camera) / np.linalg.norm(rays(camera), axis=-1, keepdims=True)
        missed = 16 - (direction @ camera.center) ** 2 > 1
        picture = np.repeat(np.where(missed, 0.0, 0.5)[..., None], 3, axis=2).astype(np.float32)
        write_png(folder / f"{n}.png", picture)
        write_png(folder / f"{n}.mask.png", np.repeat(~missed[..., None], 3, axis=2).astype(np.float32))
        yield View(str(n), camera, folder / f"{n}.png", mask=folder / f"{n}.mask.png" if masked else None)


@pytest.mark.parametrize("count", [12, 14, 36])
def test_masks_bound_the_depth_of_photos_from_around(tmp_path, count):
    for selection in select_views(tuple(ball_views(tmp_path, count)), None, 6):
        assert 2.4 < selection.near < 3.0
        assert 3.75 < selection.far < 5.5  # the ball's outline lies at 3.75


def test_photos_without_masks_bound_depth_by_their_overlap(tmp_path):
    for selection in select_views(tuple(ball_views(tmp_path, 14, masked=False)), None, 6):
        assert 0.5 < selection.near < 3.0
        assert selection.far > 3.75


def test_neighbours_with_points_have_good_angles(views):
    found = select_views(views, sparse(views), 2)
    assert set(found[1].others) < {0, 2, 3, 4}
    depth = true_depth(views[1].camera)
    assert found[1].near < depth.min() < np.percentile(depth, 90) < found[1].far


def test_one_photo_is_too_few(views):
    with pytest.raises(CaptureError, match="at least 2 photos, got 1"):
        select_views(views[:1], None, 4)


def test_enlarged_planes_are_continued(views):
    y, x = np.mgrid[:6, :8] + 0.5
    state = np.stack([1 + 0.02 * x - 0.01 * y, 0 * x + 0.02, 0 * x - 0.01, 0 * x]).astype(np.float32)
    state[:, 2, 2] = 0
    got = enlarged(state, np.ones((12, 16), np.uint8))
    y, x = (np.mgrid[:12, :16] + 0.5) / 2
    assert np.abs(got[0] - (1 + 0.02 * x - 0.01 * y))[1:-1, 1:-1].max() < 1e-6
    assert np.allclose(got[1], 0.01)


def test_small_pieces_are_found():
    inverse = np.zeros((20, 20), np.float32)
    inverse[2:12, 2:12], inverse[4:6, 4:6], inverse[15:17, 15:18] = 0.5, 0.8, 0.5
    found = small_pieces(inverse, 0.01, 10)
    assert found[4:6, 4:6].all()
    assert found[15:17, 15:18].all()
    assert found.sum() == 10


def test_rounds_grow_to_the_full_size():
    rounds = passes(900, dense.DepthConfig())
    assert [order.shrink for order in rounds] == [4, 4, 4, 2, 2, 1, 1]
    assert [order.consistent for order in rounds] == [False] + [True] * 6
