"""What the rounds of depth estimation cost relative to each other, for the time that is left of the whole."""

from __future__ import annotations

from collections.abc import Sequence

from ibrpipe.io.views import View
from ibrpipe.progress import Part
from ibrpipe.reconstruction.depth.schedule import Pass, map_size, passes, shrunk_size
from ibrpipe.reconstruction.depth.settings import DepthConfig

#: seconds of two cores for a million pixels of maps: a sweep by the photos alone, the same by the neighbours' depth
#: too, reading and preparing, the test of agreement, a pair of photos; only their proportions matter
SWEEP, CONSISTENT, PREPARE, AGREE, PAIR = 1.75, 2.3, 0.3, 0.3, 0.1
PAIRS, AGREEMENT = "depth by pairs", "depth maps"


def rounds_of(views: Sequence[View], config: DepthConfig) -> tuple[Pass, ...]:
    """Rounds of PatchMatch over the views."""
    return passes(max(max(map_size(view.camera, config.max_size)) for view in views), config)


def label_of(order: Pass, rounds: Sequence[Pass]) -> str:
    """What progress calls a round."""
    return f"depth {order.number + 1}/{len(rounds)}"


def depth_parts(views: Sequence[View], config: DepthConfig) -> list[Part]:
    """Return the loops of the estimation, with what they cost."""
    full = megapixels(views, config.max_size, 1)
    agreement = Part(AGREEMENT, AGREE * full)
    if config.method == "sgbm":
        return [Part(PAIRS, (PAIR * config.pairs + PREPARE) * full), agreement]
    rounds = rounds_of(views, config)
    found = [
        Part(
            label_of(each, rounds),
            megapixels(views, config.max_size, each.shrink)
            * (PREPARE + each.sweeps * (CONSISTENT if each.consistent else SWEEP)),
        )
        for each in rounds
    ]
    return [*found, agreement]


def megapixels(views: Sequence[View], max_size: int, shrink: int) -> float:
    """Millions of pixels of all views' depth maps, made `shrink` times smaller."""
    sizes = (shrunk_size(*map_size(view.camera, max_size), shrink) for view in views)
    return sum(width * height for width, height in sizes) / 1e6
