"""PatchMatch against its plain twin, on two small slanted scenes."""

import numba
import numpy as np
import patchmatch_twin as twin
import pytest

from ibrpipe.core.patchmatch.check import count_agreeing
from ibrpipe.core.patchmatch.planes import depths_and_normals, random_planes
from ibrpipe.core.patchmatch.sweep import sweep
from ibrpipe.reconstruction.depth.image_pyramid import packed
from ibrpipe.reconstruction.depth.patchmatch import disc, relation
from ibrpipe.types import Camera

SIZE = (20, 26)
LENS = np.array([40.0, 42.0, 13.5, 9.0])
#: the plane z = 2 + 0.4 x - 0.3 y as inverse depth over pixels
NORMAL = np.array([-0.4, 0.3, 1.0]) / 2


def camera(center):
    K = [[LENS[0], 0, LENS[2]], [0, LENS[1], LENS[3]], [0, 0, 1]]
    return Camera(np.array(K), np.column_stack([np.eye(3), -np.asarray(center, float)]), SIZE[1], SIZE[0])


def photo(center):
    """What a camera sees of a painted plane, whole greys (H, W)."""
    y, x = np.mgrid[: SIZE[0], : SIZE[1]] + 0.5
    rays = np.stack([(x - LENS[2]) / LENS[0], (y - LENS[3]) / LENS[1], np.ones_like(x)], axis=-1)
    points = center + rays * ((1 - NORMAL @ center) / (rays @ NORMAL))[..., None]
    s, t = points[..., 0], points[..., 1]
    return np.rint(127 + 60 * np.sin(9 * s + 3 * t) + 50 * np.sin(13 * t - 4 * s)).astype(np.float32)


@pytest.fixture(scope="module")
def scene():
    centers = np.array([[0, 0, 0], [0.3, 0, 0], [-0.2, 0.1, 0.05], [0.0, -0.3, 0.0]])
    greys = [photo(center) for center in centers]
    valid = np.ones(SIZE, np.uint8)
    valid[:4, :5] = 0
    views = np.stack([relation(camera(centers[0]), camera(center)) for center in centers[1:]])
    y, x = np.mgrid[: SIZE[0], : SIZE[1]] + 0.5
    truth = np.stack([NORMAL[0] * (x - LENS[2]) / LENS[0] + NORMAL[1] * (y - LENS[3]) / LENS[1] + NORMAL[2]] * 3)
    truth[1], truth[2] = NORMAL[0] / LENS[0], NORMAL[1] / LENS[1]
    return greys, valid, views, truth


def arguments(scene, sweep_number=0, consistency=(0.0, 2.0)):
    greys, valid, _, truth = scene
    window = disc()
    margin = int(np.abs(window[:2]).max())
    padded = np.pad(np.where(valid, greys[0], np.float32(-1)), margin, constant_values=-1)
    settings = (sweep_number, 5, 2.0, 2, np.float32(1 / (32 * 20.0**2)), np.array(consistency, np.float32))
    others = np.stack([truth[0].astype(np.float32) * np.float32(1 + 0.01 * n) for n in range(3)])
    return settings, window, padded, others


def started(valid):
    state = np.empty((4, *SIZE), np.float32)
    random_planes(LENS, valid, 0.3, 0.8, 7, state)
    return state


def run(scene, state, colours, sweep_number=0, consistency=(0.0, 2.0)):
    greys, valid, views, _ = scene
    settings, window, padded, others = arguments(scene, sweep_number, consistency)
    words = np.stack([packed(grey) for grey in greys[1:]])
    for colour in colours:
        sweep(
            (colour, *settings[:4]), *settings[4:], np.array([0.3, 0.8, 0.05]), LENS, window, padded, valid,
            (views.astype(np.float32), words, others.reshape(3, -1)), state,
        )  # fmt: skip
    return state


def twin_run(scene, state, colour, sweep_number=0, consistency=(0.0, 2.0)):
    greys, valid, views, _ = scene
    settings, window, _, others = arguments(scene, sweep_number, consistency)
    return twin.half_sweep(
        colour, *settings, (0.3, 0.8, 0.05), LENS, window, greys[0].astype(float), valid, views,
        [grey.astype(float) for grey in greys[1:]], others, state,
    )  # fmt: skip


@pytest.mark.parametrize("consistency", [(0.0, 2.0), (0.3, 2.0)])
def test_half_a_sweep_equals_the_twin(scene, consistency):
    state = run(scene, started(scene[1]), (0,))
    got = run(scene, state.copy(), (1,), 3, consistency)
    wanted = twin_run(scene, state, 1, 3, consistency)
    valid = scene[1] > 0
    assert (got[:3, ~valid] == 0).all()
    assert np.isinf(got[3, ~valid]).all()
    same = np.isclose(got[:, valid], wanted[:, valid], rtol=2e-3, atol=1e-4).all(axis=0)
    assert same.mean() > 0.97  # ties within rounding may fall either way
    assert np.abs(got[3, valid] - wanted[3, valid]).max() < 0.05


def test_random_planes_equal_the_twin(scene):
    state = started(scene[1])
    for i, j in ((0, 20), (10, 3), (19, 25)):
        pixel, x, y = i * SIZE[1] + j, j + 0.5, i + 0.5
        q = 0.3 + 0.5 * twin.uniform(7, pixel, 0, 0)
        normal = twin.random_normal(7, pixel, 0, 1, x, y, LENS)
        np.testing.assert_allclose(state[:3, i, j], twin.plane_of(q, normal, x, y, LENS), rtol=1e-4, atol=1e-6)
    assert np.isclose(state[0][scene[1] > 0].mean(), 0.55, atol=0.03)


@pytest.mark.skipif(numba.config.DISABLE_JIT, reason="minutes as plain Python, which half a sweep above runs, too")
def test_sweeps_find_the_plane_whatever_the_threads(scene):
    found = []
    for threads in (1, numba.config.NUMBA_NUM_THREADS):
        numba.set_num_threads(threads)
        state = started(scene[1])
        for sweep_number in range(6):
            run(scene, state, (0, 1), sweep_number)
        found.append(state)
    numba.set_num_threads(numba.config.NUMBA_NUM_THREADS)
    assert found[0].tobytes() == found[1].tobytes()
    middle = (slice(4, -4), slice(5, -5))
    error = np.abs(found[0][0] / scene[3][0] - 1)[middle]
    assert np.median(error) < 0.01
    depth, normal = np.empty(SIZE, np.float32), np.empty((*SIZE, 3), np.float32)
    depths_and_normals(LENS, found[0], depth, normal)
    np.testing.assert_allclose(depth[10, 13] * found[0][0, 10, 13], 1, rtol=1e-5)
    towards = -NORMAL / np.linalg.norm(NORMAL)
    assert np.median(normal[middle] @ towards) > np.cos(np.radians(8))
    assert (depth[:4, :5] == 0).all()


def test_agreement_counts_neighbours_with_the_same_depth_and_normal(scene):
    _, _, views, truth = scene
    state = np.concatenate([truth, np.zeros((1, *SIZE))]).astype(np.float32)
    centers = ([0.3, 0, 0], [-0.2, 0.1, 0.05], [0.0, -0.3, 0.0])
    planes = np.stack([truth / (1 - NORMAL @ center) for center in centers]).reshape(3, 3, -1).astype(np.float32)
    count = np.empty(SIZE, np.uint8)
    limits = np.array([0.5, 0.005, np.cos(np.radians(20))])
    count_agreeing(LENS, limits, views, planes, state, count)
    assert count[10, 13] == 3
    assert count.max() == 3
    planes[0, 0] *= 1.01  # one view is one per cent nearer, another looks at a surface turned away
    planes[1, 1] += 0.02
    count_agreeing(LENS, limits, views, planes, state, count)
    assert count[10, 13] == 1
    count_agreeing(LENS, np.array([2.0, 0.02, -1.0]), views, planes, state, count)
    assert count[10, 13] >= 2


def test_agreement_equals_the_twin_on_disturbed_planes(scene):
    _, _, views, truth = scene
    rng = np.random.default_rng(11)
    state = np.concatenate([truth, np.zeros((1, *SIZE))]).astype(np.float32)
    state[0][rng.random(SIZE) < 0.1] = 0
    state[1:3] += rng.normal(0, 2e-3, (2, *SIZE))
    centers = ([0.3, 0, 0], [-0.2, 0.1, 0.05], [0.0, -0.3, 0.0])
    planes = np.stack([truth / (1 - NORMAL @ center) for center in centers])
    planes[:, 0] *= 1 + rng.normal(0, 0.006, planes[:, 0].shape)
    planes[:, 1:] += rng.normal(0, 2e-3, planes[:, 1:].shape)
    planes[:, 0][rng.random(planes[:, 0].shape) < 0.1] = 0
    planes = planes.astype(np.float32)
    limits, count = np.array([0.3, 0.006, np.cos(np.radians(12))]), np.full(SIZE, 77, np.uint8)
    count_agreeing(LENS, limits, views, planes.reshape(3, 3, -1), state, count)
    wanted = np.zeros(SIZE, int)
    for i, j in np.argwhere(state[0] > 0):
        wanted[i, j] = sum(twin.agrees(state[:3, i, j], *each, limits, LENS, i, j) for each in zip(views, planes))
    np.testing.assert_array_equal(count, wanted)
    assert set(wanted.ravel()) == {0, 1, 2, 3}


def test_depths_and_normals_of_planes_equal_the_twin():
    rng = np.random.default_rng(12)
    state = rng.uniform((0.2, -0.02, -0.02, 0), (0.9, 0.02, 0.02, 1), (*SIZE, 4)).transpose(2, 0, 1).astype(np.float32)
    state[0][rng.random(SIZE) < 0.2] = 0
    depth, normal = np.empty(SIZE, np.float32), np.empty((*SIZE, 3), np.float32)
    depths_and_normals(LENS, state, depth, normal)
    known = state[0] > 0
    np.testing.assert_allclose(depth[known] * state[0][known], 1, rtol=1e-6)
    assert not depth[~known].any()
    assert not normal[~known].any()
    for i, j in np.argwhere(known):
        wanted = twin.normal_of(state[:3, i, j].astype(float), j + 0.5, i + 0.5, LENS)
        np.testing.assert_allclose(normal[i, j], wanted, atol=1e-5)


def test_pictures_without_a_valid_pixel_and_without_any(scene):
    greys, _, views, _ = scene
    state = started(np.zeros(SIZE, np.uint8))
    assert np.isinf(state[3]).all()
    assert not state[:3].any()
    run((greys, np.zeros(SIZE, np.uint8), views, np.ones((3, *SIZE))), state, (0, 1))
    assert not state[:3].any()
    none = np.empty((4, 0, 5), np.float32)
    random_planes(LENS, np.empty((0, 5), np.uint8), 0.3, 0.8, 7, none)
    depths_and_normals(LENS, none, np.empty((0, 5), np.float32), np.empty((0, 5, 3), np.float32))
    count_agreeing(LENS, np.ones(3), views, np.zeros((3, 3, 4), np.float32), none, np.empty((0, 5), np.uint8))
    alone = np.full(SIZE, 9, np.uint8)
    count_agreeing(LENS, np.ones(3), np.empty((0, 32)), np.empty((0, 3, 4), np.float32), state, alone)
    assert not alone.any()
