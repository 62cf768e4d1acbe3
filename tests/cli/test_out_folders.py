"""Where nothing can be written is told in one line, before any work, and nothing is left or lost."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import ibrpipe
from ibrpipe.cli.main import cli
from ibrpipe.synthetic.instanced.scenes import InstancedConfig, make_instanced
from ibrpipe.types.layers import single_layer

COMMANDS = {
    "run": "run mesh --capture capture --out {}",
    "demo": "demo --out {}",
    "ingest": "ingest capture --out {}",
    "render": "render --asset asset --path orbit --out {}",
    "render a scene": "render --scene scene --out {}",
    "prerender": "prerender scene --out {}",
    "synth": "synth ball {}",
    "synth a scene": "synth solids {}",
    "export a folder": "export scene {} --format impostors",
    "export a file": "export asset {}/page.html",
}


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with a capture, an asset, a scene, and places where no folder can be made."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "capture/images").mkdir(parents=True)
    frame = ibrpipe.ParallelFrame((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1))
    layers = single_layer(frame, np.ones((4, 4), np.float32), np.ones((4, 4, 3), np.float32), observed=True)
    ibrpipe.write_asset(ibrpipe.Asset((ibrpipe.Texture(layers),)), tmp_path / "asset")
    ibrpipe.write_scene(make_instanced("solids", InstancedConfig()), tmp_path / "scene")
    (tmp_path / "file").write_text("mine")
    (tmp_path / "loop").symlink_to("loop")
    (tmp_path / "dangling").symlink_to("file/nowhere")
    return tmp_path


@pytest.mark.parametrize("command", COMMANDS)
def test_a_place_that_can_be_no_folder_is_one_line(here: Path, command: str) -> None:
    for place in ("file", "file/below", "dangling", "loop", "/dev/null", "/dev/null/below", "x" * 300):
        if place in ("file", "/dev/null") and command == "export a folder":
            continue
        before = {path.relative_to(here) for path in here.rglob("*")}
        result = CliRunner().invoke(cli, COMMANDS[command].format(place).split())
        assert isinstance(result.exception, SystemExit), (place, result.exception)
        assert result.exit_code in (1, 2), (place, result.output)
        line = result.stderr.splitlines()[-1]
        assert line.startswith("error: "), (place, result.output)
        assert place[:50] in line, place
        assert (here / "file").read_text() == "mine"
        assert {path.relative_to(here) for path in here.rglob("*")} == before, place


def test_a_run_that_fails_leaves_no_folder(here: Path) -> None:
    for words in ("run mesh --capture capture", "ingest capture", "render --asset nothing", "render --scene nothing"):
        result = CliRunner().invoke(cli, [*words.split(), "--out", "out"])
        assert result.exit_code == 1, words
        assert result.stderr.splitlines()[-1].startswith("error: "), words
        assert not (here / "out").exists(), words
