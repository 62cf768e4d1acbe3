"""Forests: trees on a jittered grid over a square ground, and the cameras that look at them."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from ibrpipe.errors import ValueRangeError
from ibrpipe.synthetic.instanced.groves import SPACING, patterns, places_of_grid, plant, plant_blocks
from ibrpipe.synthetic.instanced.pieces import painted_ground
from ibrpipe.synthetic.instanced.trees import SPECIES, tree
from ibrpipe.types import Camera, Instances, Part, Scene

GROUND = (0.22, 0.20, 0.12)
#: trees up to which all are copies of the root
FLAT = 1024

#: names of the cameras of `forest_cameras`
VIEWS = ("far", "middle", "near")


def forest(trees: int, seed: int = 5, species: Sequence[str] = tuple(SPECIES)) -> Scene:
    """Return a forest, metres, z up; its root is called ``forest``, the ground is a mesh of the root.

    Parameters
    ----------
    trees : int
        On a square grid 7 m wide, jittered, with random yaw, size (0.75 to 1.25) and a slight lean. More than 1,024
        stand in groves of 16 x 16 places and cells of 4 x 4, copies of few patterns, and singly at the border.
    seed : int
        Of the layout and of the trees' shapes.
    species : names of `SPECIES`
        Mixed at random.
    """
    if trees < 1:
        raise ValueRangeError(f"a forest of {trees} trees; give at least 1")
    rng = np.random.default_rng((seed, 1))
    side = grid_side(trees)
    parts = [part for n, name in enumerate(species) for part in tree(name, (11 + n + 1000 * (seed - 5)) % 2**32)]
    kinds = [f"{name}-tree" for name in species]
    grid = places_of_grid((0, 0), side)
    copies: list[Instances] = []
    if trees > FLAT:
        parts += patterns(kinds, seed)
        copies, grid = plant_blocks(trees, side, rng)
    gaps = side * side - trees
    chosen = grid[rng.permutation(len(grid))[: len(grid) - gaps]]
    copies = [*plant(chosen - (side - 1) / 2, kinds, rng), *copies]
    ground = painted_ground(10 * side * SPACING, GROUND)
    return Scene([*parts, Part("forest", (ground,), children=tuple(copies))], "forest")


def grid_side(trees: int) -> int:
    """Number of grid cells along one side of a forest."""
    return math.isqrt(trees - 1) + 1


def forest_cameras(trees: int, width: int = 640, height: int = 480) -> dict[str, Camera]:
    """Return cameras by name: far (all of the forest), middle (over its edge), near (a walker among the trees)."""
    side = grid_side(trees) * SPACING
    places = {
        "far": ((0, -1.05 * side, 0.55 * side + 10), (0, -0.04 * side, 0)),
        "middle": ((0, -side / 2 - 18, 16), (0, -side / 2 + 30, 3)),
        "near": ((3.5, -0.18 * side, 1.8), (4.5, 0, 2.6)),
    }
    return {
        name: Camera.look_at(eye, at, fov_y_deg=47.0, width=width, height=height) for name, (eye, at) in places.items()
    }
