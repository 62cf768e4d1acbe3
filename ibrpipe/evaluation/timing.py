"""How long frames take: several methods timed in turn, in the same run, at the same size, with the same threads."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from time import perf_counter

import numpy as np

from ibrpipe.progress import track
from ibrpipe.types import Camera

#: makes one frame
Draw = Callable[[], object]
#: a method of making frames: ``method(camera)`` prepares what can be prepared outside the timer
Method = Callable[[Camera], Draw]


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


def interleave(
    draws: Mapping[str, Draw],
    repeats: int,
    seconds: float = math.inf,
    least: int = 2,
    warm: bool = True,
    clock: Callable[[], float] | None = None,
) -> dict[str, Times]:
    """Time all of `draws` in rounds, so that a slow moment of the machine meets all of them.

    In each round everyone draws twice and the second frame counts: its threads are awake and its data warm,
    whatever ran before.

    Parameters
    ----------
    draws : mapping of name to callable
    repeats : int
        Rounds.
    seconds : float
        Of all timing together; who has used up an equal share leaves its further rounds out.
    least : int
        Rounds that everyone takes in any case.
    warm : bool
        Everyone draws once before the first round.
    clock : callable
        Tells seconds; of the wall if not given.
    """
    clock = clock or perf_counter
    share = seconds / max(1, len(draws))
    taken: dict[str, list[float]] = {name: [] for name in draws}
    if warm:
        for draw in draws.values():
            draw()
    spent = dict.fromkeys(draws, 0.0)
    for _ in range(repeats):
        for name, draw in draws.items():
            if len(taken[name]) >= least and spent[name] > share:
                continue
            first = clock()
            draw()
            began = clock()
            draw()
            ended = clock()
            taken[name].append(1e3 * (ended - began))
            spent[name] += ended - first
    return {name: _times(values) for name, values in taken.items()}


def time_methods(
    methods: Mapping[str, Method], cameras: Sequence[Camera], repeats: int, seconds: float = math.inf
) -> dict[str, list[float]]:
    """Return the median milliseconds of every method for every camera; `seconds` is shared by the cameras alike."""
    found: dict[str, list[float]] = {name: [] for name in methods}
    for camera in track(cameras, "timing"):
        draws = {name: method(camera) for name, method in methods.items()}
        for name, times in interleave(draws, repeats, seconds / len(cameras), least=1, warm=False).items():
            found[name].append(times.median)
    return found


def timed_size(camera: Camera, width: int) -> Camera:
    """Return the camera with frames `width` pixels wide and of the same shape."""
    return camera.resized(width, max(1, round(camera.height * width / camera.width)))


def _times(values: list[float]) -> Times:
    low, middle, high = np.percentile(values, (25, 50, 75))
    return Times(float(middle), float(low), float(high), min(values), len(values))


def slope(sizes: list[int], milliseconds: list[float]) -> float | None:
    """Return the exponent p of time ~ n^p by least squares of the logarithms; None for fewer than two sizes."""
    if len(sizes) < 2:
        return None
    return float(np.polyfit(np.log(sizes), np.log(milliseconds), 1)[0])
