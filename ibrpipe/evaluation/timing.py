"""How long frames take: several ways timed in turn, in the same run, at the same size, with the same threads."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from statistics import median
from time import perf_counter

import numpy as np

from ibrpipe.progress import track
from ibrpipe.types import Camera

#: makes one frame
Draw = Callable[[], object]
#: one way of making frames: ``way(camera)`` prepares what can be prepared outside the timer
Way = Callable[[Camera], Draw]


def time_ways(
    ways: Mapping[str, Way], cameras: Sequence[Camera], repeats: int, seconds: float = math.inf
) -> dict[str, list[float]]:
    """Return the median milliseconds of every way for every camera.

    The ways take turns, so that a slow moment of the machine meets all of them. In each turn a way draws twice and the
    second frame is timed: its threads are then awake and its data warm, whatever ran before.

    Parameters
    ----------
    ways : mapping of name to way
    cameras : sequence of Camera
    repeats : int
        Turns for each camera.
    seconds : float
        Of all timing together; a way that has used up its equal share for a camera leaves its further turns out.
    """
    found: dict[str, list[float]] = {name: [] for name in ways}
    share = 1e3 * seconds / max(1, len(ways) * len(cameras))
    for camera in track(cameras, "timing"):
        draws = {name: way(camera) for name, way in ways.items()}
        taken: dict[str, list[float]] = {name: [] for name in ways}
        for _ in range(repeats):
            for name, draw in draws.items():
                if not taken[name] or 2.0 * sum(taken[name]) < share:
                    taken[name].append(_second_of_two(draw))
        for name, times in taken.items():
            found[name].append(median(times))
    return found


def timed_size(camera: Camera, width: int) -> Camera:
    """Return the camera with frames `width` pixels wide and of the same shape."""
    return camera.resized(width, max(1, round(camera.height * width / camera.width)))


def _second_of_two(draw: Draw) -> float:
    draw()
    began = perf_counter()
    draw()
    return 1e3 * (perf_counter() - began)


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
