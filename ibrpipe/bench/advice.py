"""Which renderer to use when, drawn from the scores: the fastest that meets a demand on the error."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from ibrpipe.bench.speed_results import Choice, Score, WorkFacts


@dataclass(frozen=True)
class Need:
    """A demand on the error.

    Attributes
    ----------
    words : str
    met : callable
        From a score and the least colour error of all in that view to whether it is met.
    picture : bool
        Colour is wanted: times are those of colour and depth, and peers that look up none do not count.
    """

    words: str
    met: Callable[[Score, float], bool]
    picture: bool


NEEDS = (
    Need(
        "Exact depth: at most 0.01 % wrong pixels, 0.001 texels rms",
        lambda score, _: score.wrong <= 1e-4 and score.rmse <= 1e-3,
        False,
    ),
    Need(
        "Depth to a tenth of a texel: at most 2 % wrong pixels, 0.1 texels rms",
        lambda score, _: score.wrong <= 0.02 and score.rmse <= 0.1,
        False,
    ),
    Need(
        "A picture as good as any: colour error within 10 % of the least",
        lambda score, least: score.codes is not None and score.codes <= 1.1 * least,
        True,
    ),
    Need(
        "A picture to look at: colour error at most twice the least",
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
        need=need.words,
        work=work,
        view=view,
        winner=fit[0][1] if fit else None,
        milliseconds=fit[0][0] if fit else None,
        second=fit[1][1] if len(fit) > 1 else None,
        ratio=fit[1][0] / fit[0][0] if len(fit) > 1 else None,
    )


def _time(score: Score, need: Need) -> float:
    timing = score.both if need.picture else score.depth
    return timing.milliseconds if timing else float("inf")
