"""The table of losses: its parts on a ball, and the whole on a tiny run."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from ibrpipe.bench.ablation import around, as_table, main
from ibrpipe.modelling.plan_file import read_plan
from ibrpipe.stages import geometry, ingest, layers, photometry, plan


@pytest.fixture(scope="module")
def run_folder(tiny_ball: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Ingest, plan and layers of the glossy ball, coarse."""
    root = tmp_path_factory.mktemp("run")
    for name in ("ingest", "geometry", "photometry", "plan", "layers"):
        (root / name).mkdir()
    ingest.run(ingest.Inputs(tiny_ball, root / "ingest"), ingest.IngestConfig())
    views, mesh = root / "ingest/views.json", root / "geometry/mesh.ply"
    inputs = geometry.Inputs(views, 0, root / "geometry", root / "ingest/mesh.ply")
    geometry.run(inputs, geometry.GeometryConfig())
    photometry.run(photometry.Inputs(views, mesh, root / "photometry"), photometry.PhotometryConfig(balance="never"))
    settings = plan.PlanConfig(residuals="always", k=1 / 8, samples=2000)
    plan.run(plan.Inputs(views, mesh, 0, root / "plan"), settings)
    layers.run(layers.Inputs(views, mesh, root / "plan/plan.json", root / "layers"), layers.LayersConfig())
    return root


def test_the_table_measures_every_loss(run_folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([str(run_folder)]) == 0
    rows = json.loads((run_folder / "ablation.json").read_text(encoding="utf-8"))
    added = {what: value for group, what, value in rows if group == "added one by one"}
    off = {what: value for group, what, value in rows if group == "switched off in turn"}
    assert list(added.values())[-1] == pytest.approx(off["nothing: the asset"], abs=1e-6)
    assert added["refinement"] > added["residual and diffuse texels (double interpolation)"]
    assert off["residuals: diffuse colour only"] < off["nothing: the asset"]
    assert (run_folder / "ablation.md").read_text(encoding="utf-8") == capsys.readouterr().out


def test_directions_and_weights_bracket_the_view(run_folder: Path) -> None:
    from ibrpipe.core.spiral import directions

    texture, k = read_plan(run_folder / "plan/plan.json")[0], 1 / 24
    rng = np.random.default_rng(1)
    toward = rng.normal(size=(200, 3)) * 0.4 - 2.0 * texture.rectangle.f
    toward /= np.linalg.norm(toward, axis=1, keepdims=True)
    ways, weights = around(texture, k, directions.table(k, True), True, toward)
    np.testing.assert_allclose(weights.sum(axis=1), 1.0, atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(ways, axis=2), 1.0, atol=1e-12)
    mean = (ways * weights[:, :, None]).sum(axis=1)
    cosine = (mean * toward).sum(axis=1) / np.linalg.norm(mean, axis=1)
    pitch = np.arccos(np.clip(toward @ -texture.rectangle.f, -1, 1))
    far = pitch > 2 * np.pi * k  # past the first turn the four lie on either side
    assert far.sum() > 30
    assert np.degrees(np.arccos(cosine[far])).max() < 0.36 * 360 * k


def test_differences_are_to_the_row_before_or_to_the_asset() -> None:
    rows = [("added one by one", w, v) for w, v in (("a", 30.0), ("b", 29.5), ("c", 29.25))]
    rows += [("switched off in turn", w, v) for w, v in (("d", 20.0), ("e", 21.0), ("f", 22.5))]
    table = as_table(rows)
    assert "| c | 29.25 | -0.25 |" in table
    assert "| f | 22.50 | +2.50 |" in table


def test_what_cannot_be_measured_is_told_in_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([]) == 1
    assert "give one run folder" in capsys.readouterr().err
    assert main([str(tmp_path)]) == 1
    assert capsys.readouterr().err.count("\n") == 1
