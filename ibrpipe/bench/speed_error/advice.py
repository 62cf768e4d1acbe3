"""Which renderer to use when, drawn from the scores: the fastest that meets a demand on the error."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import exp, log
from statistics import fmean

from ibrpipe.bench.speed_error.results import Choice, Score, WorkFacts


@dataclass(frozen=True)
class Need:
    """A demand on the error.

    Attributes
    ----------
    title, words : str
        In two or three words, and what it means.
    met : callable
        From a score and the least colour error of all in that view to whether it is met.
    picture : bool
        Colour is wanted: times are those of colour and depth, and peers that look up none do not count.
    """

    title: str
    words: str
    met: Callable[[Score, float], bool]
    picture: bool


NEEDS = (
    Need(
        "Exact depth",
        "at most 0.01 % wrong pixels, 0.001 texels rms",
        lambda score, _: score.wrong <= 1e-4 and score.rmse <= 1e-3,
        False,
    ),
    Need(
        "Depth to a tenth of a texel",
        "at most 2 % wrong pixels, 0.1 texels rms",
        lambda score, _: score.wrong <= 0.02 and score.rmse <= 0.1,
        False,
    ),
    Need(
        "A picture as good as any",
        "colour error within 10 % of the least",
        lambda score, least: score.codes is not None and score.codes <= 1.1 * least,
        True,
    ),
    Need(
        "A picture to look at",
        "colour error at most twice the least",
        lambda score, least: score.codes is not None and score.codes <= 2.0 * least,
        True,
    ),
)
#: peers whose frames hold no colour of their own
COLOURLESS = ("Embree",)


def choose_winners(scores: Sequence[Score], works: Sequence[WorkFacts]) -> list[Choice]:
    """Return, for every need, thing and view, the fastest contender that meets it, and the next."""
    found = []
    for need in NEEDS:
        for work in works:
            for view in work.views:
                mine = [score for score in scores if score.work == work.name and score.view == view]
                found.append(_choice(need, work.name, view, mine))
    return found


def _choice(need: Need, work: str, view: str, scores: Sequence[Score]) -> Choice:
    if need.picture:
        scores = [score for score in scores if score.contender not in COLOURLESS]
    least = min((score.codes for score in scores if score.codes is not None), default=0.0)
    fit = sorted((_time(score, need), score.contender) for score in scores if need.met(score, least))
    fit = [item for item in fit if item[0] < float("inf")]
    return Choice(
        need=f"{need.title}: {need.words}",
        work=work,
        view=view,
        winner=fit[0][1] if fit else None,
        milliseconds=fit[0][0] if fit else None,
        second=fit[1][1] if len(fit) > 1 else None,
        ratio=fit[1][0] / fit[0][0] if len(fit) > 1 else None,
    )


@dataclass(frozen=True)
class Advice:
    """Who to use for one thing under one demand: the fastest of those that meet it in every view.

    Attributes
    ----------
    need : Need
    work : str
    winner : str or None
        Label; None = nobody meets the demand in every view.
    milliseconds : float
        Geometric mean over the views.
    scores : tuple of Score
        Its scores, view by view.
    second : str or None
    ratio : float
        Time of the second over that of the winner.
    """

    need: Need
    work: str
    winner: str | None
    milliseconds: float = 0.0
    scores: tuple[Score, ...] = ()
    second: str | None = None
    ratio: float = 0.0


def advise(need: Need, work: WorkFacts, scores: Sequence[Score]) -> Advice:
    """Return the fastest contender that meets a demand in every view of a thing, and the next."""
    by_view = [[s for s in scores if (s.work, s.view) == (work.name, view)] for view in work.views]
    if need.picture:
        by_view = [[s for s in mine if s.contender not in COLOURLESS] for mine in by_view]
    least = [min((s.codes for s in mine if s.codes is not None), default=0.0) for mine in by_view]
    found: dict[str, list[Score]] = {}
    for mine, best in zip(by_view, least, strict=True):
        for score in mine:
            if need.met(score, best) and _time(score, need) < float("inf"):
                found.setdefault(score.contender, []).append(score)
    times = {
        name: exp(fmean(log(_time(score, need)) for score in met))
        for name, met in found.items()
        if len(met) == len(work.views)
    }
    order = sorted(times, key=lambda name: times[name])
    if not order:
        return Advice(need, work.name, None)
    second = order[1] if len(order) > 1 else None
    ratio = times[second] / times[order[0]] if second else 0.0
    return Advice(need, work.name, order[0], times[order[0]], tuple(found[order[0]]), second, ratio)


def _time(score: Score, need: Need) -> float:
    timing = score.both if need.picture else score.depth
    return timing.milliseconds if timing else float("inf")
