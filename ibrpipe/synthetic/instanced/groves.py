"""Where trees stand: singly, in cells of 4 x 4 places, in groves of 4 x 4 cells; metres, z up.

Cells and groves are copies of few patterns, turned by quarters, so that a large forest is a hierarchy of as few
copies at every level as a tree is.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from ibrpipe.synthetic.instanced.pieces import placed, turned
from ibrpipe.types import Array, Instances, Part

SPACING = 7.0
#: places along a side of a cell and of a grove
CELL, GROVE = 4, 16
#: patterns of cells and of groves
_CELLS, _GROVES = 4, 3


def places_of_grid(first: tuple[int, int], side: int) -> Array:
    """(side * side, 2) int64: columns and rows of a square block of places, row by row."""
    numbers = np.arange(side * side)
    return np.stack([numbers % side, numbers // side], axis=1) + np.array(first)


def plant(places: Array, kinds: Sequence[str], rng: np.random.Generator) -> list[Instances]:
    """Trees of mixed kinds at places (N, 2) in units of the spacing: jittered, turned, leaning, of different sizes."""
    count = len(places)
    at = (places + rng.uniform(-0.35, 0.35, (count, 2))) * SPACING
    matrices = np.empty((count, 4, 4))
    for n, (x, y) in enumerate(at):
        pose = turned((0, 0, 1), rng.uniform(0, 2 * math.pi)) @ turned((1, 0, 0), rng.normal(0.0, 0.04))
        matrices[n] = placed((x, y, 0.0), pose, rng.uniform(0.75, 1.25))
    kind = rng.integers(0, len(kinds), count)
    return [Instances(name, matrices[kind == n]) for n, name in enumerate(kinds)]


def patterns(kinds: Sequence[str], seed: int) -> list[Part]:
    """The patterns of cells and groves, which are the same in all forests of a seed."""
    rng = np.random.default_rng((seed, 4))
    grid = places_of_grid((0, 0), CELL) - (CELL - 1) / 2
    cells = [Part(f"cell-{n}", children=tuple(plant(grid, kinds, rng))) for n in range(_CELLS)]
    blocks = CELL * (places_of_grid((0, 0), GROVE // CELL) - (GROVE // CELL - 1) / 2)
    return [*cells, *(Part(f"grove-{n}", children=tuple(_spread("cell", _CELLS, blocks, rng))) for n in range(_GROVES))]


def plant_blocks(trees: int, side: int, rng: np.random.Generator) -> tuple[list[Instances], Array]:
    """Groves and cells of a square forest, and the places (N, 2) that are left for single trees.

    A forest that does not fill its square has gaps, which are among the places that are left.
    """
    inner = side if trees == side * side else side - 1
    cells, groves = inner // CELL * CELL, inner // GROVE * GROVE
    middle = (side - 1) / 2
    large = GROVE * places_of_grid((0, 0), groves // GROVE)
    small = CELL * places_of_grid((0, 0), cells // CELL)
    small = small[small.max(axis=1) >= groves]
    single = places_of_grid((0, 0), side)
    copies = _spread("grove", _GROVES, large + (GROVE - 1) / 2 - middle, rng)
    copies += _spread("cell", _CELLS, small + (CELL - 1) / 2 - middle, rng)
    return copies, single[single.max(axis=1) >= cells]


def _spread(kind: str, count: int, places: Array, rng: np.random.Generator) -> list[Instances]:
    """Copies of the patterns ``KIND-0`` to ``KIND-(count - 1)``, mixed at random, turned by quarters."""
    which, quarters = rng.integers(0, count, len(places)), rng.integers(0, 4, len(places))
    matrices = np.zeros((len(places), 4, 4))
    for n, (x, y) in enumerate(SPACING * places):
        matrices[n] = placed((x, y, 0.0), turned((0, 0, 1), 0.5 * math.pi * quarters[n]))
    return [Instances(f"{kind}-{n}", matrices[which == n]) for n in range(count) if (which == n).any()]
