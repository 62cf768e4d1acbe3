"""How long frames take: several ways timed in turn, in the same run, at the same size, with the same threads."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from statistics import median
from time import perf_counter

from ibrpipe.embree import MeshCaster
from ibrpipe.progress import track
from ibrpipe.types import Camera

#: called once per timed frame; made for one camera, so that what can be prepared is prepared outside the timer
Draw = Callable[[], object]


@dataclass(frozen=True)
class Way:
    """One way of making a frame.

    Attributes
    ----------
    prepare : callable
        ``prepare(camera)`` returns the function that is timed.
    repeats : int or None
        Fewer repeats for slow ways; None = as many as the others.
    """

    prepare: Callable[[Camera], Draw]
    repeats: int | None = None


def time_ways(ways: Mapping[str, Way], cameras: Sequence[Camera], repeats: int) -> dict[str, list[float]]:
    """Return the median milliseconds of every way for every camera.

    The ways take turns, so that a slow moment of the machine meets all of them. In each turn a way draws twice and the
    second frame is timed: its threads are then awake and its data warm, whatever ran before.
    """
    found: dict[str, list[float]] = {name: [] for name in ways}
    for camera in track(cameras, "timing"):
        draws = {name: way.prepare(camera) for name, way in ways.items()}
        taken: dict[str, list[float]] = {name: [] for name in ways}
        for turn in range(repeats):
            for name, draw in draws.items():
                if turn < (ways[name].repeats or repeats):
                    taken[name].append(_second_of_two(draw))
        for name, times in taken.items():
            found[name].append(median(times))
    return found


def timed_size(camera: Camera, width: int) -> Camera:
    """Return the camera with frames `width` pixels wide and of the same shape."""
    return camera.resized(width, max(1, round(camera.height * width / camera.width)))


def cast_alone(caster: MeshCaster) -> Way:
    """Embree's ray cast of the mesh through Open3D, rays laid out beforehand: hits only, nothing is coloured."""
    return Way(caster.prepared_cast)


def _second_of_two(draw: Draw) -> float:
    draw()
    began = perf_counter()
    draw()
    return 1e3 * (perf_counter() - began)
