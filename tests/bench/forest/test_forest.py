"""The bench of forests: its figures, with the peer and without it."""

from __future__ import annotations

import json

import numpy as np
import pytest
from click.testing import CliRunner

from ibrpipe.bench.forest import embree_instances, run
from ibrpipe.cli.main import cli
from ibrpipe.errors import ResourceError
from ibrpipe.renderers.hierarchical.prefiltering import Slicing

SMALL = {"repeats": 1, "size": (96, 72), "slicing": Slicing(24, 6.0, 3, 16)}


def test_times_are_interpolated_in_logarithms():
    scores = [(10.0, 20.0), (40.0, 30.0), (160.0, 40.0)]
    assert run.equal_time(scores, 30.0) == pytest.approx(40.0)
    assert run.equal_time(scores, 25.0) == pytest.approx(20.0)
    assert run.equal_time(scores, 45.0) == pytest.approx(320.0)
    assert run.equal_time(scores, 15.0) == pytest.approx(5.0)
    assert run.equal_time([], 30.0) is None


def test_psnr_is_that_of_srgb():
    assert run.psnr(np.zeros((2, 2, 3)), np.ones((2, 2, 3))) == pytest.approx(0.0)


def test_embree_sees_what_the_polygons_show():
    pytest.importorskip("embreex")
    model = run.run_forest([6], ["far", "near"], **SMALL)
    for row in model.rows:
        assert row.note == ""
        assert set(row.peer) == {"1", "4", "16"}
        assert row.peer["16"][1] > row.peer["4"][1] > row.peer["1"][1]
        assert row.ours_psnr > 25
        assert row.equal_ms == pytest.approx(row.ratio * row.ours_ms)
    scene = run.forest(6)
    nodes = run.scene_nodes(scene)
    peer = run.Peer(nodes, scene.lighting)
    for camera in run.forest_cameras(6, 100, 70).values():
        picture, _ = peer.render(camera, 4)
        frame = run.render(scene_data(scene), camera, "hierarchical", ("color", "alpha"), mode="polygons")
        ours = np.dstack([frame.color * frame.alpha[..., None], frame.alpha])
        assert np.abs(ours - picture).mean() < 0.003


def scene_data(scene):
    library = run.prerender_all(run.scene_nodes(scene), Slicing(6, 6.0, 2, 4))
    return run.prepare(run.PrerenderedScene(scene, library), "hierarchical")


def test_without_the_peer_the_row_says_so(monkeypatch):
    def missing():
        raise ResourceError("the wheel embreex is not installed")

    monkeypatch.setattr(embree_instances, "embree", missing)
    (row,) = run.run_forest([2], ["far"], **SMALL).rows
    assert "not installed" in row.note
    assert row.peer == {}
    assert row.ratio is None
    assert row.ours_psnr > 25


def test_the_command_writes_its_figures(tmp_path, monkeypatch):
    made, prerender_all = [], run.prerender_all
    monkeypatch.setattr(
        run, "prerender_all", lambda nodes, slicing: made.append(slicing) or prerender_all(nodes, slicing)
    )
    file = tmp_path / "made" / "forest.json"
    result = CliRunner().invoke(
        cli,
        [
            "bench",
            "forest",
            "--trees",
            "2",
            "--views",
            "far",
            "--repeats",
            "1",
            "--directions",
            "6",
            "--slab-texels",
            "3",
            "--json",
            str(file),
        ],
    )
    assert result.exit_code == 0, result.output
    (row,) = json.loads(file.read_text())["rows"]
    assert row["trees"] == 2
    assert "2 trees, far" in result.output
    assert made == [Slicing(directions=6, slab_texels=3.0)]


@pytest.mark.parametrize(
    ("options", "told"), [(["--trees", "0"], "at least 1"), (["--views", "close"], "far, middle, near")]
)
def test_wrong_options_are_usage_errors(options, told):
    result = CliRunner().invoke(cli, ["bench", "forest", *options])
    assert result.exit_code == 2
    assert told in result.output
