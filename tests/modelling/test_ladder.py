"""The ladder: what is taken on which figures, and that every rung says why."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ibrpipe.modelling.ladder import Directions, Prices, climb, untried
from ibrpipe.modelling.plan_file import TexturePlan
from ibrpipe.modelling.rectangles import Rectangle
from ibrpipe.modelling.trial import LUMIGRAPH, MEDIAN, SHARPENED, TABLES, THIN, Trial
from ibrpipe.modelling.view_dependence.spiral_plan import SpiralPlan

PRICES = Prices(least=0.1, per_megabyte=0.03)
#: photos are more than a spiral of the plans here takes, or fewer
MANY, FEW = Directions("auto", 50e6), Directions("auto", 1e4)
SPIRAL = (SpiralPlan(k=1 / 24, residual_scale=0.75),)


def trial(shares=(0.5, 0.5), angles=(20.0, 40.0), **psnr):
    """PSNR by name, the same for both textures."""
    names = {"median": MEDIAN, "sharp": SHARPENED, "lumigraph": LUMIGRAPH, "thin": THIN}
    names |= {"joint": TABLES[0], "one": TABLES[1], "two": TABLES[2]}
    squares = {names[key]: np.full(2, 10 ** (-value / 10)) for key, value in psnr.items()}
    return Trial((10_000 * np.array(shares)).astype(int), squares, angles, {k: float(v[0]) for k, v in squares.items()})


def plans(glossy=True, side=200):
    edge = np.eye(3)
    rectangles = [Rectangle(name, np.zeros(3), edge[0], edge[1], side, side) for name in ("a", "b")]
    return [TexturePlan(each, 48.0, 4, SPIRAL if glossy else ()) for each in rectangles]


def kinds(found):
    return [[(each.kind, each.settings.get("tables")) for each in components] for components in found]


def test_gloss_that_tables_explain_gets_reflection_and_no_spiral():
    figures = trial(median=23, joint=23, one=31, two=30.5, lumigraph=25, thin=22)
    found, told = climb(figures, plans(), 20.0, PRICES, MANY)
    assert kinds(found) == [[("reflection", 1)]] * 2
    assert [entry["what"].split(":")[0] for entry in told] == ["rung 1", "rung 2", "rung 3"]
    assert told[1]["choice"] == "taken, 1 table"
    assert told[1]["measured"]["gain_db"] == pytest.approx(8.0)
    assert told[2]["choice"] == "dropped"


def test_two_tables_where_the_second_pays():
    found, _ = climb(trial(median=17, joint=17, one=22, two=24.8, lumigraph=19, thin=18), plans(), 20.0, PRICES, MANY)
    assert kinds(found) == [[("reflection", 2)]] * 2


def test_gloss_that_tables_do_not_explain_keeps_its_spiral():
    """As measured of real metal: tables help, the lumigraph helps by far more."""
    figures = trial(median=21, joint=21, one=23.9, two=23.8, lumigraph=26.5, thin=24)
    found, told = climb(figures, plans(), 20.0, PRICES, MANY)
    assert kinds(found) == [[("spiral", None)]] * 2
    assert told[1]["choice"] == "dropped"
    assert "images per direction are expected to reach" in told[1]["reason"]
    assert told[2]["choice"] == "taken, spiral images"


def test_tables_must_beat_the_lumigraph_as_it_will_be_between_photos():
    """Half a decibel better than a lumigraph whose neighbours are twice as far apart as they will be is worse."""
    figures = trial(median=21, joint=21, one=25.5, two=25.4, lumigraph=25, thin=22)
    assert kinds(climb(figures, plans(), 20.0, PRICES, MANY)[0]) == [[("spiral", None)]] * 2
    steady = trial(median=21, joint=21, one=25.5, two=25.4, lumigraph=25, thin=25)
    assert kinds(climb(steady, plans(), 20.0, PRICES, MANY)[0]) == [[("reflection", 1)]] * 2


def test_images_for_little_gain_are_dropped():
    """Matt stone that was taken for gloss: 0.35 dB for over ten megabytes."""
    figures = trial(median=26, joint=26, one=25.8, lumigraph=26.65, thin=26.65)
    found, told = climb(figures, plans(side=2400), 20.0, PRICES, MANY)
    assert kinds(found) == [[], []]
    assert told[2]["measured"]["bytes"] > 10e6
    assert "for a megabyte" in told[2]["reason"]
    cheap, _ = climb(figures, plans(side=200), 20.0, PRICES, MANY)
    assert kinds(cheap) == [[("spiral", None)]] * 2


@pytest.mark.parametrize(("joint", "wanted"), [(39.0, []), (40.0, [("reflection", 0)])])
def test_a_matt_thing_gets_the_better_diffuse_colours(joint, wanted):
    figures = trial(median=38, sharp=39.2, joint=joint, one=joint - 0.5, lumigraph=40, thin=40)
    assert kinds(climb(figures, plans(glossy=False), 20.0, PRICES, MANY)[0]) == [wanted] * 2


def test_the_lumigraph_between_photos():
    steep = trial(lumigraph=25, thin=20)
    assert 10 * np.log10(steep.lumigraph_at(20.0)) == pytest.approx(-3.5)  # no more than that an octave
    assert 10 * np.log10(trial(lumigraph=25, thin=24).lumigraph_at(20.0)) == pytest.approx(-1.0)
    assert trial(lumigraph=25, thin=26).lumigraph_at(20.0) == 1.0
    assert replace(steep, angles=(20.0, 20.0)).lumigraph_at(20.0) == 1.0


def test_photos_are_kept_where_they_are_smaller_than_a_spiral():
    """They take the place of the spiral on all textures: what is kept for one is there for the others."""
    figures = trial(median=21, joint=21.2, one=21, two=21, lumigraph=26.5, thin=24)
    one_glossy = [plans()[0], plans(glossy=False)[1]]
    found, told = climb(figures, one_glossy, 20.0, PRICES, FEW)
    assert kinds(found) == [[("reflection", 0), ("photos", None)]] * 2
    assert told[2]["choice"] == "taken, photos that are kept"
    assert told[2]["measured"]["textures"] == 2
    assert told[2]["measured"]["bytes"] == 10_000
    spirals, told = climb(figures, one_glossy, 20.0, PRICES, Directions("auto", 200e6))
    assert kinds(spirals) == [[("spiral", None)], []]
    assert told[2]["choice"] == "taken, spiral images"


@pytest.mark.parametrize(("kind", "wanted"), [("spiral", "spiral"), ("photos", "photos")])
def test_what_holds_images_per_direction_can_be_said(kind, wanted):
    figures = trial(median=21, joint=21, one=21, two=21, lumigraph=26.5, thin=24)
    for size in (1e4, 5e6):
        found, _ = climb(figures, plans(), 20.0, PRICES, Directions(kind, size))
        assert kinds(found) == [[(wanted, None)]] * 2


def test_photos_that_cost_more_than_they_bring_are_dropped():
    figures = trial(median=26, joint=26, one=25.8, lumigraph=26.65, thin=26.65)
    found, told = climb(figures, plans(), 20.0, PRICES, Directions("photos", 30e6))
    assert kinds(found) == [[], []]
    assert told[2]["choice"] == "dropped"


def test_without_a_trial_the_smaller_is_taken():
    assert kinds(each.components for each in untried(plans(), FEW)) == [[("photos", None)]] * 2
    assert kinds(each.components for each in untried(plans(), MANY)) == [[("spiral", None)]] * 2
    assert kinds(each.components for each in untried(plans(), Directions("spiral", 1.0))) == [[("spiral", None)]] * 2
    assert kinds(each.components for each in untried(plans(), Directions("photos", 9e9))) == [[("photos", None)]] * 2
    assert kinds(each.components for each in untried(plans(glossy=False), FEW)) == [[], []]
