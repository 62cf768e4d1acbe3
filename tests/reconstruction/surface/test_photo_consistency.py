"""A surface is the more consistent with the photos the nearer it is to the true one."""

from __future__ import annotations

import numpy as np
import pytest

from ibrpipe.io.views import read_views
from ibrpipe.reconstruction.surface.methods import Made, Sources, _judged
from ibrpipe.reconstruction.surface.photo_consistency import APART, partners, photo_consistency, surely_better
from ibrpipe.reconstruction.surface.settings import SurfaceConfig
from ibrpipe.reconstruction.surface.silhouettes import load_outlines
from ibrpipe.types import Mesh


def test_the_true_surface_agrees_best(measured) -> None:
    found = measured("ball")
    views, mesh = read_views(found.folder / "views.json").train, found.caster.mesh
    half = mesh.faces[mesh.vertices[mesh.faces][:, :, 2].mean(axis=1) > 0]
    wrong = [Mesh(0.93 * mesh.vertices, mesh.faces), Mesh(mesh.vertices * (1, 1, 0.8), mesh.faces)]
    scores = photo_consistency([mesh, *wrong, Mesh(mesh.vertices, half)], views, np.zeros(3))
    assert scores.shape == (7, 4)
    assert (scores >= 0).all()
    assert (scores <= 1).all()
    for other in scores.T[1:]:
        assert surely_better(scores[:, 0], other)
        assert not surely_better(other, scores[:, 0])


def test_partners_stand_about_the_wanted_angle_away(measured) -> None:
    views = read_views(measured("ball").folder / "views.json").train
    found = partners(views[0], views, np.zeros(3))
    toward = np.stack([view.camera.center / np.linalg.norm(view.camera.center) for view in views])
    off = dict(
        zip([view.name for view in views], np.abs(np.degrees(np.arccos(np.clip(toward @ toward[0], -1, 1))) - APART))
    )
    rest = sorted((off[view.name], view.name) for view in views[1:])
    assert [(off[each.name], each.name) for each in found] == rest[:2]


def test_the_surface_that_surely_agrees_better_is_taken(measured) -> None:
    found = measured("ball")
    views, true = read_views(found.folder / "views.json").train, found.caster.mesh
    wrong = Mesh(0.93 * true.vertices, true.faces)
    sources = Sources(None, load_outlines(views), np.zeros((0, 3)), SurfaceConfig(), 1 << 30, views)

    def judged(poisson: Mesh, volume: Mesh, hull: Mesh | None) -> Made:
        return _judged(Made(poisson, "poisson", 0.1, 0.1, 0), (volume, 3), (0.2, 0.1), hull, sources)

    kept = judged(true, wrong, wrong)
    assert (kept.method, kept.mesh) == ("poisson", true)
    assert set(kept.photo_consistency) == {"poisson", "volume", "hull"}
    taken = judged(wrong, true, None)
    assert (taken.method, taken.mesh, taken.dropped, taken.step) == ("volume", true, 3, 0.2)
    assert set(taken.photo_consistency) == {"poisson", "volume"}
    outlined = judged(wrong, wrong, true)
    assert outlined.method == "hull"
    figures = outlined.photo_consistency
    assert figures["hull"] > figures["poisson"] == figures["volume"]
    radii = np.linalg.norm(outlined.mesh.vertices, axis=1)  # made anew from the outlines, as fine as any surface
    assert np.median(radii) == pytest.approx(np.linalg.norm(true.vertices, axis=1).max(), rel=0.1)


def test_chance_is_not_better() -> None:
    draw = np.random.default_rng(0)
    same = draw.normal(0.6, 0.1, 12)
    assert not surely_better(same + 1e-3 * draw.normal(size=12), same)
    assert not surely_better(same[:2] + 0.1, same[:2])
    assert surely_better(same + 0.01, same)
