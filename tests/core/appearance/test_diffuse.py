"""Diffuse colour from all photos: outliers, counts 1, 2 and even, all statistics, against a plain twin."""

from __future__ import annotations

import numpy as np
import photo_twin
import pytest
from kernel_runs import on_all_thread_counts
from photo_scene import constant_photos, random_photos, random_points

from ibrpipe.core.appearance.diffuse import MEAN, MEDIAN, MODE, diffuse_colors, reduce_channel

STATISTICS = {"median": MEDIAN, "mean": MEAN, "mode": MODE}


def reduced(photos, points, normals, statistic="median", bins=128, top=1.0):
    color, spread = np.empty((len(points), 3), np.float32), np.empty(len(points), np.float32)
    count = np.empty(len(points), np.int32)
    arrays = photo_twin.packed(photos)
    diffuse_colors(points, normals, arrays, 0.05, 2.0, top, bins, STATISTICS[statistic], color, spread, count)
    return color, spread, count


def at_origin(colors, **options):
    color, spread, count = reduced(
        constant_photos(colors), np.zeros((1, 3)), np.array([[0, 0, 1]], np.float32), **options
    )
    assert count[0] == len(colors)
    return color[0], spread[0]


def test_median_is_unmoved_by_forty_per_cent_outliers_in_any_channel():
    colors = np.tile((0.3, 0.5, 0.7), (10, 1))
    colors[[0, 1, 2, 3], 0] = (1.0, 0.9, 0.99, 0.8)  # other photos in every channel
    colors[[3, 4, 5, 6], 1] = (1.0, 1.0, 1.0, 1.0)
    colors[[6, 7, 8, 9], 2] = (0.0, 0.1, 1.0, 0.9)
    found, _ = at_origin(colors)
    np.testing.assert_allclose(found, (0.3, 0.5, 0.7), atol=1e-6)
    mean, _ = at_origin(colors, statistic="mean")
    assert np.abs(mean - (0.3, 0.5, 0.7)).max() > 0.1  # the outliers are felt where nothing guards against them


def test_highlights_far_above_one_do_not_move_the_median():
    colors = np.tile((0.3, 0.5, 0.7), (5, 1))
    colors[:2] = 40.0
    found, _ = at_origin(colors, top=40.0, bins=128)
    np.testing.assert_allclose(found, (0.3, 0.5, 0.7), atol=1e-6)


def test_one_observation_is_kept():
    found, spread = at_origin([(0.123, 0.456, 0.789)])
    np.testing.assert_allclose(found, (0.123, 0.456, 0.789), atol=1e-7)
    assert spread == pytest.approx(0.0, abs=1e-7)


def test_two_observations_give_their_mean():
    found, spread = at_origin([(0.1, 0.9, 0.5), (0.3, 0.2, 0.5)])
    np.testing.assert_allclose(found, (0.2, 0.55, 0.5), atol=1e-7)
    assert spread == pytest.approx((0.1 + 0.35 + 0.0) / 3, abs=1e-6)


def test_even_count_gives_the_mean_of_the_middle_two():
    found, _ = at_origin([(0.1, 0.9, 0.4), (0.2, 0.1, 0.4), (0.6, 0.5, 0.4), (1.0, 0.7, 0.8)])
    np.testing.assert_allclose(found, (0.4, 0.6, 0.4), atol=1e-6)


@pytest.mark.parametrize("statistic", STATISTICS)
def test_every_statistic_as_twin_whatever_the_threads(statistic):
    photos = random_photos(9, 11)
    points, normals = random_points(260, 12)
    run = on_all_thread_counts(lambda: reduced(photos, points, normals, statistic, bins=16))
    wanted = [photo_twin.diffuse(photos, *row, 0.05, 2.0, 1.0, 16, statistic) for row in zip(points, normals)]
    color, spread, count = run
    np.testing.assert_array_equal(count, [used for _, _, used in wanted])
    np.testing.assert_allclose(color, [value for value, _, _ in wanted], atol=1e-5)
    np.testing.assert_allclose(spread, [value for _, value, _ in wanted], atol=1e-5)
    assert 0 < (count == 0).sum() < 200
    assert {1, 2} < set(count)


@pytest.mark.parametrize("statistic", STATISTICS)
def test_one_channel_as_twin(statistic):
    rng = np.random.default_rng(13)
    for count in (1, 2, 3, 4, 7, 40):
        for bins in (1, 8, 128):
            values = rng.gamma(1.0, 0.3, count)
            votes = rng.choice([0.5, 1.0, 3.0], count)
            found = reduce_channel(values, votes, count, 1.0, np.empty(bins), STATISTICS[statistic])
            assert found == pytest.approx(photo_twin.reduced(values, votes, 1.0, bins, statistic), abs=1e-12)


def test_median_is_within_a_bin_of_the_exact_one():
    rng = np.random.default_rng(14)
    for count in range(1, 30):
        values = rng.random(count)
        found = reduce_channel(values, np.full(count, 0.3), count, 1.0, np.empty(64), MEDIAN)
        assert abs(found - np.median(values)) < 1 / 64


def test_mode_is_where_most_values_are():
    values = np.array([0.1, 0.51, 0.52, 0.53, 0.9, 0.91])
    assert reduce_channel(values, np.ones(6), 6, 1.0, np.empty(10), MODE) == pytest.approx(0.52)
    votes = np.array([1.0, 1.0, 1.0, 1.0, 3.0, 1.0])
    assert reduce_channel(values, votes, 6, 1.0, np.empty(10), MODE) == pytest.approx((3 * 0.9 + 0.91) / 4)


def test_two_photos_that_show_a_place_finely_outvote_three_from_afar():
    eyes = [(0, 0.5, 2.0), (0, -0.5, 2.0), (0.5, 0, 6.0), (-0.5, 0, 6.0), (0, 0.1, 6.0)]
    photos = constant_photos([(0.2, 0.2, 0.2)] * 2 + [(0.6, 0.6, 0.6)] * 3, eyes)
    color, _, count = reduced(photos, np.zeros((1, 3)), np.array([[0, 0, 1]], np.float32))
    assert count[0] == 5
    np.testing.assert_allclose(color[0], 0.2, atol=1e-6)


def test_no_points_and_a_point_nobody_sees():
    photos = random_photos(3, 15)
    color, _, _ = reduced(photos, np.empty((0, 3)), np.empty((0, 3), np.float32))
    assert color.shape == (0, 3)
    color, spread, count = reduced(photos, np.array([[0, 0, -9.0]]), np.array([[0, 0, 1]], np.float32))
    assert np.isnan(color).all()
    assert (spread[0], count[0]) == (0, 0)
