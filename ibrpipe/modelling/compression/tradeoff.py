"""Which level of every part to take: bytes against error, each part where its last byte bought as much as the others'.

Errors of the parts are mean squares of the photos' colours that coding adds, and they add up; so do bytes. For every
price of a byte each part takes the level of least error plus price times bytes (Lagrange's multiplier, as everett1963
for separable choices): whatever such a choice weighs, no other one weighs less and errs less.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ibrpipe.modelling.compression.steps import LADDERS, CodingStep, Level, step_of
from ibrpipe.types import Array


@dataclass(frozen=True, eq=False)
class Curve:
    """What the levels of one part weigh and cost.

    Attributes
    ----------
    sizes : (N,) float64, bytes
    errors : (N,) float64, mean square that the level adds, of colours from 0 to 1
    """

    sizes: Array
    errors: Array


@dataclass(frozen=True)
class Choice:
    """A level of every part, with the bytes and the error that are expected of them together."""

    levels: Mapping[str, int]
    size: float
    error: float


def choices(curves: Mapping[str, Curve]) -> list[Choice]:
    """Return all choices that some price of a byte asks for, from fine to coarse."""
    found: dict[tuple[int, ...], Choice] = {}
    for price in sorted({0.0, *(price for curve in curves.values() for price in _prices(curve))}):
        levels = tuple(_best(curve, price) for curve in curves.values())
        pairs = list(zip(curves.values(), levels, strict=True))
        found.setdefault(
            levels,
            Choice(
                dict(zip(curves, levels, strict=True)),
                float(sum(curve.sizes[level] for curve, level in pairs)),
                float(sum(curve.errors[level] for curve, level in pairs)),
            ),
        )
    return list(found.values())


def finer_while_worth(ladder: Sequence[Choice], start: int, before: float, worth: float) -> int:
    """From a choice on take finer ones as long as what they bring is worth their bytes.

    Parameters
    ----------
    ladder : choices from fine to coarse
    start : index of the choice to begin with
    before : mean square without any coding
    worth : dB that a further byte must bring
    """
    index = start
    for finer in range(start - 1, -1, -1):
        square, better = (before + max(ladder[n].error, 0.0) for n in (index, finer))
        gain = 10 * float(np.log10(max(square, 1e-10) / max(better, 1e-10)))
        if gain < worth * (ladder[finer].size - ladder[index].size):
            break
        index = finer
    return index


def step_of_choice(choice: Choice, fixed: Mapping[str, Level]) -> CodingStep:
    """Return the step that a choice stands for; parts in `fixed` have the level stated there."""
    return step_of([fixed.get(name, LADDERS[name][level]) for name, level in choice.levels.items()])


def _best(curve: Curve, price: float) -> int:
    """Return the level of least error plus price, the coarsest of equals."""
    cost = curve.errors + price * curve.sizes
    return int(len(cost) - 1 - np.argmin(cost[::-1]))


def _prices(curve: Curve) -> list[float]:
    """Return the prices at which a part changes its level: the slopes of the lower hull of its curve."""
    order = np.lexsort((curve.errors, curve.sizes))
    hull: list[int] = []
    for level in order:
        while len(hull) > 1 and _slope(curve, hull[-2], hull[-1]) <= _slope(curve, hull[-1], int(level)):
            hull.pop()
        if not hull or curve.errors[level] < curve.errors[hull[-1]]:
            hull.append(int(level))
    return [_slope(curve, one, other) * (1 + 1e-9) for one, other in pairwise(hull)]


def _slope(curve: Curve, small: int, large: int) -> float:
    """Error that is saved for a byte from a small level to a large one."""
    more = max(float(curve.sizes[large] - curve.sizes[small]), 1e-9)
    return float(curve.errors[small] - curve.errors[large]) / more


def filled(count: int, levels: Sequence[int], values: Sequence[float], factor: float = 1.0) -> Array:
    """Interpolate what was measured at some levels of a ladder of so many.

    Parameters
    ----------
    levels, values : those that were measured, ascending, and what was measured, above 0
    factor : from level to level, where only one was measured

    Returns
    -------
    (count,) float64
        They change by a factor from level to level, beyond the measured ones, too.
    """
    x, known = np.arange(count, dtype=np.float64), np.asarray(levels, np.float64)
    logs = np.log(np.asarray(values, np.float64))
    if len(known) == 1:
        return np.exp(logs + np.log(factor) * (x - known))
    out = np.interp(x, known, logs)
    for end, inner in ((0, 1), (-1, -2)):
        slope = (logs[end] - logs[inner]) / (known[end] - known[inner])
        beyond = x < known[0] if end == 0 else x > known[-1]
        out[beyond] = logs[end] + slope * (x[beyond] - known[end])
    return np.exp(out)
