"""Time against size: texels alone, texels and pixels together, and the latter for every region of the epipole."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from time import perf_counter

from ibrpipe.bench.settings import Setting
from ibrpipe.bench.sizes.results import GrowthModel
from ibrpipe.bench.speed_error.contenders import Contender, Ready, all_contenders
from ibrpipe.bench.speed_error.results import ContenderFacts, Growth, Score, WorkFacts
from ibrpipe.bench.speed_error.workloads import height_field, region_views
from ibrpipe.engine.machine import describe_machine
from ibrpipe.evaluation.timing import interleave, slope
from ibrpipe.progress import track

#: most frames from which the fastest is taken, in each of several rounds over all sizes: clock rates change in between
FRAMES, ROUNDS = 20, 5
#: greatest factor per doubling of both sizes that counts as O(n^2)
MOST = 4.6


def grow_texels(scores: Sequence[Score], works: Sequence[WorkFacts]) -> list[Growth]:
    """Return the curves of all contenders over the sizes of the height field, the picture staying as it is.

    The time of a size is the geometric mean over its views of the fastest frame, which a busy machine disturbs least.
    """
    fields = [work for work in works if work.kind == "height field"]
    curves = []
    for name in dict.fromkeys(score.contender for score in scores):
        sizes, times = [], []
        for work in fields:
            mine = [s.depth or s.both for s in scores if s.work == work.name and s.contender == name]
            taken = [timing.fastest for timing in mine if timing]
            if taken:
                sizes.append(work.n)
                times.append(math.exp(sum(map(math.log, taken)) / len(taken)))
        if sizes:
            curves.append(_curve("texels grow", name, sizes, times))
    return curves


def grow_both(contenders: Sequence[Contender], sizes: Sequence[int], seconds: float) -> list[Growth]:
    """Return the curves where the picture has as many pixels along a side as the field has texels."""
    return _grow(contenders, sizes, seconds, {"both grow": "within middle"})


def grow_regions(contenders: Sequence[Contender], sizes: Sequence[int], seconds: float) -> list[Growth]:
    """Return the same curves for the nine regions of the epipole; peers left out, whose time knows no epipole."""
    ours = [contender for contender in contenders if contender.renderer != "peer"]
    return _grow(ours, sizes, seconds, {f"epipole {name}": name for name in region_views(4)})


def run_growth(settings: Sequence[Setting], sizes: Sequence[int], seconds: float) -> GrowthModel:
    """Measure growth for each region of the epipole: the first setting of every renderer that is among `settings`."""
    began = perf_counter()
    ours = [each for each in all_contenders(settings, False) if each.renderer != "peer" and each.main]
    curves = grow_regions(ours, sizes, seconds)
    facts = [
        ContenderFacts(label=c.label, renderer=c.renderer, what=c.what, options=dict(c.options), main=c.main)
        for c in ours
    ]
    return GrowthModel(
        machine=describe_machine(), contenders=facts, growth=curves, most=MOST, seconds=perf_counter() - began
    )


def _grow(
    contenders: Sequence[Contender], sizes: Sequence[int], seconds: float, series: dict[str, str]
) -> list[Growth]:
    made = {n: _prepared(contenders, n) for n in sizes}
    best: dict[tuple[str, str], dict[int, list[float]]] = {}
    for _, n in track([(turn, n) for turn in range(ROUNDS) for n in sizes], "growth"):
        cameras = region_views(n)
        for name, region in series.items():
            draws = {label: each.depth(cameras[region]) for label, each in made[n].items() if each.depth}
            for label, taken in interleave(draws, FRAMES, seconds / ROUNDS).items():
                best.setdefault((name, label), {}).setdefault(n, []).append(taken.fastest)
    return [
        _curve(
            name, label, list(mine), [min(each) for each in mine.values()], [_spread(each) for each in mine.values()]
        )
        for (name, label), mine in best.items()
    ]


def _spread(times: Sequence[float]) -> float:
    """Return by how much the rounds differ: the range of all but the slowest over the least."""
    ordered = sorted(times)
    return (ordered[max(len(ordered) - 2, 0)] - ordered[0]) / ordered[0]


def _prepared(contenders: Sequence[Contender], n: int) -> dict[str, Ready]:
    work = height_field(n, 16)
    found = {c.label: c.make(work) for c in contenders if c.main}
    return {label: each for label, each in found.items() if each is not None and each.depth}


def _curve(series: str, contender: str, sizes: list[int], times: list[float], spread: Sequence[float] = ()) -> Growth:
    pairs = list(zip(sizes, times))
    doublings = [(b[1] / a[1]) ** (1.0 / math.log2(b[0] / a[0])) for a, b in pairwise(pairs)]
    return Growth(
        series=series,
        contender=contender,
        sizes=sizes,
        milliseconds=times,
        slope=slope(sizes, times),
        doublings=doublings,
        spread=list(spread),
    )
