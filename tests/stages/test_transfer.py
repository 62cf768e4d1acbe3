"""A surface carries photos into each other the better the nearer it is to the true one."""

from __future__ import annotations

import numpy as np

from ibrpipe.io.views import read_views
from ibrpipe.stages.surface.transfer import carried, partners, surely_better
from ibrpipe.types import Mesh


def test_the_true_surface_carries_best(measured) -> None:
    found = measured("ball")
    views, mesh = read_views(found.folder / "views.json").train, found.caster.mesh
    half = mesh.faces[mesh.vertices[mesh.faces][:, :, 2].mean(axis=1) > 0]
    wrong = [Mesh(0.93 * mesh.vertices, mesh.faces), Mesh(mesh.vertices * (1, 1, 0.8), mesh.faces)]
    scores = carried([mesh, *wrong, Mesh(mesh.vertices, half)], views, np.zeros(3))
    assert scores.shape == (7, 4)
    assert (scores >= 0).all()
    assert (scores <= 1).all()
    for other in scores.T[1:]:
        assert surely_better(scores[:, 0], other)
        assert not surely_better(other, scores[:, 0])


def test_partners_stand_about_the_wanted_angle_away(measured) -> None:
    views = read_views(measured("ball").folder / "views.json").train
    found = partners(views[0], views, np.zeros(3))
    assert len(found) == 2
    assert views[0].name not in {each.name for each in found}


def test_chance_is_not_better() -> None:
    draw = np.random.default_rng(0)
    same = draw.normal(0.6, 0.1, 12)
    assert not surely_better(same + 1e-3 * draw.normal(size=12), same)
    assert not surely_better(same[:2] + 0.1, same[:2])
    assert surely_better(same + 0.01, same)
