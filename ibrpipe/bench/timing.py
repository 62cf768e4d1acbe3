"""Interleaved timing: all take turns, so that a slow moment of the machine meets every one of them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from time import perf_counter

import numpy as np


@dataclass(frozen=True)
class Times:
    """Milliseconds of one frame.

    Attributes
    ----------
    median, low, high, fastest : float
        Median, quartiles and least of the timed frames.
    count : int
        Timed frames.
    """

    median: float
    low: float
    high: float
    fastest: float
    count: int


def interleave(draws: Mapping[str, Callable[[], object]], repeats: int, seconds: float) -> dict[str, Times]:
    """Time all of `draws` in turns.

    In each turn everyone draws twice and the second frame counts: its threads are awake and its data warm. Who has used
    up an equal share of `seconds` leaves its further turns out; everyone has at least two.

    Parameters
    ----------
    draws : mapping of name to callable
    repeats : int
        Turns.
    seconds : float
        Of all timing together.
    """
    share = seconds / max(1, len(draws))
    taken: dict[str, list[float]] = {name: [] for name in draws}
    for draw in draws.values():
        draw()
    spent = dict.fromkeys(draws, 0.0)
    for _ in range(repeats):
        for name, draw in draws.items():
            if len(taken[name]) >= 2 and spent[name] > share:
                continue
            first = perf_counter()
            draw()
            began = perf_counter()
            draw()
            ended = perf_counter()
            taken[name].append(1e3 * (ended - began))
            spent[name] += ended - first
    return {name: _times(values) for name, values in taken.items()}


def _times(values: list[float]) -> Times:
    low, middle, high = np.percentile(values, (25, 50, 75))
    return Times(float(middle), float(low), float(high), min(values), len(values))


def slope(sizes: list[int], milliseconds: list[float]) -> float | None:
    """Return the exponent p of time ~ n^p by least squares of the logarithms; None for fewer than two sizes."""
    if len(sizes) < 2:
        return None
    return float(np.polyfit(np.log(sizes), np.log(milliseconds), 1)[0])
