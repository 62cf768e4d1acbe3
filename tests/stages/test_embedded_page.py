"""What a report shows of the asset from all sides: its page, or why there is none."""

from __future__ import annotations

import json
from html import unescape

import page_assets
import pytest
from evaluation.report.test_page import metrics

from ibrpipe.export.page.document import script_text, source_hash
from ibrpipe.stages import embedded_page
from ibrpipe.types import Asset


def made(asset):
    return embedded_page.embedded_page(asset, "vase <3", None, metrics())


def test_the_page_turns_from_the_start_and_its_script_is_named():
    found = made(page_assets.make_asset("matt"))
    assert found.told == ""
    assert found.script == source_hash(script_text())
    assert f"'{found.script}'" in unescape(found.page)  # the page's own policy agrees
    meta = json.loads(found.page.partition('id="meta">')[2].partition("</script>")[0])
    assert meta["start"]["turning"] is True
    assert "<title>vase &lt;3</title>" in found.page


@pytest.mark.parametrize(("large", "word"), [(1000, "ibrpipe export RUN page.html"), (10**9, "")])
def test_a_page_that_is_too_large_is_not_put_in(monkeypatch, large, word):
    monkeypatch.setattr(embedded_page, "LARGE", large)
    found = made(page_assets.make_asset("matt"))
    assert word in found.told
    assert bool(found.page) == (word == "")


def test_what_no_page_can_show_is_told():
    found = made(Asset((), {}))
    assert found.page == ""
    assert "holds no sample" in found.told
