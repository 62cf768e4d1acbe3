"""Ways to code an asset, part by part: ladders of levels from exact to coarse, one for each part."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from ibrpipe.io.layer_pictures import LOSSLESS, Coding
from ibrpipe.types import Reflection


@dataclass(frozen=True)
class CodingStep:
    """One way to code an asset.

    Attributes
    ----------
    layers : Coding
        Of the layers.
    components : int or None
        Quality of view dependence, 1 to 99; None = its files are kept as they are.
    weights : int or None
        Quality of the weights of shared reflection, 1 to 99; None = their files are kept as they are.
    """

    layers: Coding = field(default=LOSSLESS)
    components: int | None = None
    weights: int | None = None

    def quality_of(self, kind: str) -> int | None:
        """Return the quality of a kind of view dependence; None = its files are kept."""
        return self.weights if kind == Reflection.kind else self.components


#: fields of `Coding`, or "components" or "weights"; nothing = exact
Level = Mapping[str, Any]


def _qualities(name: str, *values: int) -> tuple[Level, ...]:
    return ({}, *({name: value} for value in values))


#: levels of every part, from exact to coarse
LADDERS: Mapping[str, tuple[Level, ...]] = {
    "color": _qualities(
        "color_quality", 100, 99, 98, 97, 96, 92, 88, 84, 80, 75, 70, 65, 60, 55, 50, 45, 40, 35, 30, 24, 18
    ),
    "depth": ({}, *({"depth_step": 2.0**-power} for power in (4, 3, 2, 1, 0))),
    "normal": _qualities("normal_quality", 95, 90, 85, 80, 75, 70, 65, 60, 55, 50, 40, 30),
    "weights": _qualities("weights", 90, 70, 60, 50, 40, 30, 25, 20, 15, 10, 5),
    "components": _qualities("components", 90, 80, 70, 60, 50, 42, 35, 28, 22, 16, 11, 7, 4),
}

#: levels that are coded and measured; what lies between and beyond is told by them
ANCHORS: Mapping[str, tuple[int, ...]] = {
    "color": (9, 15),
    "depth": (3, 4, 5),
    "normal": (7,),
    "weights": (6,),
    "components": (4, 8),
}
#: factors of bytes and of errors from a level to the next, where one is measured
FACTORS: Mapping[str, tuple[float, float]] = {"normal": (0.88, 1.17), "weights": (0.75, 1.6)}


def step_of(levels: Sequence[Level]) -> CodingStep:
    """Return the step that takes a level of every part."""
    given = {name: value for level in levels for name, value in level.items()}
    of_parts = {name: given.pop(name, None) for name in ("components", "weights")}
    return CodingStep(Coding(**given), **of_parts)
