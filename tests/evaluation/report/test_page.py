"""Words, plot and pictures of the report."""

from __future__ import annotations

import re

import numpy as np
import pytest
from chromium import Chromium, find_chromium

from ibrpipe.cli.figures import score_table
from ibrpipe.engine.machine import Machine
from ibrpipe.evaluation.image_scores import Truth
from ibrpipe.evaluation.metrics import MetricsModel, Protocol, Scores, TrainingFit, ViewMetrics
from ibrpipe.evaluation.report import pictures, plot, words
from ibrpipe.evaluation.report.page import _parts, render_page
from ibrpipe.evaluation.report.sources import ReportSources, _title
from ibrpipe.io.documents.plan import Reason
from ibrpipe.types import Frame

DOT = pictures.jpeg(np.zeros((3, 4, 3), np.uint8), 4)


def scores(psnr, ms, highlight=None, rest=None, coverage=0.999, covered=None):
    return Scores(
        psnr=psnr, ssim=0.9, flip=0.1, coverage=coverage, psnr_covered=covered, ssim_covered=0.95, flip_covered=0.05,
        psnr_highlight=highlight, psnr_rest=rest,
        ms_per_frame=ms, mpix_per_s=0.3072 / ms * 1e3,
    )  # fmt: skip


def metrics(residuals=3_000_000, own=None):
    own = own or scores(27.1, 30.0, 20.0, 30.0)
    baselines = {
        "diffuse": scores(23.0, 10.0, 14.0, 29.5),
        "ulr": scores(27.5, 400.0, 20.5),
        "mesh": scores(23.1, 15.0),
    }
    view = ViewMetrics(name="a", mask_pixels=1000, highlight_pixels=80, renderers={"ldi": own}, baselines=baselines)
    return MetricsModel(
        renderer="ldi",
        views=[view],
        mean=own,
        renderers={"ldi": own},
        baselines=baselines,
        bytes={"asset": 500_000 + residuals, "layers": 500_000, "residuals": residuals, "photos": 4_500_000},
        seconds={"layers": 12.5, "evaluate": 30.0},
        machine=Machine(cpu="c<pu>", cores=2, threads=2, system="s", python="3", versions={"numpy": "2"}),
        protocol=Protocol(
            mask_threshold=0.5, highlight_threshold=24, ssim_window="w", flip_ppd=67.0, psnr_cap=100.0,
            timing_width=640, timing_height=480, timing_repeats=7, timing_views=4, threads=2, lines=["one", "two"],
        ),
    )  # fmt: skip


@pytest.mark.parametrize(
    ("count", "text"),
    [(0, "0 B"), (999, "999 B"), (1000, "1 kB"), (1540, "1.54 kB"), (999_499, "999 kB"), (4_519_411, "4.52 MB"),
     (123_456_789, "123 MB"), (7_000_000_000, "7 GB")],
)  # fmt: skip
def test_sizes_in_words(count, text):
    assert words.size(count) == text


@pytest.mark.parametrize(
    ("value", "text"),
    [(True, "yes"), (0.0416666, "0.04167"), ({"a_b": 1, "c": [1, 2]}, "a b 1, c 1 × 2"), (None, "–"), ("kept", "kept"),
     (-1.5, "−1.5")],
)  # fmt: skip
def test_values_of_the_plan_in_words(value, text):
    assert words.plain(value) == text


def test_the_verdict_says_what_was_found():
    text = " ".join(words.verdict(metrics()))
    for part in (
        "27.10 dB PSNR", "0.40 dB less than blending", "4.10 dB more than its diffuse colours", "99.90 % of the mask",
        "8 % of the covered pixels", "+6.0 dB (14.0 to 20.0 dB", "elsewhere by +0.5 dB", "3.5 MB", "78 % of the photos",
        "takes 30 ms with residuals and 10 ms without", "1.50 times Embree's speed", "2.00 times as long",
    ):  # fmt: skip
        assert part in text, part


def test_the_verdict_does_not_praise_a_failure():
    poor = metrics(residuals=9_000_000, own=scores(22.0, 300.0, 13.0, 29.0))
    text = " ".join(words.verdict(poor))
    for part in ("5.50 dB less than blending", "1.00 dB less than its diffuse", "−1.0 dB", "2.1 times the photos"):
        assert part in text, part
    assert [card.tone for card in words.cards(poor)][1:3] == ["poor", "poor"]
    assert [card.tone for card in words.cards(metrics())][1:] == [
        "fair",
        "good",
        "fair",
    ]  # 0.4 dB less, half Embree's speed
    better = metrics(own=scores(27.6, 14.0, 20.0, 30.0))
    assert [card.tone for card in words.cards(better)][1:] == ["good", "good", "good"]


def place():
    """Photos without masks: the methods cover a good half of the pictures, and the rest is black in all."""
    own = scores(9.7, 30.0, 20.0, 31.0, coverage=0.61, covered=30.5)
    baselines = {
        "diffuse": scores(9.6, 10.0, 14.0, 30.0, coverage=0.61, covered=29.0),
        "ulr": scores(9.7, 400.0, 20.5, coverage=0.62, covered=30.53),
        "mesh": scores(9.5, 15.0, coverage=0.62, covered=28.0),
    }
    view = ViewMetrics(
        name="a",
        mask_pixels=1000,
        covered_pixels=600,
        highlight_pixels=30,
        renderers={"ldi": own},
        baselines=baselines,
    )
    told = {"headline": "covered", "views": [view], "mean": own, "renderers": {"ldi": own}, "baselines": baselines}
    return metrics().model_copy(update=told)


def test_a_place_without_masks_is_judged_inside_what_is_covered():
    text = " ".join(words.verdict(place()))
    for part in (
        "30.50 dB PSNR inside what all methods cover (60 % of the pictures)", "0.03 dB less than blending",
        "covers 61 % of the pictures", "where the rest is black, it reaches 9.70 dB (lumigraph 9.70 dB)",
        "5 % of the covered pixels",
    ):  # fmt: skip
        assert part in text, part
    first, coverage, gap = words.cards(place())[:3]
    assert (first.value, coverage.value, gap.value, gap.tone) == ("30.5 dB", "61 %", "0.0 dB", "good")
    assert "9.7 dB over the whole" in coverage.note
    page = render_page(place(), [], ReportSources("a", 3, 1, (4, 3)))
    assert "where all cover" in page
    assert "whole picture" in page
    assert "30.5 dB" in plot.speed_error_plot(place())


def test_who_covers_less_than_the_lumigraph_is_not_praised():
    own = place().mean.model_copy(update={"coverage": 0.4})
    gap = words.cards(place().model_copy(update={"mean": own, "renderers": {"ldi": own}}))[2]
    assert (gap.tone, gap.value) == ("fair", "0.0 dB")
    assert "covers 22 % more" in gap.note


@pytest.mark.parametrize(
    ("value", "text"), [(-0.04, "0.0"), (0.04, "0.0"), (-0.05001, "−0.1"), (0.26, "+0.3"), (-0.0, "0.0")]
)
def test_a_difference_of_nothing_has_no_sign(value, text):
    assert words.signed(value) == text
    assert words.number(-0.001, 2) == "0.00"


def unheld():
    """Nothing is held out: times of all methods, and the fit to the photos themselves."""
    own, diffuse = scores(33.0, 30.0), scores(28.0, 10.0)
    view = ViewMetrics(
        name="photo_7", mask_pixels=1000, highlight_pixels=0, renderers={"ldi": own}, baselines={"diffuse": diffuse}
    )
    timed = {
        name: Scores(psnr=None, ssim=None, flip=None, coverage=None, ms_per_frame=ms, mpix_per_s=1.0)
        for name, ms in {"ldi": 30.0, "diffuse": 10.0, "ulr": 400.0, "mesh": 15.0}.items()
    }
    baselines = {name: timed[name] for name in ("diffuse", "ulr", "mesh")}
    fit = TrainingFit(views=[view], renderers={"ldi": own}, baselines={**baselines, "diffuse": diffuse})
    told = {"views": [], "mean": timed["ldi"], "renderers": {"ldi": timed["ldi"]}, "baselines": baselines}
    lost = "How well the asset shows new views was not measured"
    return metrics().model_copy(update={**told, "training": fit, "not_measured": [lost]})


def test_a_run_without_held_out_photos_says_what_was_not_measured():
    text = " ".join(words.verdict(unheld()))
    assert "On 1 of its own photos the asset reaches 33.00 dB PSNR" in text
    assert "new views was not measured" in text
    assert "lumigraph" not in text
    labels = [card.label for card in words.cards(unheld())]
    assert labels == ["Its own photos (new views: not measured)", "Asset", "Frame"]
    page = render_page(unheld(), [], ReportSources("a", 3, 0, (4, 3)))
    assert "none held out for measuring" in page
    assert "nothing of new views" in page
    assert "photo_7" in page
    assert "Speed against error" not in page
    table = "".join(str(cell) for column in score_table(unheld()).columns for cell in column.cells)
    assert "33.00" in table
    assert "ulr (baseline)" in table


def test_the_terminal_shows_the_covered_figures_first_where_there_are_no_masks():
    headings = [str(column.header) for column in score_table(place()).columns]
    assert headings[1] == "PSNR dB"
    assert headings[-1] == "whole picture dB"
    assert next(iter(score_table(place()).columns[1].cells)) == "30.50"
    assert [str(column.header) for column in score_table(metrics()).columns][-1] == "covered by all dB"


def test_uncovered_pixels_are_grey_and_have_no_difference():
    truth = Truth(np.full((8, 8, 3), 200, np.uint8), np.ones((8, 8), bool))
    alpha = np.zeros((8, 8), np.float32)
    alpha[:, :4] = 1
    picture, difference = pictures._drawn(truth, Frame(np.full((8, 8, 3), 0.5, np.float32), None, alpha))
    assert (picture[:, 4:] == pictures.UNCOVERED).all()
    assert (difference[:, 4:] == pictures.UNCOVERED).all()
    assert not (picture[:, :4] == pictures.UNCOVERED).any()


def test_an_asset_without_residuals_says_so():
    text = " ".join(words.verdict(metrics(residuals=0)))
    assert "holds no residuals" in text
    assert "diffuse colours" not in text


def test_a_matt_asset_is_shown_once():
    columns = tuple(pictures.Column(name, scores(27.0, 30.0), "data:,", "data:,") for name in ("ldi", "diffuse", "ulr"))
    view = pictures.ViewPictures("a", 4, 3, "data:,", "data:,", 0.1, columns)
    matt, glossy = (render_page(metrics(size), [view], ReportSources("a", 3, 1, (4, 3))) for size in (0, 3_000_000))
    assert "diffuse only" in glossy
    assert "diffuse only" not in matt
    assert "with residuals" not in matt
    assert "– dB" not in matt


@pytest.mark.parametrize(
    ("folder", "title"),
    [("/a/vase", "vase"), ("/a/demo/capture", "demo"), ("/runs/shoe/photos", "shoe"), ("/capture", "capture"),
     ("", "untitled capture")],
)  # fmt: skip
def test_the_report_is_called_what_is_shown(folder, title):
    assert _title(folder) == title


@pytest.mark.skipif(find_chromium() is None, reason="needs chromium")
def test_pictures_are_enlarged_beside_the_photo_and_nothing_sticks_out_of_a_phone(tmp_path):
    columns = tuple(pictures.Column(name, scores(27.0, 30.0), DOT, DOT) for name in ("ldi", "diffuse", "ulr"))
    view = pictures.ViewPictures("a", 4, 3, DOT, DOT, 0.1, columns)
    page = tmp_path / "report.html"
    page.write_text(render_page(metrics(), [view], ReportSources("a", 3, 1, (4, 3))), encoding="utf-8")
    with Chromium(tmp_path / "profile", "--window-size=390,800") as browser:
        browser.open(page.as_uri(), 390, 800, phone=True)
        assert browser.evaluate("document.documentElement.scrollWidth") == 390
        rows = browser.evaluate("new Set([...document.querySelectorAll('.grid figure')].map(f => f.offsetTop)).size")
        assert rows == 2  # differences stay below their pictures
        browser.evaluate("document.querySelectorAll('.grid img')[1].click()")
        assert browser.evaluate("document.querySelector('dialog').open")
        assert browser.evaluate("document.querySelector('dialog .name').textContent") == "photo a | ldi of view a"
        wheel = "new WheelEvent('wheel', {deltaY: -400, clientX: 200, clientY: 400})"
        browser.evaluate(f"void document.querySelector('.stage').dispatchEvent({wheel})")
        assert "scale(2.7" in browser.evaluate("document.querySelector('.under').style.transform")
        assert browser.errors == []
        assert [address for address in browser.requests if not address.startswith(("file:", "data:"))] == []


def test_several_kinds_of_view_dependence_have_a_bar_each():
    kinds = {"spiral": 2_000_000, "tint": 1_000_000}
    one, two = (metrics().model_copy(update={"view_dependence": dict(list(kinds.items())[:n])}) for n in (1, 2))
    assert not any("of these" in name for name in _parts(one))
    assert {name: count for name, count in _parts(two).items() if "of these" in name} == {
        "of these spiral": 2_000_000,
        "of these tint": 1_000_000,
    }
    assert "of these tint" in render_page(two, [], ReportSources("a", 3, 1, (4, 3)))


def test_rungs_of_the_plan_are_told_with_what_was_measured_of_each():
    rungs = (
        Reason(
            what="rung 2: shared reflection", choice="taken", reason="r2", measured={"psnr": 30.061, "bytes": 690_000}
        ),
        Reason(what="rung 3: images per direction", choice="dropped", reason="r3", measured={"textures": 0}),
    )
    page = render_page(metrics(), [], ReportSources("a", 3, 1, (4, 3), reasons=rungs))
    rows = [row for row in page.split("<tr>") if "shared reflection" in row or "images per direction" in row]
    assert "30.06" in rows[0]
    assert "690 kB" in rows[0]
    assert "dropped" in rows[1]
    assert "kB" not in rows[1]


def test_the_page_escapes_what_it_is_told():
    page = render_page(metrics(), [], ReportSources("<b>&", 3, 1, (4, 3)))
    assert "<b>&" not in page.replace("<b>all</b>", "")
    assert "&lt;b&gt;&amp;" in page
    assert "c&lt;pu&gt;" in page


def test_the_plot_holds_every_way_and_says_its_figures():
    drawn = plot.speed_error_plot(metrics())
    for text in ("ldi", "30 ms, 27.1 dB", "ulr", "400 ms, 27.5 dB", "mesh", "diffuse", "640 × 480"):
        assert text in drawn, text
    assert "<metadata" not in drawn
    assert not re.search(r'href="https?:', drawn)
    assert plot.speed_error_plot(metrics()) == drawn


def test_rms_of_a_psnr():
    assert plot.rms_codes(20 * np.log10(255 / 10)) == pytest.approx(10.0)


def test_differences_are_amplified_and_capped():
    colors = pictures.heat_colors()
    truth = np.full((1, 3, 3), 100, np.uint8)
    picture = truth.copy()
    picture[0, 1, 2] = 110
    picture[0, 2, 0] = 0
    heat = pictures._heat(truth, picture)
    assert (heat[0] == colors[[0, 40, 255]]).all()
