"""The asset as a page inside the report."""

from __future__ import annotations

from pathlib import Path

from ibrpipe.errors import FormatError
from ibrpipe.evaluation.metrics import MetricsModel
from ibrpipe.evaluation.report.turntable import Turntable
from ibrpipe.export.page.document import script_text, source_hash
from ibrpipe.export.page.exporter import LARGE, SMALLER, make_page
from ibrpipe.export.page.measured import scores_of
from ibrpipe.export.page.notes import PageNotes
from ibrpipe.export.whole_file import megabytes
from ibrpipe.types import Asset


def embedded_page(asset: Asset, name: str, views: Path | None, metrics: MetricsModel) -> Turntable:
    """Return what the report shows of the asset from all sides, or why it does not.

    Parameters
    ----------
    name : str
        Title.
    views : Path, optional
        ``views.json`` of the run.
    metrics : MetricsModel
        Whose scores of held-out photos are shown beside them.
    """
    measured = scores_of(metrics.model_dump_json(), "the report")
    try:
        page = make_page(asset, PageNotes(), name, views, measured, turning=True)
    except FormatError as error:
        return Turntable(told=f"The object cannot be shown in a page: {error}")
    count = len(page.text.encode("utf-8"))
    if count > LARGE:
        much = f"The object's page takes {megabytes(count)}, too much for a report"
        return Turntable(told=f"{much}: ibrpipe export RUN page.html writes it, and {SMALLER} makes it smaller.")
    return Turntable(page.text, source_hash(script_text()))
