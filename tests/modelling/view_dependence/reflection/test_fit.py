"""Shared reflection fitted to a glossy ball and a matt wall: left-out photos come nearer, the wall needs no table."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from kernel_runs import on_all_thread_counts

from ibrpipe.core.color import srgb_decode
from ibrpipe.errors import CaptureError
from ibrpipe.modelling.view_dependence.reflection.choice import choose_tables, held_out_psnr
from ibrpipe.modelling.view_dependence.reflection.first_guess import first_colors, guess, seen_weight
from ibrpipe.modelling.view_dependence.reflection.fit import fit, unevenness
from ibrpipe.modelling.view_dependence.reflection.observations import join, observe_texels


def test_a_table_explains_the_glossy_ball_and_the_bytes_are_the_same_on_all_threads(ball):
    seen = ball.observe()
    held_out = np.arange(len(ball.photos.cameras)) % 5 == 2
    kept, tested = seen.of_photos(~held_out), seen.of_photos(held_out)
    first = guess(kept, ball.surface, ball.points)

    def compute(tables=1):
        model = fit(kept, ball.surface.corners, first, tables, ball.rules)
        return model.texels, model.tables

    on_all_thread_counts(compute)
    with_none, with_one = (
        held_out_psnr(fit(kept, ball.surface.corners, first, tables, ball.rules), tested, ball.surface.corners)
        for tables in (0, 1)
    )
    assert with_one > with_none + 1.0


def test_the_matt_wall_needs_no_table(wall):
    seen = wall.observe()
    tables, psnr = choose_tables(seen, wall.surface, wall.points, 16, wall.rules)
    assert len(psnr) == 2  # a second table is not tried where the first does not pay
    assert tables == 0
    few, none = choose_tables(seen, wall.surface, wall.points, 14, wall.rules)
    assert (few, none) == (1, [])


def test_observations_look_from_their_photos_and_carry_their_colours(ball):
    seen = ball.observe()
    inside = ball.photos.mask >= 0.5
    assert 0.3 * inside.sum() < len(seen.where) <= 0.55 * inside.sum()
    assert np.isfinite(seen.traits[:, :9]).all()
    assert np.isnan(seen.traits[:, 9:]).all()  # not yet fitted
    assert ((seen.traits[:, :5] >= 0) & (seen.traits[:, :5] <= 1)).all()
    assert (seen.traits[:, 5] > 0).mean() > 0.99
    # a convex ball mirrors next to nothing of itself
    assert len(seen.met) < 0.01 * len(seen.where)
    # what is nearest to a sample has about the median colour of all photos
    first = first_colors(seen, ball.surface.corners, len(ball.points))
    median = np.concatenate([each.color for each in ball.layers])
    known = np.isfinite(first[:, 0]) & (np.concatenate([each.observers for each in ball.layers]) >= 6)
    assert known.sum() > 300
    assert np.median(np.abs(np.sqrt(first[known]) - np.sqrt(median[known]))) < 0.05


def test_samples_are_observed_at_their_own_places(ball):
    wanted = np.zeros(len(ball.points), bool)
    wanted[::7] = True
    seen = observe_texels(ball.surface, ball.points, wanted, ball.measured.caster, ball.photos, ball.rules.size)
    weight = seen_weight(seen, ball.surface.corners, len(ball.points))
    assert not weight[~wanted].any()
    assert (weight[wanted] > 0).mean() > 0.5
    assert seen.traits[:, 5].max() <= 0.6
    none = observe_texels(ball.surface, ball.points, wanted & False, ball.measured.caster, ball.photos, ball.rules.size)
    assert none is None
    turns = observe_texels(ball.surface, ball.points, wanted, ball.measured.caster, ball.photos, ball.rules.size, 4)
    assert 1.2 * len(seen.where) < len(turns.where) < 4 * len(seen.where)
    assert (seen_weight(turns, ball.surface.corners, len(ball.points)) > 0).mean() > 0.5
    both = join([ball.observe(), seen])
    assert len(both.where) == len(ball.observe().where) + len(seen.where)
    photo = both.subset(np.arange(len(both.where))[::-1]).photo
    np.testing.assert_array_equal(photo, both.photo[::-1])


def test_subsets_keep_what_their_rays_meet(wall):
    seen = wall.observe()
    assert len(seen.met) > 0  # the ring before the wall mirrors in it
    rng = np.random.default_rng(0)
    chosen = rng.permutation(len(seen.where))[: len(seen.where) // 2]
    part = seen.subset(chosen)
    for number, where, traits in zip(part.met[:50], part.met_where, part.met_traits):
        before = int(np.flatnonzero(seen.met == chosen[number])[0])
        np.testing.assert_array_equal(where, seen.met_where[before])
        np.testing.assert_array_equal(traits, seen.met_traits[before])
    assert (np.diff(part.met) > 0).all()


def test_photos_with_nan_are_refused(ball):
    code = ball.photos.code.copy()
    code[100, 1] = np.nan
    with pytest.raises(CaptureError, match="NaN"):
        ball.observe(replace(ball.photos, code=code))


def test_clipped_photos_do_not_bound_the_light(ball):
    top = np.float32(np.quantile(ball.photos.code, 0.9))
    seen = ball.observe(replace(ball.photos, code=np.minimum(ball.photos.code, top)))
    clipped = seen.traits[:, 6:9] < 0
    assert clipped.any()
    np.testing.assert_allclose(seen.traits[:, 6:9][clipped] ** 2, srgb_decode(top), rtol=1e-3)


def test_unevenness_is_how_far_a_sample_is_above_its_neighbours():
    corners = np.array([[0, 1, 2, 3], [1, 4, 3, -1], [-1, -1, -1, 5], [0, 1, 2, 3]], np.int32)
    values = np.random.default_rng(0).random((6, 2)).astype(np.float32)
    pairs = [(0, 1), (2, 3), (0, 2), (1, 3), (1, 4)]  # (3, -1) and the lone 5 have no neighbour there
    wanted = np.zeros((6, 2))
    for one, other in pairs:
        wanted[one] += values[one] - values[other]
        wanted[other] += values[other] - values[one]
    np.testing.assert_allclose(unevenness(corners, 6) @ values, wanted, atol=1e-6)


def test_weights_that_are_asked_to_be_even_are(ball):
    seen = ball.observe()
    first = guess(seen, ball.surface, ball.points)
    own = unevenness(ball.surface.corners, len(ball.points))
    rough = []
    for evenness in (0.0, 0.05):
        weights = fit(seen, ball.surface.corners, first, 2, replace(ball.rules, evenness=evenness)).texels[:, 3:]
        rough.append(float((weights * (own @ weights)).sum()))
    assert rough[1] < 0.5 * rough[0]
