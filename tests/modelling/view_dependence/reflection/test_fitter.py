"""The kind "reflection" through the stages: fitted, written beside new diffuse colours, read and rendered."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import ibrpipe
from ibrpipe.core.color import srgb_encode
from ibrpipe.errors import FormatError
from ibrpipe.io.layers import read_layers
from ibrpipe.io.views import load_view, read_views
from ibrpipe.modelling.plan_file import read_plan
from ibrpipe.modelling.planning import PlanConfig
from ibrpipe.modelling.view_dependence.fitter import FitJob
from ibrpipe.modelling.view_dependence.reflection.fitter import ReflectionFitter
from ibrpipe.modelling.view_dependence.spiral import ResidualsConfig
from ibrpipe.modelling.view_dependence.work_units import Sources
from ibrpipe.stages import asset, layers, plan, residuals


def planned(folder: Path, out: Path, component: dict[str, object]):
    """Plan and layers of an ingested capture, and what the later stages take."""
    views, mesh = folder / "views.json", next(folder.glob("mesh.*"))
    config = PlanConfig(residuals="never", samples=2000, texel=0.06, components=[component])
    plan.run(plan.Inputs(views, mesh, 0, out / "plan"), config)
    layers.run(layers.Inputs(views, mesh, out / "plan" / "plan.json", out / "layers"), layers.LayersConfig())
    return Sources(views, mesh, out / "plan" / "plan.json", out / "layers")


def score(one: ibrpipe.Asset, folder: Path) -> float:
    errors = []
    for view in read_views(folder / "views.json").test:
        color, mask = load_view(view)
        frame = ibrpipe.render(one, view.camera)
        errors.append(((srgb_encode(frame.color) - srgb_encode(color)) ** 2)[mask >= 0.5].mean())
    return float(-10 * np.log10(np.mean(errors)))


def test_the_glossy_ball_through_the_stages(measured, tmp_path):
    folder = measured("ball").folder
    for name in ("plan", "layers", "residuals", "asset"):
        (tmp_path / name).mkdir()
    sources = planned(folder, tmp_path, {"kind": "reflection", "size": 24})
    args = sources.views, sources.mesh, sources.plan, sources.layers
    residuals.run(residuals.Inputs(*args, tmp_path / "residuals"), ResidualsConfig())
    done = asset.run(
        asset.Inputs(sources.views, sources.plan, sources.layers, tmp_path / "residuals", tmp_path / "asset"),
        asset.AssetConfig(),
    )
    found = ibrpipe.read_asset(done.asset)
    assert found.kinds == ("reflection",)
    assert found.shared["reflection"].tables.shape == (1, 24, 24, 3)
    assert found.info["textures"][0]["measured"]["reflection"]["tables"] == 1
    plain = ibrpipe.Asset(tuple(ibrpipe.Texture(each.layers) for each in found.textures))
    assert score(found, folder) > score(plain, folder) + 1.0


def test_without_tables_only_diffuse_colours_are_written(measured, tmp_path):
    for name in ("plan", "layers", "residuals"):
        (tmp_path / name).mkdir()
    sources = planned(measured("lambert").folder, tmp_path, {"kind": "reflection", "tables": 0})
    plans = read_plan(sources.plan)
    fitted = ReflectionFitter().fit(FitJob("reflection", sources, plans, ResidualsConfig(), tmp_path / "residuals"))
    assert fitted.figures == ()
    assert fitted.shared is None
    written = [read_layers(file) for file in sorted((tmp_path / "residuals").glob("texture_*/layers.exr"))]
    before = [read_layers(file) for file in sorted((tmp_path / "layers").glob("texture_*/layers.exr"))]
    assert len(written) == len(plans)
    unseen = np.concatenate([each.observers for each in before]) == 0
    after = np.concatenate([each.observers for each in written])
    assert unseen.any()
    assert (after[~unseen] > 0).all()  # what photos see, or what took the colour of that, keeps one
    assert (after[unseen] == 0).any()  # what lies further from it is not guessed


def test_a_wrong_setting_is_told(measured, tmp_path):
    for name in ("plan", "layers"):
        (tmp_path / name).mkdir()
    sources = planned(measured("ball").folder, tmp_path, {"kind": "reflection", "tables": 7})
    with pytest.raises(FormatError, match="tables"):
        ReflectionFitter().fit(FitJob("reflection", sources, read_plan(sources.plan), ResidualsConfig(), tmp_path))
