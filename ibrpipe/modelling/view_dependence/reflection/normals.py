"""Normals refined by what photos show of the gloss.

A mirror doubles every error of a normal, and those of a reconstructed mesh are off by degrees. Between rounds of the
fit all normals are turned by a Gauss-Newton step (nocedal2006, sec. 10.3) toward what the observations show under the
present model. What a sample's neighbours ask for counts, too: its own observations say too little. The first step is
judged by photos that it does not know; where it does not bring them nearer, normals stay as they are.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from scipy.sparse import csr_array, diags_array

from ibrpipe.core.reflection.geometry import reflect
from ibrpipe.core.reflection.model import DARK
from ibrpipe.modelling.view_dependence.reflection.choice import HELD_OUT_EVERY, held_out_photos, held_out_psnr
from ibrpipe.modelling.view_dependence.reflection.first_guess import corner_weights
from ibrpipe.modelling.view_dependence.reflection.fit import FitRules, neighbours, polish, reflect_itself
from ibrpipe.modelling.view_dependence.reflection.observations import Observations, look_again
from ibrpipe.progress import track
from ibrpipe.renderers.view_dependence.mirror import Surface
from ibrpipe.renderers.view_dependence.reflection import Model
from ibrpipe.types import Array

#: rounds of turning all normals and going on with the fit
ROUNDS = 3
#: rounds of averaging with the four neighbours: of the normals before the first step, and of what each step asks for
EVEN, REACH = 6, 20
#: half the difference by which derivatives are measured, and the longest step, radians
DIFFERENCE, LONGEST = np.radians(0.6), np.radians(4.0)
#: added to what observations know of a normal, against the mean sample
DAMPING = 0.1
#: dB that the first step must bring photos that it does not know
WORTH = 0.05
#: every so manieth observation judges the first step
JUDGED_EVERY = 4
#: observations at once
_AT_ONCE = 1 << 18
#: the six different numbers of a symmetric matrix
_ROW, _COLUMN = np.triu_indices(3)


def refine_normals(model: Model, seen: Observations, surface: Surface, centers: Array, rules: FitRules) -> Surface:
    """Turn normals toward what the photos show, if that brings photos nearer that are left out; the model goes along.

    Parameters
    ----------
    model : Model
        Fitted to the observations; changed in place where normals are.
    seen : Observations
    surface : Surface
    centers : (P, 3) float64, world, of the photos' eyes

    Returns
    -------
    Surface
        With new normals, or the very one that was given.
    """
    near = _averaging(surface)
    turned = replace(surface, normals=_unit(_spread(near, surface.normals.astype(np.float64), EVEN)))
    some = seen.subset(np.arange(0, len(seen.where), JUDGED_EVERY))
    if len(centers) < HELD_OUT_EVERY or _gain(model, some, surface, turned, near, centers, rules) < WORTH:
        return surface
    seen = look_again(seen, turned, centers, model.size)
    for _ in track(range(ROUNDS), "normals"):
        turned = _turn(model, seen, turned, near, rules)
        seen = look_again(seen, turned, centers, model.size)
        polish(model, seen, surface.corners, rules)
    return turned


def _gain(
    model: Model, seen: Observations, old: Surface, new: Surface, near: csr_array, centers: Array, rules: FitRules
) -> float:
    """How much nearer, dB, left-out photos are with one step of the others from the normals of `new`."""
    left_out = held_out_photos(len(centers))
    kept, tested = seen.of_photos(~left_out), seen.of_photos(left_out)
    turned = _turn(model, look_again(kept, new, centers, model.size), new, near, rules)
    after = held_out_psnr(model, look_again(tested, turned, centers, model.size), old.corners)
    return after - held_out_psnr(model, tested, old.corners)


def _turn(model: Model, seen: Observations, surface: Surface, near: csr_array, rules: FitRules) -> Surface:
    """One damped step of all normals at right angles to themselves."""
    reflect_itself(model, seen, surface.corners)
    known, wanted = _what_is_asked(model, seen, surface, rules.bend)
    known, wanted = _spread(near, known, REACH), _spread(near, wanted, REACH)
    normals = surface.normals.astype(np.float64)
    matrix = np.empty((len(normals), 3, 3))
    matrix[:, _ROW, _COLUMN], matrix[:, _COLUMN, _ROW] = known, known
    little = DAMPING * float(np.trace(matrix, axis1=1, axis2=2).mean()) / 2 + 1e-12
    step = np.linalg.solve(matrix + little * np.eye(3), wanted[..., None])[..., 0]
    step -= (step * normals).sum(axis=1, keepdims=True) * normals
    step *= np.minimum(1.0, LONGEST / np.maximum(np.linalg.norm(step, axis=1, keepdims=True), 1e-12))
    return replace(surface, normals=_unit(normals + np.nan_to_num(step)))


def _what_is_asked(model: Model, seen: Observations, surface: Surface, bend: float) -> tuple[Array, Array]:
    """Sums over each sample's observations: J J^T (S, 6), J e (S, 3); J = d root of light / d normal, error e."""
    count = len(surface.normals)
    known, wanted = np.zeros((count, 6)), np.zeros((count, 3))
    for part in _parts(seen):
        slopes, errors, weight = _derivatives(model, part, surface, bend)
        asked = np.einsum("ncd,nc->nd", slopes, errors * weight)
        square = np.einsum("nci,ncj->nij", slopes * weight[..., None], slopes)[:, _ROW, _COLUMN]
        corners, shares = surface.corners[part.where[:, 0]], corner_weights(part, surface.corners)
        for c in range(corners.shape[1]):
            own = np.flatnonzero(shares[:, c] > 0)
            for total, each in ((known, square), (wanted, asked)):
                for k in range(total.shape[1]):
                    total[:, k] += np.bincount(corners[own, c], shares[own, c] * each[own, k], count)
    return known, wanted


def _derivatives(model: Model, seen: Observations, surface: Surface, bend: float) -> tuple[Array, Array, Array]:
    """D root of light / d normal (N, 3, 3) by channel, errors (N, 3), weights (N, 3) under Huber's loss."""
    corners = surface.corners
    shares = corner_weights(seen, corners)[..., None]
    normals = _unit((shares * surface.normals[corners[seen.where[:, 0]]]).sum(axis=1), np.float64)
    eye = _unit(seen.toward, np.float64)
    axis = np.eye(3)[np.abs(normals).argmin(axis=1)]
    first = _unit(np.cross(normals, axis), np.float64)
    slopes = np.zeros((len(normals), 3, 3))
    for tangent in (first, np.cross(normals, first)):
        ends = [_roots(model, seen, corners, normals + side * DIFFERENCE * tangent, eye) for side in (1.0, -1.0)]
        slopes += ((ends[0] - ends[1]) / (2 * DIFFERENCE))[..., None] * tangent[:, None]
    observed = seen.traits[:, 6:9].astype(np.float64)
    errors = np.abs(observed) - _roots(model, seen, corners, normals, eye)
    weight = seen.traits[:, 5:6] * np.minimum(1.0, bend / np.maximum(np.abs(errors), 1e-9))
    usable = np.isfinite(slopes).all(axis=2) & np.isfinite(errors) & ~((observed < 0) & (errors < 0))
    return np.nan_to_num(slopes), np.nan_to_num(errors), np.where(usable, weight, 0.0)


def _roots(model: Model, seen: Observations, corners: Array, normals: Array, eye: Array) -> Array:
    """Square roots of light (N, 3) float64 of observations as if their normals (N, 3) were others."""
    where, traits, reflected = seen.where.copy(), seen.traits.copy(), np.empty((len(normals), 3))
    reflect(_unit(normals, np.float64), eye, model.size, where, traits, reflected)
    return np.sqrt(np.maximum(model.colors(where, traits, corners), 0.0).astype(np.float64) + DARK)


def _parts(seen: Observations) -> Iterator[Observations]:
    for first in range(0, len(seen.where), _AT_ONCE):
        yield seen.subset(np.arange(first, min(first + _AT_ONCE, len(seen.where))))


def _averaging(surface: Surface) -> csr_array:
    """(S, S) mean of a sample and its neighbours in the patches."""
    near = neighbours(surface.corners, len(surface.normals)) + diags_array(np.ones(len(surface.normals)))
    return csr_array(diags_array(1.0 / near.sum(axis=1)) @ near)


def _spread(near: csr_array, values: Array, rounds: int) -> Array:
    for _ in range(rounds):
        values = near @ values
    return values


def _unit(vectors: Array, kind: type = np.float32) -> Array:
    vectors = vectors.astype(np.float64)
    return np.ascontiguousarray(vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-12), kind)
