"""Normals refined by gloss: a damaged ball's come back, true ones stay, and steps go where colours say."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from kernel_runs import on_all_thread_counts
from scipy.ndimage import gaussian_filter

from ibrpipe.modelling.view_dependence.reflection import normals as refinement
from ibrpipe.modelling.view_dependence.reflection.first_guess import guess
from ibrpipe.modelling.view_dependence.reflection.fit import fit
from ibrpipe.modelling.view_dependence.reflection.normals import refine_normals
from ibrpipe.modelling.view_dependence.reflection.observations import look_again


def damaged(surface, points, degrees):
    """The surface with normals that a wave over it turns by so much, in the mean."""
    around = np.sin(5.0 * points[:, [1, 2, 0]])
    bent = surface.normals + np.radians(degrees) * around
    return replace(surface, normals=(bent / np.linalg.norm(bent, axis=1, keepdims=True)).astype(np.float32))


def degrees_between(one, other):
    one, other = (each / np.linalg.norm(each, axis=1, keepdims=True) for each in (one.astype(np.float64), other))
    cosine = (one * other).sum(axis=1)
    return float(np.degrees(np.arccos(np.clip(cosine, -1, 1))).mean())


def fitted(stage, surface):
    seen = look_again(stage.observe(), surface, stage.photos.centers, stage.rules.size)
    return fit(seen, surface.corners, guess(seen, surface, stage.points), 1, stage.rules), seen


def photographed(stage, surface):
    """A model in bright surroundings, and photos of it with the true normals, looked at with another surface's."""
    model, seen = fitted(stage, stage.surface)
    rng = np.random.default_rng(0)
    model.tables[:] = gaussian_filter(rng.uniform(0.0, 6.0, model.tables.shape), (0, 1, 1, 0))
    colors = model.colors(seen.where, seen.traits, surface.corners)
    again = look_again(seen, surface, stage.photos.centers, stage.rules.size)
    again.traits[:, 6:9] = np.sqrt(np.nan_to_num(colors))
    return model, again


def test_the_same_normals_show_the_same(ball):
    seen = ball.observe()
    again = look_again(seen, ball.surface, ball.photos.centers, ball.rules.size)
    np.testing.assert_array_equal(again.where[:, 0], seen.where[:, 0])
    same = again.where[:, 1] == seen.where[:, 1]
    assert same.mean() > 0.99  # places are had from float32
    np.testing.assert_allclose(again.traits[same, :9], seen.traits[same, :9], atol=1e-3)
    np.testing.assert_array_equal(again.photo, seen.photo)
    assert abs(len(again.met) - len(seen.met)) <= 0.01 * len(seen.where)


def test_damaged_normals_come_back_and_are_the_same_on_all_threads(ball):
    surface = damaged(ball.surface, ball.points, 4.0)
    before = degrees_between(surface.normals, ball.surface.normals)
    assert 2.0 < before < 6.0

    model, seen = photographed(ball, surface)

    def compute():
        own = replace(model, texels=model.texels.copy(), tables=model.tables.copy())
        return (refine_normals(own, seen, surface, ball.photos.centers, ball.rules).normals,)

    (refined,) = on_all_thread_counts(compute)
    np.testing.assert_allclose(np.linalg.norm(refined, axis=1), 1.0, atol=1e-5)
    after = degrees_between(refined, ball.surface.normals)
    assert after < 0.7 * before


def test_true_normals_stay_as_they_are(ball):
    model, seen = fitted(ball, ball.surface)
    assert refine_normals(model, seen, ball.surface, ball.photos.centers, ball.rules) is ball.surface
    surface = damaged(ball.surface, ball.points, 4.0)
    assert refine_normals(model, seen, surface, ball.photos.centers[:7], ball.rules) is surface


def test_slopes_say_how_colours_change(ball, monkeypatch):
    model, seen = fitted(ball, ball.surface)
    part = seen.subset(np.arange(0, len(seen.where), 7))
    monkeypatch.setattr(refinement, "DIFFERENCE", np.radians(0.05))
    slopes, errors, weight = refinement._derivatives(model, part, ball.surface, ball.rules.bend)
    assert ((weight > 0).any(axis=1)).mean() > 0.9
    observed = np.abs(part.traits[:, 6:9])
    # turned about x by a little, all normals change as that says, and colours as the slopes do
    angle = np.radians(0.05)
    turned = ball.surface.normals + angle * np.cross([1.0, 0, 0], ball.surface.normals).astype(np.float32)
    other = replace(ball.surface, normals=turned.astype(np.float32))
    _, moved, _ = refinement._derivatives(model, part, other, ball.rules.bend)
    shares = refinement.corner_weights(part, ball.surface.corners)[..., None]
    normal = (shares * ball.surface.normals[ball.surface.corners[part.where[:, 0]]]).sum(axis=1)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    foretold = np.einsum("ncd,nd->nc", slopes, angle * np.cross([1.0, 0, 0], normal))
    change = errors - moved  # colour grows as the error shrinks
    assert observed.shape == change.shape
    assert np.corrcoef(foretold.ravel(), change.ravel())[0, 1] > 0.95
    assert np.abs(foretold - change).mean() < 0.3 * np.abs(change).mean()
    steep = np.abs(np.einsum("ncd,nd->nc", slopes, normal))
    assert steep.max() < 1e-6 * max(np.abs(slopes).max(), 1.0)  # along the normal nothing changes


@pytest.mark.parametrize("clipped", [False, True])
def test_clipped_photos_ask_for_nothing_that_is_exceeded(ball, clipped):
    model, seen = fitted(ball, ball.surface)
    traits = seen.traits.copy()
    traits[:, 6:9] = -1e-3 if clipped else 1e-3
    darker = replace(seen, traits=traits)
    _, _, weight = refinement._derivatives(model, darker, ball.surface, ball.rules.bend)
    assert (weight > 0).any() != clipped
