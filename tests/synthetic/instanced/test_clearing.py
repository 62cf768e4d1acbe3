"""Clearings in forests: no tree inside, none missing outside."""

from __future__ import annotations

import numpy as np
import pytest

from ibrpipe.synthetic.instanced.clearing import clearing
from ibrpipe.synthetic.instanced.forest import forest
from ibrpipe.types import Asset, Texture
from ibrpipe.types.camera import ParallelFrame
from ibrpipe.types.layers import single_layer


def places_of_trees(scene):
    """Where all trees stand, (N, 2), sorted."""
    placed = {scene.root: np.eye(4)[None]}
    found = []
    for name in reversed(list(scene.parts)):
        if name.endswith("-tree"):
            found.append(placed.get(name, np.zeros((0, 4, 4)))[:, :2, 3])
            continue
        for copies in scene.parts[name].children if name in placed else ():
            moved = (placed[name][:, None] @ copies.matrices).reshape(-1, 4, 4)
            placed[copies.part] = np.concatenate([placed.get(copies.part, np.zeros((0, 4, 4))), moved])
    places = np.concatenate(found)
    return places[np.lexsort(places.T)]


@pytest.mark.parametrize("trees", [30, 1100, 4000])
def test_no_tree_stands_in_a_clearing_and_none_is_missing_around_it(trees):
    frame = ParallelFrame(np.zeros(3), np.array([1.0, 0, 0]), np.array([0, 0, -1.0]), np.array([0, 1.0, 0]))
    layers = single_layer(frame, np.ones((6, 8), np.float32), np.full((6, 8, 3), 0.5, np.float32), observed=True)
    wood = forest(trees)
    scene = clearing(wood, Asset((Texture(layers),)), 2.0)
    names = [copies.part for copies in scene.parts["forest"].children]
    assert len(set(names)) == len(names)
    lawn = next(copies.matrices for copies in scene.parts["forest"].children if copies.part == "grass")
    radius = np.hypot(*lawn[:, :2, 3].T).max()
    before, left = places_of_trees(wood), places_of_trees(scene)
    assert len(before) == trees
    wanted = before[np.hypot(*before.T) > radius]
    assert 0 < len(before) - len(wanted) < 12
    np.testing.assert_allclose(left, wanted, atol=1e-9)
