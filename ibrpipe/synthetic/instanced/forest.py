"""Forests: trees on a jittered grid over a square ground, and the cameras that look at them."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from ibrpipe.errors import ValueRangeError
from ibrpipe.synthetic.instanced.pieces import painted_ground, placed, turned
from ibrpipe.synthetic.instanced.trees import SPECIES, tree
from ibrpipe.types import Camera, Instances, Part, Scene

SPACING = 7.0
GROUND = (0.22, 0.20, 0.12)

#: names of the cameras of `forest_cameras`
VIEWS = ("far", "middle", "near")


def forest(trees: int, seed: int = 5, species: Sequence[str] = tuple(SPECIES)) -> Scene:
    """Return a forest, metres, z up; its root is called ``forest``, the ground is a mesh of the root.

    Parameters
    ----------
    trees : int
        On a square grid 7 m wide, jittered, with random yaw, size (0.75 to 1.25) and a slight lean.
    seed : int
        Of the layout and of the trees' shapes.
    species : names of `SPECIES`
        Mixed at random.
    """
    if trees < 1:
        raise ValueRangeError(f"a forest of {trees} trees; give at least 1")
    rng = np.random.default_rng((seed, 1))
    side = grid_side(trees)
    cells = rng.permutation(side * side)[:trees]
    grid = np.stack([cells % side, cells // side], axis=1)
    places = (grid - (side - 1) / 2 + rng.uniform(-0.35, 0.35, (trees, 2))) * SPACING
    matrices = np.empty((trees, 4, 4))
    for n, (x, y) in enumerate(places):
        pose = turned((0, 0, 1), rng.uniform(0, 2 * math.pi)) @ turned((1, 0, 0), rng.normal(0.0, 0.04))
        matrices[n] = placed((x, y, 0.0), pose, rng.uniform(0.75, 1.25))
    kind = rng.integers(0, len(species), trees)
    parts, copies = [], []
    for n, name in enumerate(species):
        parts += tree(name, (11 + n + 1000 * (seed - 5)) % 2**32)
        copies.append(Instances(parts[-1].name, matrices[kind == n]))
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
