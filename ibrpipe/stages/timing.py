"""How long frames take: several ways timed in turn, in the same run, at the same size, with the same threads."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from statistics import median
from time import perf_counter

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
