"""`ibrpipe warm-up` compiles what first frames call, says so, and does it once."""

from __future__ import annotations

import json

import numba
import pytest
from click.testing import CliRunner

import ibrpipe
from ibrpipe.cli.main import cli
from ibrpipe.core import jit
from ibrpipe.synthetic import small_asset


@pytest.mark.slow
def test_what_is_drawn_covers_assets_of_every_kind_and_is_told():
    result = CliRunner().invoke(cli, ["warm-up"], catch_exceptions=False)
    assert result.exit_code == 0
    assert "9 kinds of pictures drawn in " in result.stdout
    assert jit.kept_functions()[0] in result.stdout
    again = json.loads(CliRunner().invoke(cli, ["warm-up", "--json"], catch_exceptions=False).stdout)
    assert again["compiled"] == 0
    assert again["kept"] > 0 or numba.config.DISABLE_JIT


def test_kept_functions_are_counted_below_the_chosen_folder(tmp_path, monkeypatch):
    monkeypatch.setenv("IBRPIPE_CACHE_DIR", str(tmp_path))
    assert jit.kept_functions() == (str(tmp_path), 0)
    (tmp_path / "module").mkdir()
    (tmp_path / "module" / "one.nbc").touch()
    (tmp_path / "module" / "one.nbi").touch()
    assert jit.kept_functions() == (str(tmp_path), 1)


@pytest.mark.parametrize("kinds", [(), ("reflection",), ("spiral",), ("photos",)])
def test_small_assets_are_seen(kinds):
    asset = small_asset.asset(*kinds)
    assert tuple(part.kind for part in asset.textures[0].components) == kinds
    camera = ibrpipe.Camera.look_at((8, 4, -32), (8, 8, 1), width=32, height=24)
    frame = ibrpipe.render(asset, camera)
    assert 0.1 < (frame.alpha > 0).mean() < 0.9
