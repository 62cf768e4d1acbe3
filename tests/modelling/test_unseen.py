"""Samples without colour take that of their own side's neighbours, and only within reach."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from modelling.test_layers import EXACT, plans_around, points_of

from ibrpipe.modelling.layers import build_layers
from ibrpipe.modelling.unseen import close_gaps, fill_colors


def test_missing_colours_come_from_the_same_side_of_a_thin_wall():
    points = np.array([[0, 0, 0.0], [0, 0, 0.02], [0.1, 0, 0], [0.1, 0, 0.02], [1, 0, 0]])
    normals = np.array([[0, 0, -1.0], [0, 0, 1], [0, 0, -1], [0, 0, 1], [0, 0, 1]], np.float32)
    color = np.array([[1, 0, 0], [0, 1, 0], [np.nan] * 3, [np.nan] * 3, [np.nan] * 3], np.float32)
    filled = fill_colors(color, points, normals, 1.0)
    assert filled[2, 0] > filled[2, 1]
    assert filled[3, 1] > filled[3, 0]
    np.testing.assert_array_equal(filled[:2], color[:2])
    assert not fill_colors(np.full((2, 3), np.nan, np.float32), points[:2], normals[:2], 1.0).any()


def test_only_gaps_of_what_photos_show_are_closed(measured):
    """On a ball that one photo sees, the colours go on past its horizon by so many texels, and no further."""
    ball = measured("ball")
    photos, plans = ball.photos.subset([0]), plans_around(ball)
    built = [build_layers(which, plans, ball.caster, photos, EXACT)[0] for which in range(len(plans))]
    rectangles, texel = [plan.rectangle for plan in plans], plans[0].rectangle.texel
    closed, shares = close_gaps(rectangles, built, 3.0)
    points = np.concatenate([points_of(r, each)[0] for r, each in zip(rectangles, built, strict=True)])
    before, after = (np.concatenate([each.observers for each in layers]) for layers in (built, closed))
    color = np.concatenate([each.color for each in closed])
    gaps = (before == 0) & (after > 0)
    np.testing.assert_array_equal(after[before > 0], before[before > 0])
    apart = np.linalg.norm(points[gaps][:, None] - points[before > 0][None], axis=2).min(axis=1)
    assert 50 < gaps.sum() < 0.5 * (before == 0).sum()
    assert apart.max() <= 3.0 * texel
    assert (color[gaps].sum(axis=1) > 0).all()
    assert not color[after == 0].any()
    np.testing.assert_allclose(shares, [(a.observers > b.observers).mean() for a, b in zip(closed, built, strict=True)])
    for before, after in zip(built, close_gaps(rectangles, built, 0.0)[0], strict=True):
        assert after is before


def test_nothing_is_made_up_where_nothing_is_seen(measured):
    ball = measured("ball")
    plans = plans_around(ball)[:1]
    layers, _ = build_layers(0, plans, ball.caster, ball.photos, EXACT)
    blind = replace(layers, observers=np.zeros(len(layers.depth), np.int32))
    closed, shares = close_gaps([plans[0].rectangle], [blind], 4.0)
    assert closed == [blind]
    assert shares == [0.0]
