"""The bench of forests: its figures, with the peer and without it."""

from __future__ import annotations

import json

import numpy as np
import pytest
from click.testing import CliRunner

from ibrpipe.bench.forest import embree_instances, flight, growth_plot, peer, run, tradeoff, tradeoff_plot
from ibrpipe.bench.forest.results import ForestRow, TradeoffRow
from ibrpipe.cli.main import cli
from ibrpipe.errors import ResourceError
from ibrpipe.renderers.hierarchical import drawing
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
    embree = run.Peer(nodes, scene.lighting)
    for camera in run.forest_cameras(6, 100, 70).values():
        picture, _ = embree.render(camera, 4)
        frame = run.render(scene_data(scene), camera, "hierarchical", ("color", "alpha"), mode="polygons")
        ours = np.dstack([frame.color * frame.alpha[..., None], frame.alpha])
        assert np.abs(ours - picture).mean() < 0.003


def test_coarser_texels_need_fewer_slices():
    counts = [
        run.run_forest([40], ["far"], **SMALL, alone=True, pixel_error=error).rows[0].slices for error in (0.4, 4.0)
    ]
    assert counts[0] > counts[1] > 0


def scene_data(scene):
    library = run.make_slices(run.scene_nodes(scene), Slicing(6, 6.0, 2, 4))
    return run.prepare(run.PrerenderedScene(scene, library), "hierarchical")


def test_the_peer_takes_groves_apart_into_trees():
    nodes = run.scene_nodes(run.forest(1100))
    children, matrices = peer.copies_of_trees(nodes)
    names = [nodes.names[child] for child in children]
    assert sum(name.endswith("-tree") for name in names) == 1100
    assert sorted({name for name in names if not name.endswith("-tree")}) == ["forest/own"]
    trees = matrices[[name.endswith("-tree") for name in names]].reshape(-1, 3, 4)
    assert len(np.unique(np.floor(trees[:, :2, 3] / 7.0 + 17), axis=0)) == 1100
    assert (np.cbrt(np.linalg.det(trees[:, :, :3])) > 0.7).all()


def test_changes_beyond_the_truths_are_counted_in_codes():
    truth = [np.full((32, 48, 3), level, np.float32) for level in (0.2, 0.3, 0.4)]
    assert flight.changes(truth, truth[1:], truth) == (0.0, 0.0)
    popped = [each.copy() for each in truth]
    popped[1][:16, 16:32] = 1.0
    rms, block = flight.changes(popped, popped[1:], truth)
    wanted = 255 * (1 - run.srgb_encode(np.array([0.3]))[0])
    assert block == pytest.approx(wanted, rel=1e-5)
    assert rms == pytest.approx(wanted * np.sqrt(1 / 6), rel=1e-5)


def test_a_flight_changes_less_than_embree_at_four_samples():
    pytest.importorskip("embreex")
    (flown,) = run.run_forest([60], [], **SMALL, frames=6).flights
    assert 0 < flown.ours_rms < flown.peer_rms
    assert flown.ours_block < 2 * flown.peer_block
    assert 0 < flown.kept_rms < 1.05 * flown.ours_rms


def test_pictures_that_keep_their_parts_are_the_same_from_where_these_were_chosen():
    scene = run.forest(6)
    data = scene_data(scene)
    one, other = flight.flight_cameras(6, 2, (96, 72))
    wanted = run.over_sky(*run.our_picture(data, one, "slices"))
    np.testing.assert_allclose(flight.kept_picture(data.data, one, one), wanted, atol=1e-6)
    moved = run.over_sky(*run.our_picture(data, other, "slices"))
    assert run.psnr(flight.kept_picture(data.data, one, other), moved) > run.psnr(wanted, moved) + 3


def test_growth_is_drawn_for_views_of_several_forests(tmp_path):
    made = {"ours_wall_ms": 1.0, "ours_psnr": 40.0, "peer": {}, "note": "", "parts": 1, "slices": 1, "triangles": 1}
    rows = [
        ForestRow(trees=trees, view=view, ours_ms=ms, equal_ms=9.0, ratio=9.0 / ms, **made)
        for trees, view, ms in ((100, "far", 3.0), (1000, "far", 4.0), (100, "near", 5.0))
    ]
    growth_plot.write_growth_plot(rows, tmp_path / "new" / "growth.svg")
    drawn = (tmp_path / "new" / "growth.svg").read_text(encoding="utf-8")
    assert "far, Embree at this error" in drawn
    assert "far, wall time" in drawn
    assert "near" not in drawn


def test_alone_only_times_are_told():
    (row,) = run.run_forest([2], ["far"], **SMALL, alone=True).rows
    assert (row.ours_psnr, row.peer, row.equal_ms, row.ratio, row.note) == (None, {}, None, None, run.ALONE)
    assert row.ours_ms > 0


def test_the_trade_off_varies_one_thing_at_a_time(monkeypatch):
    pytest.importorskip("embreex")
    monkeypatch.setattr(tradeoff, "Slicing", lambda: Slicing(12, 6.0, 2, 8))
    for name, values in (("ERRORS", (0.7, 4.0)), ("DIRECTIONS", (6,)), ("SLABS", (1.0,))):
        monkeypatch.setattr(tradeoff, name, values)
    rows = tradeoff.run_tradeoff(2, ["far"], repeats=1, size=(96, 72))
    assert [(row.varied, row.value) for row in rows] == [
        ("pixel_error", 0.7),
        ("pixel_error", 4.0),
        ("directions", 12),
        ("slab_texels", 6),
        ("directions", 6),
        ("slab_texels", 1),
    ]
    assert rows[0].ours_psnr > rows[1].ours_psnr
    assert rows[4].library_bytes < rows[0].library_bytes < rows[5].library_bytes


def test_the_trade_off_is_drawn_with_its_values(tmp_path):
    made = {"ours_wall_ms": 1.0, "library_bytes": 9}
    rows = [
        TradeoffRow(varied=varied, value=value, view="far", ours_ms=ms, ours_psnr=40.0 + ms, **made)
        for varied, value, ms in (("pixel_error", 0.35, 9.0), ("pixel_error", 1.4, 3.0), ("directions", 96, 5.0))
    ]
    tradeoff_plot.write_tradeoff_plot(rows, tmp_path / "new" / "trade.svg")
    drawn = (tmp_path / "new" / "trade.svg").read_text(encoding="utf-8")
    assert [f">{text}<" in drawn for text in ("0.35", "1.4", "96", "0.7")] == [True, True, True, False]


@pytest.fixture
def without_peer(monkeypatch):
    def missing():
        raise ResourceError("the wheel embreex is not installed")

    monkeypatch.setattr(embree_instances, "embree", missing)


def test_without_the_peer_the_row_says_so(without_peer):
    (row,) = run.run_forest([2], ["far"], **SMALL).rows
    assert "not installed" in row.note
    assert row.peer == {}
    assert row.ratio is None
    assert row.ours_psnr > 25


def test_without_the_peer_a_forest_of_too_many_polygons_has_times_alone(without_peer, monkeypatch):
    monkeypatch.setattr(drawing, "MOST_TRIANGLES", 40_000)  # one tree of the two
    (row,) = run.run_forest([2], ["far"], **SMALL).rows
    assert "not installed" in row.note
    assert "triangles are in view" in row.note
    assert row.ours_ms > 0
    assert row.ours_psnr is None


def test_the_command_writes_its_figures(tmp_path, monkeypatch):
    made, make_slices = [], run.make_slices
    monkeypatch.setattr(run, "make_slices", lambda nodes, slicing: made.append(slicing) or make_slices(nodes, slicing))
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
    ("options", "told"),
    [
        (["--trees", "0"], "at least 1"),
        (["--views", "close"], "far, middle, near"),
        (["--growth", "plot.gif"], "ends in .png, .svg or .pdf"),
        (["--tradeoff", "plot.gif"], "ends in .png, .svg or .pdf"),
        (["--alone", "--flight", "4"], "leaves out errors"),
    ],
)
def test_wrong_options_are_usage_errors(options, told):
    result = CliRunner().invoke(cli, ["bench", "forest", *options])
    assert result.exit_code == 2
    assert told in result.output
