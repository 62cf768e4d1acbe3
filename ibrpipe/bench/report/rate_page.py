"""The page of bytes against error."""

from __future__ import annotations

from pathlib import Path

from ibrpipe.bench.rate_error.results import RateErrorModel
from ibrpipe.bench.report.plots import RATE_MARKS, rate_plot
from ibrpipe.bench.report.template import fill


def write_rate_page(path: Path, model: RateErrorModel) -> None:
    """Write the page: one file without scripts that loads nothing from anywhere."""
    from markupsafe import Markup

    plots = [Markup(rate_plot(curve)) for curve in model.curves]
    colors = {series: color for series, (color, _) in RATE_MARKS.items()}
    page = fill("rate_error.html", model=model, plots=plots, colors=colors)
    path.write_text(page, encoding="utf-8")
