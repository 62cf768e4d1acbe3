"""Bytes against error of a small run: what is measured, in order, and the page."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from ibrpipe.bench.rate_error.results import RateErrorModel
from ibrpipe.bench.rate_error.run import paper_codings
from ibrpipe.cli.main import cli
from ibrpipe.io.assets import write_asset
from ibrpipe.types import Asset, LayeredDepthImage, ParallelFrame, Texture
from ibrpipe.types.layers import pitch_of


@pytest.fixture(scope="module")
def run(measured, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What `ibrpipe run` leaves, with one texture that looks at the object from the front."""
    from ibrpipe.io.layers import read_layers
    from ibrpipe.modelling.layers import LayersConfig
    from ibrpipe.modelling.plan_file import read_plan
    from ibrpipe.stages import layers, plan

    folder, source = tmp_path_factory.mktemp("rate"), measured("glossy").folder
    for name in ("photometry", "geometry", "plan", "layers"):
        (folder / name).mkdir()
    (folder / "photometry/views.json").write_bytes((source / "views.json").read_bytes())
    (folder / "geometry/mesh.ply").write_bytes((source / "mesh.ply").read_bytes())
    views, mesh, planned = source / "views.json", source / "mesh.ply", folder / "plan/plan.json"
    plan.run(plan.Inputs(views, mesh, 0, folder / "plan"), plan.PlanConfig(samples=2000, texel=0.12, residuals="never"))
    layers.run(layers.Inputs(views, mesh, planned, folder / "layers"), LayersConfig(sharpen=0))

    textures = [
        Texture(read_layers(folder / f"layers/texture_{i:02d}/layers.exr")) for i in range(len(read_plan(planned)))
    ]
    write_asset(Asset(tuple(textures)), folder / "assembled")
    return folder


def test_points_and_page(run: Path, tmp_path: Path) -> None:
    result = CliRunner().invoke(cli, ["bench", "rate-error", str(run), "--out", str(tmp_path), "--views", "2"])
    assert result.exit_code == 0, result.output
    model = RateErrorModel.model_validate(json.loads((tmp_path / "rate_error.json").read_text()))
    (curve,) = model.curves
    by_series = {
        name: [p for p in curve.points if p.series == name] for name in ("raw", "diffuse", "paper", "lumigraph")
    }
    counts = {name: len(points) for name, points in by_series.items()}
    assert counts == {"raw": 1, "diffuse": counts["diffuse"], "paper": 3, "lumigraph": 1}
    assert counts["diffuse"] >= 8
    assert sum("texels joined" in point.label for point in by_series["diffuse"]) >= 3
    joined = [point for point in by_series["diffuse"] if "texels joined" in point.label]
    assert min(point.bytes for point in joined) < 0.3 * by_series["raw"][0].bytes
    diffuse = [point for point in by_series["diffuse"] if point not in joined]
    sizes = [point.bytes for point in diffuse]
    assert sizes[0] == max(sizes)
    assert sizes[-1] == min(sizes) < 0.5 * by_series["raw"][0].bytes
    assert diffuse[0].psnr == by_series["raw"][0].psnr
    assert diffuse[-1].psnr < diffuse[0].psnr
    assert diffuse[-1].flip > diffuse[0].flip
    assert by_series["lumigraph"][0].share == 1
    assert all(point.decode_seconds > 0 and point.ms_per_frame > 0 for point in [*diffuse, *by_series["paper"]])
    assert len(curve.views) == 2
    page = (tmp_path / "rate_error.html").read_text()
    assert page.count("<svg") == 1
    assert "vector quantisation" in page


def test_no_run(tmp_path: Path) -> None:
    result = CliRunner().invoke(cli, ["bench", "rate-error", str(tmp_path), "--out", str(tmp_path / "out")])
    assert result.exit_code == 1
    assert "give the folder of a run that has got as far as asset" in result.stderr


def test_the_papers_depths_have_8_bits_over_the_deepest_range() -> None:
    frame = ParallelFrame((0, 0, 0), (0.5, 0, 0), (0, 0.5, 0), (0, 0, 1))
    depth = np.linspace(1, 52, 16)
    layers = LayeredDepthImage(
        frame, np.arange(4)[:, None] * 4 + np.arange(5), depth, np.ones((16, 3)), np.ones((16, 3)), None
    )
    step = paper_codings(Asset((Texture(layers),)))["8-bit depth"].depth_step
    assert step is not None
    assert step * pitch_of(layers) == pytest.approx(51 / 255)
