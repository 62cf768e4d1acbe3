"""Time against size as commands: table 2 of the paper, and growth by the region of the epipole."""

from __future__ import annotations

import json

import pytest
from click.testing import CliRunner

from ibrpipe.bench.sizes.results import GrowthModel, Table2Model
from ibrpipe.bench.sizes.table2 import torus
from ibrpipe.cli.main import cli
from ibrpipe.io.surfaces.meshes import write_mesh


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("sizes")


def test_table2_measures_every_model_at_every_size_and_writes_a_page(folder):
    write_mesh(torus(12), folder / "ring.ply")
    arguments = ["bench", "table2", "--sizes", "16,32", "--mesh", str(folder / "ring.ply"), "--out", str(folder)]
    result = CliRunner().invoke(cli, arguments)
    assert result.exit_code == 0, result.output
    assert "dragon, " in result.output
    model = Table2Model.model_validate(json.loads((folder / "table2.json").read_text()))
    assert [(row.model, row.search, row.size) for row in model.rows] == [
        (name, search, size)
        for name in ("torus", "globe", "dragon")
        for search in ("nearest", "exact")
        for size in (16, 32)
    ]
    assert {row.maps for row in model.rows if row.model != "dragon"} == {6}
    assert 1 < model.rows[-1].maps <= 16  # as many as add surface
    assert all(row.covered > 0.2 and row.milliseconds > 0 for row in model.rows)
    assert [row.growth is None for row in model.rows[:2]] == [True, False]
    assert model.skipped == []
    page = (folder / "table2.html").read_text()
    assert "dragon, " in page
    assert "<script" not in page


def test_growth_has_a_curve_for_each_of_nine_regions(folder):
    result = CliRunner().invoke(cli, ["bench", "growth", "--sizes", "16,32", "--out", str(folder), "--json"])
    assert result.exit_code == 0, result.output
    model = GrowthModel.model_validate(json.loads(result.stdout))
    assert len({curve.series for curve in model.growth}) == 9
    assert all(curve.sizes == [16, 32] and len(curve.doublings) == 1 and curve.slope for curve in model.growth)
    assert "within middle" in (folder / "growth.html").read_text()


@pytest.mark.parametrize("sizes", ["", "a,b", "64,32", "4,8"])
def test_sizes_are_ascending_whole_numbers(sizes):
    result = CliRunner().invoke(cli, ["bench", "growth", "--sizes", sizes])
    assert result.exit_code == 2
    assert "such as 128,256,512" in result.output
