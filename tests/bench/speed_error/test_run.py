"""The speed-error run: the quick preset as a command, what the figures must say, and the parts one by one."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from click.testing import CliRunner

from ibrpipe.bench.report.plots import _front
from ibrpipe.bench.report.speed_page import recommended
from ibrpipe.bench.report.template import figure, share
from ibrpipe.bench.settings import choose_settings
from ibrpipe.bench.speed_error.advice import NEEDS, advise, choose_winners
from ibrpipe.bench.speed_error.results import Score, SpeedErrorModel, Timing, WorkFacts
from ibrpipe.bench.speed_error.workloads import bumpy_torus, height_field, object_of, region_views
from ibrpipe.cli.main import cli
from ibrpipe.evaluation.timing import interleave, slope
from ibrpipe.io.surfaces.meshes import write_mesh


@pytest.fixture(scope="module")
def quick(tmp_path_factory):
    folder = tmp_path_factory.mktemp("speed")
    write_mesh(bumpy_torus(40), folder / "ring.ply")
    arguments = ["bench", "speed-error", "--quick", "--out", str(folder), "--mesh", str(folder / "ring.ply")]
    arguments += ["--renderers", "ldi", "--renderers", "prewarp"]
    result = CliRunner().invoke(cli, arguments)
    assert result.exit_code == 0, result.output
    text = (folder / "speed_error.json").read_text()
    return SpeedErrorModel.model_validate(json.loads(text)), (folder / "speed_error.html").read_text()


def test_everyone_is_timed_and_measured_in_every_view(quick):
    model, _ = quick
    assert {"ldi", "Embree", "flat picture"} <= {c.label for c in model.contenders}
    for work in model.works:
        for view in work.views:
            mine = {s.contender: s for s in model.scores if (s.work, s.view) == (work.name, view)}
            assert {"ldi", "Embree"} <= set(mine)
            assert mine["ldi"].depth.milliseconds > 0
            assert mine["ldi"].depth.fastest <= mine["ldi"].depth.milliseconds <= mine["ldi"].depth.high
    assert {work.name for work in model.works} >= {"torus 48", "ring 48", "height field 64"}


def test_exact_renderers_are_exact_and_the_flat_picture_is_not(quick):
    model, _ = quick
    fields = {work.name for work in model.works if work.kind == "height field"}
    for score in model.scores:
        if score.contender == "ldi":
            assert score.wrong == 0
            assert score.rmse < 1e-5
        if score.contender == "Embree":
            assert score.wrong <= 2e-4
        if score.contender == "Embree" and score.work in fields:
            assert 1e-3 < score.meant_rmse < 0.3  # triangles are another surface than bilinear patches
        if score.contender == "flat picture":
            assert score.wrong > 0.2


def test_colour_error_is_that_of_one_sample_a_pixel(quick):
    """It is no bug of a renderer, it is not nothing either; the picture without depth is far worse."""
    model, _ = quick
    by = {(s.work, s.view, s.contender): s.codes for s in model.scores}
    for (work, view, name), codes in by.items():
        if name == "flat picture":
            assert 1.0 < by[work, view, "ldi"] < 0.6 * codes


def test_growth_has_slopes_for_sizes_and_regions(quick):
    model, _ = quick
    series = {curve.series for curve in model.growth}
    assert {"texels grow", "both grow"} <= series
    assert len([name for name in series if name.startswith("epipole ")]) == 9
    for curve in model.growth:
        assert curve.slope is not None
        assert len(curve.spread) == (0 if curve.series == "texels grow" else len(curve.sizes))
        assert len(curve.doublings) == len(curve.sizes) - 1


def test_page_answers_and_loads_nothing(quick):
    model, page = quick
    assert "Which renderer to use when" in page
    assert page.count("<svg") >= 5
    assert "<script" not in page
    assert 'src="http' not in page
    for contender in model.contenders:
        assert contender.label in page
    for row in recommended(model):
        assert all(cell["winner"] for cell in row["cells"])
    views, works = ("oblique 60", "grazing 85", "corner"), ("height field 128", "torus 48", "ring 48")
    shown = [score for score in model.scores if score.view in views and score.work in works]
    assert page.count("data:image/png") == len(shown)


def score(name, milliseconds, wrong=0.0, rmse=0.0, codes=1.0):
    timing = Timing(milliseconds=milliseconds, low=milliseconds, high=milliseconds, fastest=milliseconds, frames=3)
    return Score(
        work="w", view="v", contender=name, depth=timing, both=timing, wrong=wrong, rmse=rmse, p99=rmse, worst=rmse,
        clipped=wrong, codes=codes, meant_wrong=wrong, meant_rmse=rmse,
    )  # fmt: skip


def test_winners_meet_the_demand_and_colourless_peers_win_no_picture():
    work = WorkFacts(name="w", kind="height field", n=8, texels=64, views=["v"])
    scores = [score("fast", 1.0, wrong=0.01, rmse=0.05, codes=1.5), score("right", 4.0), score("Embree", 2.0)]
    exact, near, best, fair = choose_winners(scores, [work])
    assert (exact.winner, exact.second, exact.ratio) == ("Embree", "right", 2.0)
    assert near.winner == "fast"
    assert (best.winner, best.second) == ("right", None)
    assert (fair.winner, fair.second) == ("fast", "right")
    nobody = choose_winners([score("fast", 1.0, wrong=0.5)], [work])[0]
    assert nobody.winner is None


def test_advice_is_the_fastest_that_meets_the_demand_in_every_view():
    work = WorkFacts(name="w", kind="height field", n=8, texels=64, views=["v", "u"])
    scores = [score("mixed", 1.0), score("right", 4.0), score("slow", 8.0), score("Embree", 2.0)]
    scores += [each.model_copy(update={"view": "u"}) for each in scores]
    scores[4] = score("mixed", 1.0, wrong=0.01, rmse=0.05, codes=1.5).model_copy(update={"view": "u"})
    exact, near, best, fair = (advise(need, work, scores) for need in NEEDS)
    assert (exact.winner, exact.second, exact.ratio) == ("Embree", "right", pytest.approx(2.0))
    assert near.winner == fair.winner == "mixed"
    assert (best.winner, best.milliseconds, best.second) == ("right", pytest.approx(4.0), "slow")
    assert [each.view for each in best.scores] == ["v", "u"]
    assert advise(NEEDS[0], work, scores[:4]).winner is None


def test_front_slope_and_numbers():
    assert _front([(1, 5), (2, 6), (3, 1), (0.5, 9)]) == [(0.5, 9), (1, 5), (3, 1)]
    assert math.isclose(slope([64, 128, 256], [1.0, 4.0, 16.0]), 2.0)
    assert slope([64], [1.0]) is None
    assert [figure(x) for x in (0.0, None, 3.14159, 0.00123, 2.3e-7, 25.0, 123.4)] == [
        "0", "–", "3.1", "0.0012", "2.3e-7", "25", "123"
    ]  # fmt: skip
    assert share(1, 400) == "0.25 %"


def test_turns_are_shared_and_slow_ones_leave_early():
    calls = {"quick": 0, "slow": 0}

    def work(name, rounds):
        calls[name] += 1
        return sum(range(rounds))

    draws = {"quick": lambda: work("quick", 10), "slow": lambda: work("slow", 3_000_000)}
    times = interleave(draws, 6, 0.05)
    assert times["quick"].count == 6
    assert times["slow"].count == 2
    assert calls == {"quick": 13, "slow": 5}


def test_height_fields_of_all_sizes_show_the_same_field():
    coarse, fine = (height_field(n, 32).sources[0].height for n in (32, 128))
    inner = fine[2::4, 2::4][:31, :31][1:, 1:]
    assert np.corrcoef(inner.ravel(), coarse[1:-1, 1:-1].ravel())[0, 1] > 0.8
    assert coarse.max() == pytest.approx(0.15)


def test_region_views_put_the_eye_beyond_each_side():
    feet = {name: camera.center[:2] for name, camera in region_views(8).items()}
    assert len(feet) == 9
    np.testing.assert_allclose(feet["within middle"], 0.5)
    assert feet["above left"].max() < 0
    assert feet["below right"].min() > 1


def test_first_layers_are_the_nearest_samples():
    whole, first = (object_of(bumpy_torus(60), "torus", 24, 32, first=only).sources for only in (False, True))
    for one, other in zip(whole, first, strict=True):
        counts = np.diff(one.offsets, axis=1)
        np.testing.assert_array_equal(np.diff(other.offsets, axis=1), counts > 0)
        np.testing.assert_array_equal(other.depth, [one.depth[k] for k in one.offsets[:, :-1][counts > 0]])
    assert sum(len(each.depth) for each in first) < sum(len(each.depth) for each in whole)


def test_coarser_settings_take_part_in_speed_alone():
    hard, speed = ({each.label for each in choose_settings(speed=speed)} for speed in (False, True))
    assert speed - hard == {"prewarp level 1", "prewarp parted", "splat 2 texels", "relief 64+8"}


def test_layers_of_an_object_lie_on_its_mesh():
    work = object_of(bumpy_torus(60), "torus", 40, 32)
    assert len(work.sources) == 6
    surface = work.surfaces[0]
    points = surface.world(surface.cells[:, 0] + 0.0, surface.cells[:, 1] + 0.0, surface.corners[:, 0])
    radius = np.hypot(np.hypot(points[:, 0], points[:, 1]) - 1, points[:, 2])
    present = (surface.masks & 1) > 0
    assert present.sum() > 100
    assert np.abs(radius[present] - 0.4).max() < 0.06
