"""The bench of several rays a pixel: errors fall with rays, times are told against one ray, figures are written."""

from __future__ import annotations

import json
from math import isqrt

import numpy as np
import pytest
from click.testing import CliRunner
from small_fields import CAMERAS, layers

import ibrpipe
from ibrpipe.bench.antialiasing import TRUTH, draw_truth, run_antialiasing
from ibrpipe.cli.main import cli


@pytest.fixture
def asset():
    return ibrpipe.Asset((ibrpipe.Texture(layers((20, 26), seed=5)),))


def test_the_truth_is_the_mean_of_a_larger_picture(asset):
    camera, side = CAMERAS["front"].resized(30, 50), isqrt(TRUTH)
    color, alpha = draw_truth(ibrpipe.prepare(asset), camera)
    large = ibrpipe.render(asset, camera.resized(30 * side, 50 * side))
    shape = (50, side, 30, side)
    np.testing.assert_allclose(alpha, large.alpha.reshape(shape).mean(axis=(1, 3)), atol=1e-3)
    weighted = (large.color * large.alpha[..., None]).reshape(*shape, 3).mean(axis=(1, 3))
    np.testing.assert_allclose(color, weighted, atol=2e-3)


def test_more_rays_err_less(asset):
    camera = CAMERAS["front"].resized(40, 30)
    rows = {row.samples: row for row in run_antialiasing(asset, [camera], 1).rows}
    assert rows["16"].psnr > rows["4"].psnr > rows["1"].psnr
    assert rows["adaptive"].psnr > rows["1"].psnr
    assert rows["1"].ratio == 1.0
    assert rows["4"].rays == 4
    assert 1 < rows["adaptive"].rays < 9


def test_the_command_writes_what_it_prints(asset, tmp_path):
    ibrpipe.write_asset(asset, tmp_path / "asset")
    words = [str(tmp_path / "asset"), "--path", "orbit:frames=2", "--width", "32", "--height", "24", "--repeats", "1"]
    result = CliRunner().invoke(
        cli, ["bench", "antialiasing", *words, "--json", str(tmp_path / "aa.json")], catch_exceptions=False
    )
    assert result.exit_code == 0
    assert "adaptive" in result.output
    written = json.loads((tmp_path / "aa.json").read_text(encoding="utf-8"))
    assert written["cameras"] == 2
    assert [row["samples"] for row in written["rows"]] == ["1", "adaptive", "4", "16"]
