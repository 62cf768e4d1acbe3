"""The training photos as an asset keeps them, how many of them are blended, and what the plan may say."""

from __future__ import annotations

import numpy as np
import pytest

from ibrpipe.capture.photo_set import PUBLISHED
from ibrpipe.modelling.view_dependence.photos_fitter import AROUND, TRIED, best_of, bytes_of_photos, keep, predict
from ibrpipe.types import Blend


@pytest.fixture(scope="module")
def ball(measured):
    return measured("ball")


def test_photos_are_cut_to_what_they_show_and_keep_their_places(ball):
    photos = ball.photos
    kept = keep(photos, Blend(3, 1.0))
    assert kept.blend == Blend(3, 1.0)
    assert len(kept.photos) == len(photos.cameras)
    for p, (photo, camera) in enumerate(zip(kept.photos, photos.cameras, strict=True)):
        shape = (camera.height, camera.width)
        depth, code = (
            photos.depth[photos.pixels_of(p)].reshape(shape),
            photos.code[photos.pixels_of(p)].reshape(*shape, 3),
        )
        rows, columns = np.nonzero(np.isfinite(depth) & (photos.mask[photos.pixels_of(p)].reshape(shape) >= 0.5))
        ray = camera.pixel_rays(np.stack([columns, rows], 1) + 0.5)
        world = camera.center + ray * depth[rows, columns][:, None]
        x, y, z = photo.camera.pixel_from_world @ np.append(world, np.ones((len(world), 1)), axis=1).T
        own = np.floor([y / z, x / z]).astype(int)
        assert photo.shown[*own].all()
        got = photo.codes[*own] * (kept.top / 255)
        assert np.abs(got - np.minimum(code[rows, columns], kept.top)).max() <= 0.501 * kept.top / 255
        around = photo.shown.sum() - len(rows)
        assert 0 <= around < 4 * (AROUND + 1) * (np.ptp(rows) + np.ptp(columns) + 4)
        assert photo.shown.size < 0.9 * camera.width * camera.height


def test_codes_reach_as_high_as_nearly_all_that_is_seen(ball):
    top = keep(ball.photos, PUBLISHED).top
    codes = np.concatenate([
        ball.photos.code[ball.photos.pixels_of(p)][np.isfinite(ball.photos.depth[ball.photos.pixels_of(p)])].max(axis=1)
        for p in range(len(ball.photos.cameras))
    ])  # fmt: skip
    assert top >= 1
    assert top == pytest.approx(max(1.0, np.quantile(codes, 0.999)), rel=0.02)


def test_as_many_are_blended_as_predict_left_out_photos_best(ball):
    squares = predict(ball.photos, ball.caster)
    assert tuple(squares) == TRIED
    assert all(0 < square < 0.1 for square in squares.values())
    assert len(set(squares.values())) == len(TRIED)
    assert best_of({Blend(3): 0.2, Blend(4, 0.5): 0.1, Blend(5): 0.3}) == Blend(4, 0.5)


def test_a_photo_does_not_predict_itself(ball):
    """Were it asked, two photos, of which one is only the bar, would predict every photo all but exactly."""
    few = ball.photos.subset(range(8))
    squares = predict(few, ball.caster)
    assert min(squares.values()) > 1e-5


def test_few_photos_are_blended_as_published(ball):
    few = ball.photos.subset(range(7))
    assert predict(few, ball.caster) == {}
    assert best_of({}) == PUBLISHED


def test_bytes_are_foretold_by_pixels_that_show_the_object(ball):
    kept = keep(ball.photos, PUBLISHED)
    shown = sum(int(photo.shown.sum()) for photo in kept.photos)
    assert bytes_of_photos(ball.photos, 0.5) == pytest.approx(0.5 * shown)
