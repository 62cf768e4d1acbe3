"""The export to deep OpenEXR, and how exporters are found."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from ibrpipe.cli.main import cli
from ibrpipe.errors import ConfigError
from ibrpipe.export import registry
from ibrpipe.export.registry import Exporter, exporter_for, find_exporter, register
from ibrpipe.io.assets import read_asset, read_index, write_asset
from ibrpipe.io.layer_pictures import LOSSLESS
from ibrpipe.types import Asset, LayeredDepthImage, ParallelFrame, Texture

FRAME = ParallelFrame((0, 0, 0), (0.5, 0, 0), (0, 0.5, 0), (0, 0, 1))


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """A run folder whose finished asset is coded compactly."""
    color = np.full((16, 3), 0.25)
    layers = LayeredDepthImage(
        FRAME, np.arange(4)[:, None] * 4 + np.arange(5), np.ones(16), color, color, np.ones(16, np.int32)
    )
    write_asset(Asset((Texture(layers),), {"units": "metre"}), tmp_path / "run" / "asset", coding=LOSSLESS)
    return tmp_path / "run"


@pytest.mark.parametrize("source", ["", "asset"])
def test_a_run_or_an_asset_becomes_deep_openexr(run: Path, source: str) -> None:
    result = CliRunner().invoke(cli, ["export", str(run / source), str(run / "deep"), "--format", "deep-exr"])
    assert result.exit_code == 0, result.output
    index = read_index(run / "deep")
    assert (index.schema_version, index.textures[0].coding, index.units) == (1, None, "metre")
    assert (run / "deep/texture_00/layers.exr").read_bytes()[:4] == b"\x76\x2f\x31\x01"
    back, wanted = read_asset(run / "deep").textures[0].layers, read_asset(run / "asset").textures[0].layers
    for name in ("offsets", "depth", "color", "normal", "observers"):
        np.testing.assert_array_equal(getattr(back, name), getattr(wanted, name), err_msg=name)
    assert not list(run.glob(".*"))


def test_an_earlier_export_is_replaced_and_nothing_else(run: Path) -> None:
    export = find_exporter("deep-exr").write
    export(run / "asset", run / "deep")
    (run / "deep/texture_09").mkdir()
    export(run / "asset", run / "deep")
    assert not (run / "deep/texture_09").exists()
    (run / "mine").mkdir()
    (run / "mine/notes.txt").write_text("keep")
    with pytest.raises(ConfigError, match="holds something that is no asset"):
        export(run / "asset", run / "mine")
    assert (run / "mine/notes.txt").read_text() == "keep"
    with pytest.raises(ConfigError, match="is the asset itself"):
        export(run / "asset", run / "asset")


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["none", "x", "--format", "deep-exr"], "asset.json: no such file"),
        (["none", "x"], "its name does not say its form; give --format colmap|deep-exr"),
        (["none", "x", "--format", "deep"], 'there is no exporter "deep"'),
    ],
)
def test_failures_take_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arguments: list, told: str) -> None:
    monkeypatch.chdir(tmp_path)
    result = CliRunner().invoke(cli, ["export", *arguments])
    assert result.exit_code == 1
    assert told in result.stderr
    assert result.stderr.count("\n") == 1


def test_exporters_are_found_by_name_and_ending(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(registry, "_known", dict(registry._known))
    mine = Exporter("points", "Points.", lambda source, target: None, (".xyz",))
    register("points", mine)
    register("points", mine)
    assert find_exporter("points") is mine
    assert exporter_for(Path("a.XYZ"), None) is mine
    with pytest.raises(ConfigError, match="already"):
        register("deep-exr", mine)
    with pytest.raises(ConfigError, match="no name of an exporter"):
        register("My form", mine)
    register("broken", "ibrpipe.nowhere:EXPORTER")
    with pytest.raises(ConfigError, match="cannot be loaded"):
        find_exporter("broken")
