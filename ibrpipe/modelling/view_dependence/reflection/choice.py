"""How many tables a surface needs: none where it is matt, one for a coat, two where some of it is metal."""

from __future__ import annotations

import numpy as np

from ibrpipe.core.color import srgb_encode
from ibrpipe.modelling.view_dependence.reflection.first_guess import guess
from ibrpipe.modelling.view_dependence.reflection.fit import FitRules, fit, reflect_itself
from ibrpipe.modelling.view_dependence.reflection.observations import Observations
from ibrpipe.renderers.view_dependence.mirror import Surface
from ibrpipe.renderers.view_dependence.reflection import Model
from ibrpipe.types import Array

#: every so manieth photo is left out for measuring
HELD_OUT_EVERY = 8
#: what fewer tables are forgiven, dB, by their number
BONUS = (0.10, 0.05, 0.0)


def choose_tables(
    observations: Observations, surface: Surface, points: Array, photos: int, rules: FitRules
) -> tuple[int, list[float]]:
    """Choose 0, 1 or 2 tables by photos that are left out of the fit.

    Parameters
    ----------
    observations : Observations
    points : (S, 3) float64, world, of all samples
    photos : int
        How many there are.

    Returns
    -------
    tables : int
    psnr : list of float
        Of the photos left out, dB, with 0, 1 and 2 tables, as far as more were worth a try; empty where there are too
        few photos to leave some out.
    """
    if photos < 2 * HELD_OUT_EVERY:
        return 1, []
    held_out = held_out_photos(photos)
    kept, tested = observations.of_photos(~held_out), observations.of_photos(held_out)
    first = guess(kept, surface, points)
    psnr: list[float] = []
    for tables in range(len(BONUS)):
        model = fit(kept, surface.corners, first, tables, rules)
        psnr.append(held_out_psnr(model, tested, surface.corners))
        if int(np.argmax(np.add(psnr, BONUS[: len(psnr)]))) < tables:
            break  # what one table does not mend, a second does not either
    return int(np.argmax(np.add(psnr, BONUS[: len(psnr)]))), psnr


def held_out_photos(photos: int) -> Array:
    """(P,) bool, the photos that are left out for measuring."""
    return np.arange(photos) % HELD_OUT_EVERY == HELD_OUT_EVERY // 2


def held_out_psnr(model: Model, observations: Observations, corners: Array) -> float:
    """PSNR of observations under a model, dB in display code, each with its weight."""
    reflect_itself(model, observations, corners)
    color = model.colors(observations.where, observations.traits, corners)
    seen = observations.traits[:, 6:9].astype(np.float64) ** 2
    weight = np.where(np.isfinite(color[:, 0]), observations.traits[:, 5], 0.0)
    error = (srgb_encode(np.nan_to_num(color)) - srgb_encode(seen)) ** 2
    mean = float((weight * error.mean(axis=1)).sum() / max(float(weight.sum()), 1e-12))
    return float(-10 * np.log10(max(mean, 1e-10)))
