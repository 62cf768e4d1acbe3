"""The trial: glossy things are told from matt ones, in photos with noise and on surfaces that are off."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ibrpipe.embree import MeshCaster
from ibrpipe.modelling.planning import PlanConfig, make_plan
from ibrpipe.modelling.trial import TABLES, spread, try_out
from ibrpipe.modelling.view_dependence.reflection.fit import FitRules

QUICK = PlanConfig(samples=4000)


def damaged(scene, noise: float, off: float):
    """Photos with noise (codes of 255), and a mesh moved to and fro by so many pixels."""
    photos, mesh, rng = scene.photos, scene.caster.mesh, np.random.default_rng(1)
    grains = rng.normal(0, noise / 255, photos.code.shape)
    photos = replace(photos, code=np.maximum(photos.code + grains, 0).astype(np.float32))
    pixel = np.linalg.norm(photos.centers[0]) / photos.cameras[0].K[0, 0]
    waves = np.sin(3 * mesh.vertices) @ np.ones((3, 1))
    return photos, MeshCaster(replace(mesh, vertices=mesh.vertices + off * pixel / 3 * waves))


@pytest.mark.parametrize(("noise", "off"), [(0, 0), (2, 0), (6, 0), (2, 1)])
@pytest.mark.parametrize(("name", "glossy"), [("lambert", False), ("glossy", True)])
def test_matt_and_glossy_are_told_apart(measured, name, glossy, noise, off):
    photos, caster = damaged(measured(name), noise, off)
    plans, reasons = make_plan(caster, photos, QUICK, 0)
    depends = any(each.kind == "spiral" or each.settings["tables"] for plan in plans for each in plan.components)
    assert depends == glossy
    rungs = [entry for entry in reasons if entry["what"].startswith("rung ")]
    assert len(rungs) == 3
    assert all(entry["reason"] and entry["measured"] for entry in rungs)


def test_the_scores_of_a_trial(measured):
    scene = measured("ball")
    plans, _ = make_plan(scene.caster, scene.photos, QUICK.model_copy(update={"reflection": "never"}), 0)
    found = try_out(plans, scene.caster, scene.photos, 0, rules=FitRules(size=32))
    assert found.pixels.sum() > 500
    assert found.psnr(TABLES[1]) > found.psnr(TABLES[0]) + 1
    assert found.best_tables() >= 1
    assert found.angles[1] >= found.angles[0] > 0
    again = try_out(plans, scene.caster, scene.photos, 0, rules=FitRules(size=32))
    assert again.everywhere == found.everywhere


def test_too_few_photos_are_not_tried(measured):
    scene = measured("ball")
    assert try_out([], scene.caster, scene.photos.subset(range(7)), 0) is None


def test_spread_chooses_directions_far_apart():
    angles = np.radians([0, 5, 90, 95, 180, 185])
    chosen = spread(np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=1), 3)
    assert len(chosen) == 3
    assert np.diff(np.degrees(angles)[chosen]).min() >= 80
