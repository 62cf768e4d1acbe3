"""Exposure and white balance of photos, found from points that they show in common."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ibrpipe.capture.coverage import spread_points
from ibrpipe.capture.photometry import CLIPPED, DARK, find_gains, gain_of, observe
from ibrpipe.io.views import read_views
from ibrpipe.progress import listening

POINTS, PHOTOS = 400, 7


@pytest.fixture
def matt() -> tuple[np.ndarray, np.ndarray]:
    """log2 colours of points in photos that each show a window of them, and the stops by which photos are off."""
    rng = np.random.default_rng(5)
    stops = rng.normal(0, 0.3, (PHOTOS, 3))
    seen = rng.uniform(-4, -1, (POINTS, 1, 3)) + stops
    order = np.arange(POINTS) / POINTS * PHOTOS
    seen[np.abs(order[:, None] - np.arange(PHOTOS) - 0.5) > 1.5] = np.nan  # only neighbours show points in common
    return seen.astype(np.float32), stops - np.median(stops, axis=0)


def test_gains_of_matt_points_are_exact(matt):
    seen, stops = matt
    found = find_gains(seen)
    assert np.allclose(found.train, 2.0**-stops, rtol=1e-5)  # log2 light is float32
    assert found.before > 0.05
    assert found.after < 1e-5
    assert found.explained > 0.99


def test_outliers_do_not_move_gains(matt):
    seen, stops = matt
    rng = np.random.default_rng(6)
    shining = rng.random(seen.shape[:2]) < 0.2
    seen[shining] += rng.uniform(1, 3, (int(shining.sum()), 1)).astype(np.float32)
    # the median of factors that scatter by one value: none of the matt pairs differs
    assert np.abs(np.log2(find_gains(seen).train) + stops).max() < 1e-3


def test_gloss_that_differs_from_point_to_point_is_not_explained():
    rng = np.random.default_rng(7)
    seen = rng.uniform(-4, -1, (2000, 1, 1)) + rng.normal(0, 0.3, (2000, PHOTOS, 3))
    found = find_gains(seen.astype(np.float32))
    assert found.explained < 0.02  # medians of 2000 points scatter by 0.01 stops, a thirtieth of the disagreement
    assert found.stops < 0.03


def test_a_photo_that_shares_nothing_keeps_its_light(matt):
    seen, stops = matt
    seen[:, 3] = np.nan
    found = find_gains(seen)
    assert (found.train[3] == 1.0).all()
    near = slice(0, 3)  # photos 0 to 2 still hang together
    apart = np.log2(found.train[near]) + stops[near]
    assert np.ptp(apart, axis=0).max() < 1e-5


@pytest.mark.parametrize("seen", [np.full((50, 3, 3), np.nan, np.float32), np.zeros((0, 2, 3), np.float32)])
def test_photos_without_common_points_stay(seen):
    found = find_gains(seen)
    assert (found.train == 1.0).all()
    assert np.isnan(found.before)
    assert found.explained == 0.0


def test_the_gain_of_one_more_photo(matt):
    seen, _ = matt
    gains = find_gains(seen)
    off = np.array([0.5, -0.25, 0.1])
    assert np.allclose(gain_of(gains.colors + off, gains.colors), 2.0**-off, rtol=1e-5)
    few = np.full_like(gains.colors, np.nan)
    few[:29] = gains.colors[:29] + off
    assert (gain_of(few, gains.colors) == 1.0).all()


def test_what_photos_show_of_points(measured):
    ball = measured("ball")
    views = read_views(ball.folder / "views.json").train[:3]
    points = spread_points(ball.caster.mesh, 300)
    bars = []
    with listening(lambda label, done, total: bars.append((label, total))):
        seen = observe(views, ball.caster, points)
    assert set(bars) == {("photos in common", 3)}  # one bar, not another for every photo
    known = np.isfinite(seen[:, :, 0])
    assert known.any(axis=0).all()
    assert (np.isfinite(seen).all(axis=2) == known).all()
    for number, view in enumerate(views):
        toward = view.camera.center - points.position
        cosine = (toward * points.normal).sum(axis=1) / np.linalg.norm(toward, axis=1)
        assert (cosine[known[:, number]] >= 0.4).all()
    light = 2.0 ** seen[known]
    assert light.min() > DARK
    assert light.max() < CLIPPED
    # a photo twice as bright shows twice the light, of the same pixels: what is clipped is told by the file
    brighter = observe([replace(view, gain=2.0) for view in views], ball.caster, points)
    assert (np.isfinite(brighter) == np.isfinite(seen)).all()
    assert np.allclose(brighter[known] - seen[known], 1.0, atol=1e-4)
