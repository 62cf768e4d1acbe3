"""The object's page inside the report: it runs there, nothing else does, and why it is missing is told."""

from __future__ import annotations

from html import unescape

import pytest
from chromium import Chromium, find_chromium
from evaluation.report.test_page import metrics

from ibrpipe.evaluation.report.page import render_page
from ibrpipe.evaluation.report.sources import ReportSources
from ibrpipe.evaluation.report.turntable import Turntable, policy
from ibrpipe.export.page.document import source_hash

SCRIPT = "parent.postMessage('\"own\"', '*');"
STRANGE = "parent.postMessage('strange', '*');"
INSIDE = f"<!doctype html><title>a & b</title><script>{SCRIPT}</script><script>{STRANGE}</script>"
HEARD = "window.heard = []; addEventListener('message', (event) => window.heard.push(event.data));"


def report(turntable):
    return render_page(metrics(), [], ReportSources("a", 3, 1, (4, 3)), turntable=turntable)


@pytest.mark.skipif(find_chromium() is None, reason="needs chromium")
def test_the_page_runs_its_own_script_alone_and_is_held_by_a_click(tmp_path):
    (tmp_path / "report.html").write_text(report(Turntable(INSIDE, source_hash(SCRIPT))), encoding="utf-8")
    with Chromium(tmp_path / "profile") as browser:
        browser.call("Page.addScriptToEvaluateOnNewDocument", source=HEARD)
        browser.open((tmp_path / "report.html").as_uri(), 390, 800, phone=True)
        assert browser.evaluate("new Promise(done => setTimeout(() => done(window.heard), 300))") == ['"own"']
        frame = "getComputedStyle(document.querySelector('iframe')).pointerEvents"
        assert browser.evaluate(frame) == "none"  # fingers scroll the report
        browser.evaluate("document.querySelector('.take').click()")
        assert browser.evaluate(frame) == "auto"
        browser.evaluate("document.querySelector('.leave').click()")
        assert browser.evaluate(frame) == "none"
        assert browser.evaluate("document.documentElement.scrollWidth") == 390


def test_scripts_that_may_run_are_those_of_report_and_page():
    assert policy("x", None).count("'sha256-") == 1
    assert f"'{source_hash('x')}' 'sha256-own'" in policy("x", Turntable("page", "sha256-own"))
    page = report(Turntable(INSIDE, "sha256-own"))
    assert source_hash(page.rpartition("<script>")[2].partition("</script>")[0]) in unescape(page)  # what stands there
    assert 'sandbox="allow-scripts"' in page
    assert "<title>a & b</title>" not in page  # escaped: it ends no attribute


def test_without_a_page_the_reason_stands_there_and_without_a_word_nothing():
    page = report(Turntable(told="The object's page takes 40 MB."))
    assert "The object&#39;s page takes 40 MB." in page
    assert "<iframe" not in page
    assert "From all sides" not in report(None)
