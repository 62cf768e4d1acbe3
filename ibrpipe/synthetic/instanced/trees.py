"""Maple- and oak-like trees of five levels: leaf cluster, twig, branch, bough, tree; metres, z up.

A tree consists of 1,814 sub-objects and 29,872 triangles; of one species, every level knows a single part.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ibrpipe.synthetic.instanced.pieces import folded_leaf, joined, moved, placed, tapered_stem, turned
from ibrpipe.types import Array, Instances, PaintedMesh, Part

_GOLDEN = 2.39996
_LEAVES = 6


@dataclass(frozen=True)
class Species:
    """What tells one kind of tree from another: colours (linear), leaves (metres), how branches spread (radians)."""

    leaf_color: tuple[float, float, float]
    bark_color: tuple[float, float, float]
    leaf: tuple[float, float]
    spread: float
    stretch: float


@dataclass(frozen=True)
class _Level:
    """One level: length and radii of its stem in metres, its sides, copies of the level below and where they begin."""

    name: str
    length: float
    radii: tuple[float, float]
    sides: int
    copies: int
    first: float


SPECIES = {
    "maple": Species((0.10, 0.28, 0.04), (0.20, 0.13, 0.08), (0.20, 0.16), 0.85, 1.0),
    "oak": Species((0.20, 0.26, 0.06), (0.14, 0.11, 0.08), (0.17, 0.12), 1.15, 0.92),
}

_LEVELS = (
    _Level("twig", 0.75, (0.014, 0.007), 4, 6, 0.35),
    _Level("branch", 1.5, (0.03, 0.014), 6, 6, 0.35),
    _Level("bough", 2.9, (0.07, 0.03), 8, 6, 0.35),
    _Level("tree", 3.6, (0.20, 0.10), 12, 7, 0.55),
)


def tree(kind: str, seed: int = 1) -> list[Part]:
    """Return the parts of a tree, leaf cluster first; the last, called ``KIND-tree``, is the tree."""
    rng = np.random.default_rng(seed)
    species = SPECIES[kind]
    parts = [Part(f"{kind}-cluster", (joined(_cluster(species, rng)),))]
    for level in _LEVELS:
        stretch = 1.0 if level.name == "tree" else species.stretch
        length = level.length * stretch
        wood = tapered_stem(length, level.radii, level.sides, species.bark_color, 0.03 * length, rng)
        matrices = np.stack([_growth(level, species, length, n, rng) for n in range(level.copies)])
        parts.append(Part(f"{kind}-{level.name}", (wood,), children=(Instances(parts[-1].name, matrices),)))
    return parts


def _cluster(species: Species, rng: np.random.Generator) -> list[PaintedMesh]:
    pieces = [tapered_stem(0.26, (0.008, 0.004), 3, species.bark_color, 0.01, rng)]
    for n in range(_LEAVES):
        pose = turned((0, 0, 1), n * 2.4) @ turned((1, 0, 0), rng.uniform(0.5, 1.4))
        pose = pose @ turned((0, 0, 1), rng.normal(0.0, 0.6))
        leaf = folded_leaf(*species.leaf, species.leaf_color, rng)
        pieces.append(moved(placed((0.01, 0.0, 0.07 + 0.036 * n), pose), leaf))
    return pieces


def _growth(level: _Level, species: Species, length: float, number: int, rng: np.random.Generator) -> Array:
    """Where one copy of the level below grows: along the stem, round it by the golden angle, the last one upwards."""
    along = level.first + (1 - level.first) * (number + 1) / level.copies
    lean = 0.1 if number == level.copies - 1 else species.spread * (1.15 - 0.45 * along) + rng.normal(0.0, 0.1)
    pose = turned((0, 0, 1), number * _GOLDEN + rng.normal(0.0, 0.2)) @ turned((1, 0, 0), lean)
    pose = pose @ turned((0, 0, 1), rng.uniform(0.0, 2 * np.pi))
    scale = (1.12 - 0.35 * along) * rng.uniform(0.9, 1.1)
    return placed((0.03 * length * along, 0.0, length * along), pose, scale)
