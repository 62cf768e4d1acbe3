"""A city of few blocks: houses of storeys of windows, blocks of houses, streets of blocks; metres, z up."""

from __future__ import annotations

import math

import numpy as np

from ibrpipe.errors import ValueRangeError
from ibrpipe.synthetic.instanced.pieces import joined, painted_box, painted_ground, placed, turned
from ibrpipe.types import Instances, Part, Scene

_BLOCK, _STREET = 60.0, 14.0
_WALLS = ((0.55, 0.42, 0.33), (0.60, 0.58, 0.52))


def city(blocks: int, seed: int = 5) -> Scene:
    """Return a city of `blocks` blocks on a square grid; its root is called ``city``. Two kinds of storey and house."""
    if blocks < 1:
        raise ValueRangeError(f"a city of {blocks} blocks; give at least 1")
    rng = np.random.default_rng((seed, 2))
    parts = [_window()]
    for n, color in enumerate(_WALLS):
        parts += [_storey(n, color), _house(n, 4 + 3 * n)]
    parts.append(_block(rng))
    side = math.isqrt(blocks - 1) + 1
    pitch = _BLOCK + _STREET
    matrices = []
    for n in range(blocks):
        at = ((n % side - (side - 1) / 2) * pitch, (n // side - (side - 1) / 2) * pitch, 0.0)
        matrices.append(placed(at, turned((0, 0, 1), 0.5 * math.pi * int(rng.integers(0, 4)))))
    ground = painted_ground(10 * side * pitch, (0.18, 0.18, 0.19))
    parts.append(Part("city", (ground,), children=(Instances("block", np.stack(matrices)),)))
    return Scene(parts, "city")


def _window() -> Part:
    """A window 1 m wide in its frame, in the plane y = 0, seen from negative y."""
    frame, glass = (0.75, 0.74, 0.70), (0.06, 0.08, 0.10)
    pieces = [
        painted_box((-0.6, -0.08, 0.0), (-0.5, 0.02, 1.5), frame),
        painted_box((0.5, -0.08, 0.0), (0.6, 0.02, 1.5), frame),
        painted_box((-0.6, -0.12, -0.1), (0.6, 0.02, 0.0), frame),
        painted_box((-0.6, -0.08, 1.5), (0.6, 0.02, 1.6), frame),
        painted_box((-0.03, -0.05, 0.0), (0.03, 0.0, 1.5), frame),
        painted_box((-0.5, -0.02, 0.0), (0.5, 0.0, 1.5), glass),
    ]
    return Part("window", (joined(pieces),))


def _storey(kind: int, color: tuple[float, float, float]) -> Part:
    """A storey 12 m square and 3 m high with windows all round."""
    walls = joined(
        [
            painted_box((-6.0, -6.0, 0.0), (6.0, 6.0, 2.8), color),
            painted_box((-6.15, -6.15, 2.8), (6.15, 6.15, 3.0), tuple(0.8 * each for each in color)),
        ]
    )
    count = 4 + kind
    along = (np.arange(count) - (count - 1) / 2) * 12.0 / count
    matrices = [
        placed(turn @ (x, -6.0, 0.8), turn)
        for turn in (turned((0, 0, 1), 0.5 * math.pi * n) for n in range(4))
        for x in along
    ]
    return Part(f"storey-{kind}", (walls,), children=(Instances("window", np.stack(matrices)),))


def _house(kind: int, storeys: int) -> Part:
    """Storeys upon each other and a roof."""
    roof = painted_box((-5.5, -5.5, 3.0 * storeys), (5.5, 5.5, 3.0 * storeys + 0.6), (0.25, 0.12, 0.09))
    matrices = np.stack([placed((0.0, 0.0, 3.0 * n)) for n in range(storeys)])
    return Part(f"house-{kind}", (roof,), children=(Instances(f"storey-{kind}", matrices),))


def _block(rng: np.random.Generator) -> Part:
    """Sixteen houses in a square, each a little different in width and height."""
    copies: list[list[np.ndarray]] = [[], []]
    for n in range(16):
        at = ((n % 4 - 1.5) * 15.0, (n // 4 - 1.5) * 15.0, 0.0)
        scale = np.array([rng.uniform(0.85, 1.1), rng.uniform(0.85, 1.1), rng.uniform(0.8, 1.5)])
        copies[int(rng.integers(0, 2))].append(placed(at, None, np.diag(scale) + 1.0 - np.eye(3)))
    yard = painted_box((-31.0, -31.0, -0.2), (31.0, 31.0, 0.15), (0.35, 0.34, 0.33))
    kinds = tuple(Instances(f"house-{kind}", np.stack(each)) for kind, each in enumerate(copies) if each)
    return Part("block", (yard,), children=kinds)
