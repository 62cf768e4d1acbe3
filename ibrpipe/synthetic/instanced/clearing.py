"""A captured asset on a lawn in a clearing of a forest: everything in one scene (max1999, sec. 5)."""

from __future__ import annotations

import math

import numpy as np

from ibrpipe.errors import ValueRangeError
from ibrpipe.synthetic.instanced.pieces import folded_leaf, joined, moved, placed, turned
from ibrpipe.types import Array, Asset, Instances, Mesh, PaintedMesh, Part, Scene

GRASS = (0.08, 0.17, 0.03)
#: metres between the asset and the nearest trees, and tufts of grass on a square metre
_FREE, _TUFTS = 7.0, 25.0


def clearing(wood: Scene, asset: Asset, height: float = 3.0, seed: int = 5) -> Scene:
    """Return a forest with a clearing in its middle, a lawn in it, and a captured asset on the lawn.

    Parameters
    ----------
    wood : Scene
        As `forest` returns it.
    asset : Asset
        z up.
    height : float
        Of the asset, metres.
    seed : int
        Of the lawn.
    """
    low, high = asset.bounds
    if not (height > 0 and high[2] > low[2]):
        raise ValueRangeError(
            f"the asset is {high[2] - low[2]:g} high and shall be {height:g} m; both must be positive"
        )
    scale = height / (high[2] - low[2])
    radius = 0.5 * scale * float(np.hypot(*(high - low)[:2])) + _FREE
    middle = 0.5 * (low + high)
    stand = placed(-scale * np.array([middle[0], middle[1], low[2]]) + (0, 0, 0.02), None, scale)
    root = wood.parts[wood.root]
    trees: dict[str, list[Array]] = {}
    for planted in root.children:
        _add_outside(trees, wood, planted.part, planted.matrices, radius)
    rng = np.random.default_rng((seed, 3))
    added = [Part("grass", (_tuft(rng),)), Part("captured", sources=(asset,))]
    copies = (Instances("grass", _lawn(radius, rng)), Instances("captured", stand))
    ground = (*root.meshes, _disc(radius))
    rest = [part for part in wood.parts.values() if part is not root]
    left = (Instances(name, np.concatenate(matrices)) for name, matrices in trees.items())
    return Scene([*rest, *added, Part(root.name, ground, children=(*left, *copies))], wood.root, wood.lighting)


def _add_outside(trees: dict[str, list[Array]], wood: Scene, name: str, matrices: Array, radius: float) -> None:
    """Add copies (N, 4, 4) of a part that stand outside; cells and groves that reach inside are taken apart."""
    part, box = wood.parts[name], wood.bounds[name]
    group = not part.meshes
    reach = float(np.hypot(*np.maximum(np.abs(box.low), np.abs(box.high))[:2])) if group else 0.0
    outside = np.hypot(matrices[:, 0, 3], matrices[:, 1, 3]) > radius + reach
    trees.setdefault(name, []).append(matrices[outside])
    for copies in part.children if group else ():
        moved = np.einsum("nij,mjk->nmik", matrices[~outside], copies.matrices).reshape(-1, 4, 4)
        _add_outside(trees, wood, copies.part, moved, radius)


def _tuft(rng: np.random.Generator) -> PaintedMesh:
    """Nine blades that lean apart."""
    blades = []
    for n in range(9):
        pose = turned((0, 0, 1), 2.4 * n) @ turned((1, 0, 0), rng.uniform(0.1, 0.6))
        at = (rng.normal(0.0, 0.03), rng.normal(0.0, 0.03), -0.01)
        blades.append(moved(placed(at, pose), folded_leaf(rng.uniform(0.12, 0.3), 0.014, GRASS, rng)))
    return joined(blades)


def _lawn(radius: float, rng: np.random.Generator) -> Array:
    count = round(_TUFTS * math.pi * radius**2)
    far, around = radius * np.sqrt(rng.random(count)), rng.uniform(0, 2 * math.pi, count)
    turns, sizes = rng.uniform(0, 2 * math.pi, count), rng.uniform(0.6, 1.2, count)
    matrices = np.tile(np.eye(4), (count, 1, 1))
    cosine, sine = np.cos(turns) * sizes, np.sin(turns) * sizes
    matrices[:, 0, 0], matrices[:, 0, 1], matrices[:, 1, 0], matrices[:, 1, 1] = cosine, -sine, sine, cosine
    matrices[:, 2, 2] = sizes
    matrices[:, 0, 3], matrices[:, 1, 3] = far * np.cos(around), far * np.sin(around)
    return matrices


def _disc(radius: float, corners: int = 48) -> PaintedMesh:
    angles = 2 * math.pi * np.arange(corners) / corners
    ring = radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    vertices = np.concatenate([[(0.0, 0.0, 0.01)], np.column_stack([ring, np.full(corners, 0.01)])])
    here = np.arange(corners)
    faces = np.stack([np.zeros(corners, int), 1 + here, 1 + (here + 1) % corners], axis=1)
    return PaintedMesh(Mesh(vertices, faces), np.tile(0.7 * np.array(GRASS, np.float32), (corners + 1, 1)))
