"""A mesh prepared for rays travels to other processes and answers there as here."""

import pickle

import numpy as np

from ibrpipe.embree import MeshCaster
from ibrpipe.types import Mesh


def test_pickled_caster_gives_the_same_hits() -> None:
    vertices = np.array([[1e6, 0, 0], [1e6 + 1, 0, 0], [1e6, 1, 0], [1e6, 0, 1]], float)
    caster = MeshCaster(Mesh(vertices, np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])), threads=1)
    random = np.random.default_rng(0)
    origins = vertices.mean(axis=0) + random.normal(size=(200, 3)) * 3
    directions = vertices.mean(axis=0) - origins + random.normal(size=(200, 3)) * 0.2
    here, there = caster.cast(origins, directions), pickle.loads(pickle.dumps(caster)).cast(origins, directions)
    assert (here.face >= 0).sum() > 50
    for name in ("t", "normal", "face"):
        np.testing.assert_array_equal(getattr(here, name), getattr(there, name))
